"""From readings of the devices to the regressors and raw channels that all else works on."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled
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

    def take(self, rows: slice | Array) -> 'Prepared':
        """Return some of the samples."""
        return Prepared(self.t[rows], self.regressors[rows], self.raw[rows])


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
        return _gravity(specific_force, self.R_sensor_accelerometer, self.gravity_offset)

    def shifted(self, gravity_offset: Array) -> 'Mounting':
        """Return the same with a further offset to take off."""
        return replace(self, gravity_offset=self.gravity_offset + gravity_offset)


@compiled
def _gravity(force: Array, R: Array, offset: Array) -> Array:
    """Return -force @ R.T - offset; of three columns faster by loop than by matrix products."""
    gravity = np.empty((len(force), 3))
    for i in range(len(force)):
        for k in range(3):
            gravity[i, k] = -offset[k] - (
                force[i, 0] * R[k, 0] + force[i, 1] * R[k, 1] + force[i, 2] * R[k, 2])
    return gravity


def prepare(chunks: Iterable[Chunk], mounting: Mounting, moving: bool) -> Iterator[Prepared]:
    """
    Turn a recording into regressors and raw channels, chunk by chunk.

    Parameters
    ----------
    moving : bool
        Use the gyro: thirteen regressors instead of three.

    Raises
    ------
    DataError
        Motion was asked for and a chunk has no gyro.
    """
    if moving:
        yield from _prepare_moving(chunks, mounting)
        return
    for chunk in chunks:
        yield Prepared(chunk.t, mounting.gravity(chunk.accelerometer), chunk.raw)


def _prepare_moving(chunks: Iterable[Chunk], mounting: Mounting) -> Iterator[Prepared]:
    """Smooth and differentiate the gyro; half a window is lost at each end of the recording."""
    R = mounting.R_sensor_accelerometer
    held: Chunk | None = None
    for chunk in chunks:
        if chunk.gyro is None:
            raise DataError('motion needs an angular rate; name the gyro in the SPEC')
        held = chunk if held is None else _join(held, chunk)
        if len(held.t) < 2:
            continue
        period = float(np.median(np.diff(held.t)))
        half = max(2, round(GYRO_WINDOW / period / 2))
        window = 2 * half + 1
        if len(held.t) < window + 1:
            continue
        assert held.gyro is not None
        rate = held.gyro @ R.T
        omega, alpha = (_differentiate(rate, window, period, order) for order in (0, 1))
        gravity = mounting.gravity(held.accelerometer[half:-half])
        yield Prepared(held.t[half:-half],
                       moving_regressors(gravity, omega, alpha, mounting.position),
                       held.raw[half:-half])
        held = Chunk(*(array[1 - window:] for array in (
            held.t, held.raw, held.accelerometer, held.gyro)))


def _differentiate(values: Array, window: int, period: float, order: int) -> Array:
    taps = signal.savgol_coeffs(window, GYRO_ORDER, deriv=order, delta=period)
    return np.asarray(signal.oaconvolve(values, taps[:, None], mode='valid', axes=0))


def _join(first: Chunk, second: Chunk) -> Chunk:
    assert first.gyro is not None and second.gyro is not None
    return Chunk(*(np.concatenate(pair) for pair in (
        (first.t, second.t), (first.raw, second.raw),
        (first.accelerometer, second.accelerometer), (first.gyro, second.gyro))))
