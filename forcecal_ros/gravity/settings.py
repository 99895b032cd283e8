"""What a user may say about gravity compensation, and the covariances that follow from it.

Where [Ukf2025] leaves a choice open, this is ours:

- f and h. The paper prints neither; with h = identity the filter smooths the weight instead of
  removing it. Ours: y = F + b + load + v, load = weight and inertia of the tool.
- "Constant velocity" needs twelve more states than the paper has. Ours: a random walk, which
  returns to nil while contact is excluded (see :mod:`forcecal_ros.gravity.step`).
- x0. The paper says both "the first reading" and nil. Ours: nil, since the first reading is
  mostly the weight; biases start from the calibration.
- n = 8 or 12. The paper lists b_f and b_m, two names of three numbers each. Ours: 12, or 6.
- Scale factors are no states: a scale on F cannot be told from F. They belong into the
  calibration (``matrix``).
- Q, R, P0. The paper's as ``covariances: paper``. Ours, ``measured``: R is the covariance
  measured at rest, the accelerometer's share included; P0 of the biases the calibration's
  standard errors, of the wrench R, so that the first estimate is no raw reading; Q is what the
  rise time asks for. No free motion can tell Q: it is the room left to contact.
"""

from dataclasses import dataclass
from math import exp, isfinite, log
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array, skew
from forcecal_ros.gravity.sigma_points import PAPER_SCALING, Scaling
import numpy as np

FILTERS = ('ukf', 'ekf', 'static')
COVARIANCES = ('measured', 'paper')
PAPER_PERIOD = 0.001
"""[Ukf2025] samples at 1000 Hz [s]."""


@dataclass(frozen=True)
class Settings:
    """
    Choices of gravity compensation.

    Attributes
    ----------
    filter : str
        ``ukf``, ``ekf``, or ``static``: weight and bias taken off, nothing filtered.
    states : int
        6 (wrench) or 12 (wrench and biases).
    covariances : str
        ``measured`` or ``paper``.
    rise_time : float
        10-90 % rise of a contact wrench that ``measured`` aims at [s].
    relaxation : float
        Time in which the wrench is expected to return to nil while contact is excluded [s].
    bias_walk : tuple of 2 float
        Wander of the biases [N/sqrt(s)], [N m/sqrt(s)].
    bias_prior : tuple of 2 float
        How far the biases may have moved since the calibration [N], [N m].
    contact_floor : tuple of 2 float
        Errors of weight and inertia that are not to be called contact [N], [N m].
    contact_window : float
        Time over which a weak contact is averaged [s].
    false_alarm : float
        Probability that a sample without contact is called contact.
    release_time : float
        Quiet after which contact counts as ended [s].
    scaling : Scaling
        Spread of the sigma points.
    """

    filter: str = 'ukf'
    states: int = 12
    covariances: str = 'measured'
    rise_time: float = 0.012
    relaxation: float = 0.1
    bias_walk: tuple[float, float] = (4e-4, 4e-5)
    bias_prior: tuple[float, float] = (0.0, 0.0)
    contact_floor: tuple[float, float] = (0.03, 0.003)
    contact_window: float = 0.1
    false_alarm: float = 1e-6
    release_time: float = 0.2
    scaling: Scaling = PAPER_SCALING

    def __post_init__(self) -> None:
        for name, value, words in (('filter', self.filter, FILTERS),
                                   ('states', self.states, (6, 12)),
                                   ('covariances', self.covariances, COVARIANCES)):
            if value not in words:
                raise ConfigError(f'gravity.{name} is {value!r}; '
                                  f'it wants one of {", ".join(map(str, words))}')
        for name in ('rise_time', 'relaxation', 'contact_window', 'release_time'):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ConfigError(f'gravity.{name} is {value!r}; it wants a positive time [s]')
        for name in ('bias_walk', 'bias_prior', 'contact_floor'):
            pair = getattr(self, name)
            if len(pair) != 2 or not all(isfinite(x) and x >= 0 for x in pair):
                raise ConfigError(f'gravity.{name} is {pair!r}; '
                                  'it wants two numbers from 0 on [N], [N m]')
        if not 0 < self.false_alarm < 1:
            raise ConfigError(f'gravity.false_alarm is {self.false_alarm!r}; '
                              'it wants a probability between 0 and 1')


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

    Returns
    -------
    Covariances
    """
    return Covariances(np.diag([0.01] * 3 + [0.001] * 3), np.diag([0.1] * 3 + [0.01] * 3),
                       np.diag([1.0] * 3 + [0.1] * 3), PAPER_PERIOD)


def gain_of(rise_time: float, period: float) -> float:
    """Gain of a first-order filter with a 10-90 % rise [s] at a period [s]."""
    return 1 - exp(-log(9.0) * period / rise_time)


def load_noise(calibration: Calibration, alpha_std: float) -> Array:
    """
    Noise that the load brings: the accelerometer's, and that of the angular acceleration.

    The load is -m [1; c x] f_c and -I alpha, f_c = f + alpha x d at d from the accelerometer.

    Parameters
    ----------
    calibration : Calibration
    alpha_std : float
        Of the angular acceleration, per axis [rad/s^2].

    Returns
    -------
    ndarray, shape (6, 6)
    """
    m, c = float(calibration.mass), calibration.com.value
    by_force = -m * np.vstack([np.eye(3), skew(c)])
    accelerometer, noise = calibration.accelerometer, calibration.noise
    d = np.zeros(3)
    if accelerometer is not None and accelerometer.position is not None:
        d = c - accelerometer.position.value
    by_alpha = by_force @ -skew(d)
    if calibration.inertia is not None:
        by_alpha[3:] -= calibration.inertia.value
    cov = alpha_std ** 2 * by_alpha @ by_alpha.T
    if noise is not None and noise.specific_force is not None:
        cov += by_force @ noise.specific_force.value @ by_force.T
    return np.asarray(cov)


def measured_covariances(calibration: Calibration, rise_time: float,
                         alpha_std: float) -> Covariances:
    """
    Find Q, R and P0 from what was measured.

    R is the noise of the force sensor and of the load. Q = R k^2 / (1 - k) is the random walk
    whose stationary gain k gives the rise time, the same on all axes.

    Parameters
    ----------
    calibration : Calibration
    rise_time : float
        [s]
    alpha_std : float
        See :func:`load_noise`.

    Returns
    -------
    Covariances

    Raises
    ------
    ConfigError
        The calibration holds no noise.
    """
    noise = calibration.noise
    if noise is None or not noise.wrench_rate > 0:
        raise ConfigError('the calibration holds no noise.wrench with its rate, so R is unknown; '
                          'calibrate with a stretch at rest or set gravity.covariances: paper')
    R = noise.wrench.value + load_noise(calibration, alpha_std)
    k = gain_of(rise_time, 1 / noise.wrench_rate)
    return Covariances(R * k * k / (1 - k), R, R.copy(), 1 / noise.wrench_rate)
