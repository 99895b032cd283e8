"""The accelerometer's offset and gain from the v pose and the step, as the paper has them."""

from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
import numpy as np


def plain_offset(volts_v: Array) -> Array:
    """
    Offset as the mean reading in the v pose, [Gamez2005] Eq. 15.

    Holds for an axis that is horizontal there, and for a sensor that shows DC: one with a
    high-pass of 16 s still remembers the gravity of the pose before.

    Parameters
    ----------
    volts_v : ndarray, shape (n, k)
        [V]

    Returns
    -------
    ndarray, shape (k,)
    """
    return np.asarray(volts_v.mean(axis=0))


def step_gain(theta: Array, Y: Array, theta_variance: float = 0.0) -> float:
    """
    Gain from a step, Kgain = 1 / ((theta^T theta)^-1 theta^T Y), [Gamez2005] Eq. 17.

    The regressor theta is the noisy one: its noise inflates theta^T theta, which pulls the slope
    towards zero and the gain up. With ``theta_variance`` that is taken off (errors in variables).
    A delay between the sensors does more harm: it turns theta^T Y down by the cosine of the
    phase it makes at the frequency of the ringing.

    Parameters
    ----------
    theta : ndarray, shape (n,)
        Volts less offset [V].
    Y : ndarray, shape (n,)
        (u - u^v) / m [m/s^2]: neither the sensor's bias nor a tare enters.
    theta_variance : float
        Of the noise of theta, 0 for Eq. 17 as printed [V^2].

    Returns
    -------
    float
        [V/(m/s^2)]

    Raises
    ------
    UnobservableError
        The step does not stand out of the noise.
    """
    energy = float(theta @ theta) - theta_variance * len(theta)
    product = float(theta @ Y)
    if not len(theta) or energy <= 0 or abs(product) < 1e-12:
        raise UnobservableError(
            f"the step does not stand out of the accelerometer's noise ({len(theta)} samples, "
            f'energy {energy:.3g} V^2); make it longer or faster')
    return energy / product
