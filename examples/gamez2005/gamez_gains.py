"""The observer gains that [Gamez2005] prints, no calibration is made of them."""

from dataclasses import replace
from math import sqrt
from typing import NamedTuple

from forcecal_ros.calibrate.gain import error_dynamics, observer_model
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
import numpy as np

PRINTED = {
    'acc1': np.array([[0.0400, 0.0006, -0.0073], [0.1000, 0.0001, 1.0000]]),
    'acc2': np.array([[0.0600, 0.0002, -0.0012], [0.2250, -0.0002, 1.0000]]),
}
"""K1 and K2 of [Gamez2005] Eq. 32 and 33, by accelerometer."""

PERIOD = 0.004
"""
Sample time of the paper's observer, which it does not print [s].

At 4 ms, k11 and k21 of K1 and K2 are to the last digit those of double poles at 5.0 and 7.5 rad/s
(0.04 = 2 x 5.0 x 4 ms, 0.1 = 5.0^2 x 4 ms, and so on), critically damped. Taken as continuous
gains the same numbers would ring for minutes.
"""


class Poles(NamedTuple):
    """Natural frequency [rad/s] and damping ratio of the observer's error."""

    frequency: float
    damping: float


def continuous(K: Array) -> Array:
    """
    Return a printed gain (2, 3) per second.

    It is printed per ``PERIOD`` but for its last column, which no dynamics depend on.
    """
    return np.column_stack([K[:, :2] / PERIOD, K[:, 2]])


def error_poles(K: Array) -> Poles:
    """Return the poles of the error dynamics, [Gamez2005] Eq. 4, of a continuous gain (2, 3)."""
    matrix, _ = error_dynamics(observer_model(1.0), K)
    frequency = sqrt(float(np.linalg.det(matrix)))
    return Poles(frequency, -float(np.trace(matrix)) / (2.0 * frequency))


def with_printed_gain(calibration: Calibration, accelerometer: str) -> Calibration:
    """
    Return the calibration with the paper's gain, [Gamez2005] Eq. 32 and 33, per second.

    Parameters
    ----------
    calibration : Calibration
        With an observer's gain.
    accelerometer : str
        ``acc1`` (K1) or ``acc2`` (K2).

    Raises
    ------
    ConfigError
        The calibration holds no gain to be replaced.
    """
    if calibration.observer is None:
        raise ConfigError('the calibration holds no observer.K; calibrate with a step')
    K = replace(calibration.observer.K, value=continuous(PRINTED[accelerometer]))
    return replace(calibration, observer=replace(calibration.observer, K=K))
