"""What filter ``kalman`` promises of the contact wrench: how sure, how quick."""

from math import exp, inf, log, pi, tau
from typing import Any, NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.geometry import Array
from forcecal_ros.observe.bandwidth import as_calibrated
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.covariances import load_maps, noise_of_reading
from forcecal_ros.observe.filters.memory import KALMAN
from forcecal_ros.observe.settings import ObserverSettings
import numpy as np
from scipy.integrate import quad


class Accuracy(NamedTuple):
    """
    What is to be expected of the contact wrench [N, N m].

    Attributes
    ----------
    bandwidth : float
        Where its answer to a contact has fallen by 3 dB [Hz].
    rise_time : float
        From 10 to 90 % of a step [s].
    covariance : ndarray, shape (6, 6)
        Of its error while the contact wanders by ``walk``, about the origin of ft_sensor.
    innovation : ndarray, shape (6, 6)
        Of what a reading differs from the last estimate by, where the noise is white.
    walk : ndarray, shape (6,)
        Wander of a contact that is expected: of the force as the settings say, of the torque
        what the gain is best for [N/sqrt(s), N m/sqrt(s)].
    """

    bandwidth: float
    rise_time: float
    covariance: Array
    innovation: Array
    walk: Array

    @property
    def std(self) -> Array:
        """Standard deviation of the contact wrench, shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def rise_time(bandwidth: Any) -> Any:
    """10-90 % rise [s] of the first-order filter with this corner [Hz]."""
    return log(9.0) / (tau * bandwidth)


def accuracy(calibration: Calibration, model: Model,
             settings: ObserverSettings = ObserverSettings()) -> Accuracy | None:
    """
    Predict the error of filter ``kalman`` from the measured noise.

    With the gain k of one update, what the noise R leaves is R k / (2 - k), and what a random walk
    of variance q a period leaves q (1 - k)^2 / (k (2 - k)). Of the noise of the angular
    acceleration, which the poses tell slowly, the filter takes off the fast share.

    Parameters
    ----------
    calibration
    model
        Its :func:`~forcecal_ros.observe.design.design` by these settings.
    settings

    Returns
    -------
    Accuracy or None
        None where the calibration holds no noise, or another filter runs.
    """
    noise = calibration.noise
    if noise is None or model.filter != KALMAN:
        return None
    sample, density = noise_of_reading(calibration, noise)
    k = 1 - exp(-model.rate / noise.wrench_rate)
    R = density * noise.wrench_rate
    walk = np.diag(R) * k * k / (1 - k)
    said = as_calibrated(settings, calibration).contact_walk
    if said is not None:
        walk[:3] = said ** 2 / noise.wrench_rate
    error = R * k / (2 - k) + np.diag(walk) * (1 - k) ** 2 / (k * (2 - k))
    _, by_alpha = load_maps(calibration)
    turning = _alpha_variance(model, settings) * by_alpha @ by_alpha.T
    fast = _fast_share(model.rate / model.rotation_poles.real)
    bandwidth = model.rate / tau
    return Accuracy(bandwidth, rise_time(bandwidth), error + (1 - fast) * turning,
                    error + np.diag(walk) + sample + fast * turning,
                    np.sqrt(walk * noise.wrench_rate))


def _alpha_variance(model: Model, settings: ObserverSettings) -> float:
    """Noise of the angular acceleration: the third state of a Butterworth filter of poses."""
    density = settings.pose_rotation_std ** 2 / settings.pose_rate
    return float(density * model.rotation_poles.real ** 5 / 3)


def _fast_share(ratio: float) -> float:
    """
    Share of the angular acceleration's noise that a first-order low-pass takes off.

    Its spectrum is x^4 / (1 + x^6) at x times the corner of the pose filter; ``ratio`` is the
    corner of the low-pass over that one.
    """
    share, _ = quad(lambda x: x ** 6 / (1 + x ** 6) / (x * x + ratio * ratio), 0.0, inf)
    return float(3 / pi * share)


def noise_of_force(calibration: Calibration, bandwidths: Array) -> Array | None:
    """
    Return the noise of a steady contact force at each bandwidth [Hz], shape (n, 3) [N].

    None where the calibration holds no noise.
    """
    noise = calibration.noise
    if noise is None:
        return None
    _, density = noise_of_reading(calibration, noise)
    k = 1 - np.exp(-tau * bandwidths / noise.wrench_rate)[:, np.newaxis]
    return np.asarray(np.sqrt(np.diag(density)[:3] * noise.wrench_rate * k / (2 - k)))
