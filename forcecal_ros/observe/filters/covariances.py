"""Q, R and P0 of the filters after [Ukf2025]: as the paper prints them, or as measured.

Where [Ukf2025] leaves a choice open, this is ours:

- f and h. The paper prints neither; with h = identity the filter smooths the weight instead of
  removing it. Ours: y = F + b + load + v, load = weight and inertia of the tool.
- "Constant velocity" needs twelve more states than the paper has. Ours: a random walk, which
  returns to zero while contact is excluded (see :mod:`forcecal_ros.observe.filters.bias_filter`).
- x0. The paper says both "the first reading" and zero. Ours: zero, since the first reading is
  mostly the weight; biases start from the calibration.
- n = 8 or 12. The paper lists b_f and b_m, two names of three numbers each. Ours: 12, or 6.
- Scale factors are no states: a scale on F cannot be told from F. They belong into the
  calibration (``matrix``).
- Q, R, P0. The paper's as ``covariances: paper``. Ours, ``measured``: R is the covariance
  measured at rest, the accelerometer's share included; P0 of the biases the calibration's
  standard errors, of the wrench R, so that the first estimate is no raw reading; Q is what the
  rise time asks for. No free motion can tell Q: it is the room left to contact.
"""

from math import exp, log
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration, Noise
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, skew
import numpy as np

PAPER_PERIOD = 0.001
"""[Ukf2025] samples at 1000 Hz [s]."""


class Covariances(NamedTuple):
    """
    Covariances of the wrench [N^2, N^2 m, N^2 m^2], each of shape (6, 6).

    Attributes
    ----------
    Q : ndarray
        What the wrench gains in one ``period``.
    R : ndarray
        Of one reading.
    P0 : ndarray
        Of the wrench at the start.
    period : float
        [s]
    """

    Q: Array
    R: Array
    P0: Array
    period: float


def paper_covariances() -> Covariances:
    """
    Return Q, R and P0 as [Ukf2025] prints them.

    R = 0.1 N^2 is a noise of 0.32 N. On a sensor that really is so noisy these give errors of
    0.5 N, three times the paper's own table; on a quiet one they are only its ratio Q/R, a rise
    in about 7 ms, and an innovation far smaller than the filter thinks.
    """
    return Covariances(np.diag([0.01] * 3 + [0.001] * 3), np.diag([0.1] * 3 + [0.01] * 3),
                       np.diag([1.0] * 3 + [0.1] * 3), PAPER_PERIOD)


def gain_of(rise_time: float, period: float) -> float:
    """Gain of a first-order filter with a 10-90 % rise [s] at a period [s]."""
    return 1 - exp(-log(9.0) * period / rise_time)


def load_maps(calibration: Calibration) -> tuple[Array, Array]:
    """Return what specific force and angular acceleration do to the load, two of shape (6, 3)."""
    m, c = float(calibration.mass), calibration.com.value
    by_force = -m * np.vstack([np.eye(3), skew(c)])
    accelerometer = calibration.accelerometer
    d = np.zeros(3)
    if accelerometer is not None and accelerometer.position is not None:
        d = c - accelerometer.position.value
    by_alpha = by_force @ -skew(d)
    if calibration.inertia is not None:
        by_alpha[3:] -= calibration.inertia.value
    return by_force, by_alpha


def noise_of_reading(calibration: Calibration, noise: Noise) -> tuple[Array, Array]:
    """Return covariance and low-frequency density of u - m a, two of shape (6, 6)."""
    by_force, _ = load_maps(calibration)
    sample, f = noise.wrench.value, noise.specific_force
    density = sample / noise.wrench_rate
    if noise.wrench_density is not None:
        density = noise.wrench_density.value
    if f is None:
        return sample, density
    f_density = f.value / noise.accelerometer_rate
    if noise.specific_force_density is not None:
        f_density = noise.specific_force_density.value
    return (sample + by_force @ f.value @ by_force.T,
            density + by_force @ f_density @ by_force.T)


def load_noise(calibration: Calibration, alpha_std: float) -> Array:
    """
    Noise that the load brings: the accelerometer's, and that of the angular acceleration.

    The load is -m [1; c x] f_c and -I alpha, f_c = f + alpha x d at d from the accelerometer;
    ``alpha_std`` is per axis [rad/s^2]. Covariance of shape (6, 6).
    """
    by_force, by_alpha = load_maps(calibration)
    cov, noise = alpha_std ** 2 * by_alpha @ by_alpha.T, calibration.noise
    if noise is not None and noise.specific_force is not None:
        cov += by_force @ noise.specific_force.value @ by_force.T
    return np.asarray(cov)


def measured_covariances(calibration: Calibration, rise_time: float,
                         alpha_std: float) -> Covariances:
    """
    Find Q, R and P0 from what was measured.

    R is the noise of the force sensor and of the load. Q = R k^2 / (1 - k) is the random walk
    whose stationary gain k gives the rise time [s], the same on all axes.

    Raises
    ------
    ConfigError
        The calibration holds no noise.
    """
    noise = calibration.noise
    if noise is None or not noise.wrench_rate > 0:
        raise ConfigError('the calibration holds no noise.wrench with its rate, so R is unknown; '
                          'set gravity.covariances: paper')
    R = noise.wrench.value + load_noise(calibration, alpha_std)
    k = gain_of(rise_time, 1 / noise.wrench_rate)
    return Covariances(R * k * k / (1 - k), R, R.copy(), 1 / noise.wrench_rate)
