"""From readings of the devices to the regressors and raw channels that all else works on."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.equations import moving_regressors
import numpy as np
from scipy import signal

GYRO_WINDOW = 0.21
"""Window over which the angular rate is smoothed and differentiated [s]."""

GYRO_ORDER = 3
"""Order of the polynomial by which it is."""


class Chunk(NamedTuple):
    """
    Consecutive samples as the devices sent them, in SI units, each in its own axes.

    ``t`` (n,) [s], ``raw`` (n, k) channels, ``accelerometer`` (n, 3) specific force [m/s^2],
    ``gyro`` (n, 3) [rad/s] or None.
    """

    t: Array
    raw: Array
    accelerometer: Array
    gyro: Array | None


class Prepared(NamedTuple):
    """``t`` (n,) [s], ``regressors`` (n, 3 or 13) in the sensor frame, ``raw`` (n, k)."""

    t: Array
    regressors: Array
    raw: Array


Source = Callable[[], Iterable[Chunk]]
"""Reads a recording from its beginning, every time it is called."""


@dataclass(frozen=True)
class Mounting:
    """
    Where the accelerometer sits.

    Attributes
    ----------
    R_sensor_accelerometer : ndarray, shape (3, 3)
        Identity where the accelerometer's frame serves as the sensor's.
    position : ndarray, shape (3,)
        Of the accelerometer in the sensor frame [m]; matters in motion only.
    gravity_offset : ndarray, shape (3,)
        What measured gravity is off by, in the sensor frame [m/s^2].
    """

    R_sensor_accelerometer: Array = field(default_factory=lambda: np.eye(3))
    position: Array = field(default_factory=lambda: np.zeros(3))
    gravity_offset: Array = field(default_factory=lambda: np.zeros(3))

    def gravity(self, specific_force: Array) -> Array:
        """Gravity in the sensor frame from specific force (n, 3) in the accelerometer's."""
        return np.asarray(-specific_force @ self.R_sensor_accelerometer.T - self.gravity_offset)

    def shifted(self, gravity_offset: Array) -> 'Mounting':
        """Return the same with a further offset to take off."""
        return replace(self, gravity_offset=self.gravity_offset + gravity_offset)


def prepare(chunks: Iterable[Chunk], mounting: Mounting, moving: bool) -> Prepared:
    """
    Turn a recording into regressors and raw channels.

    Parameters
    ----------
    moving : bool
        Use the gyro: thirteen regressors instead of three; half a window is lost at each end.

    Raises
    ------
    DataError
        There are no samples, or motion was asked for and there is no gyro.
    """
    t, raw, accelerometer, gyro = _joined(chunks)
    gravity = mounting.gravity(accelerometer)
    if not moving:
        return Prepared(t, gravity, raw)
    if gyro is None:
        raise DataError('motion needs an angular rate; name the gyro in the SPEC')
    period = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    half = max(2, round(GYRO_WINDOW / period / 2))
    if len(t) < 2 * half + 2:
        raise DataError(f'{len(t)} samples are too few to differentiate the angular rate')
    rate = gyro @ mounting.R_sensor_accelerometer.T
    omega, alpha = (_differentiate(rate, 2 * half + 1, period, order) for order in (0, 1))
    inside = slice(half, -half)
    return Prepared(t[inside], moving_regressors(gravity[inside], omega, alpha, mounting.position),
                    raw[inside])


def _joined(chunks: Iterable[Chunk]) -> Chunk:
    parts = list(chunks)
    if not parts:
        raise DataError('there are no samples in it; look at its file')
    gyros = [one.gyro for one in parts if one.gyro is not None]
    t, raw, accelerometer = (np.concatenate(arrays).astype(float, copy=False)
                             for arrays in list(zip(*parts))[:3])
    return Chunk(t, raw, accelerometer, np.concatenate(gyros) if gyros else None)


def _differentiate(values: Array, window: int, period: float, order: int) -> Array:
    taps = signal.savgol_coeffs(window, GYRO_ORDER, deriv=order, delta=period)
    return np.asarray(signal.oaconvolve(values, taps[:, None], mode='valid', axes=0))
