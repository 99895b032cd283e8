"""From readings of the devices to regressors, and to at most some thousand blocks of them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from forcecal_ros.checks.signals import limits_of, refuse_stuck, resolution
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.streams import Stream
from forcecal_ros.insitu.equations import moving_regressors
import numpy as np
from numpy.typing import NDArray
from scipy import signal


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


Source = Callable[[], Chunk]
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
        """Return the same with a further offset to subtract."""
        return replace(self, gravity_offset=self.gravity_offset + gravity_offset)


def prepare(chunk: Chunk, mounting: Mounting, moving: bool) -> Prepared:
    """
    Turn a recording into regressors and raw channels.

    Parameters
    ----------
    moving : bool
        Use the gyro: thirteen regressors instead of three; half a window is lost at each end.

    Raises
    ------
    DataError
        There are no samples, or motion was requested and there is no gyro.
    """
    t, raw, accelerometer, gyro = chunk
    if not len(t):
        raise DataError('it has no samples; check its file')
    gravity = mounting.gravity(accelerometer)
    if not moving:
        return Prepared(t, gravity, raw)
    if gyro is None:
        raise DataError('motion: on requires the angular rate; add accelerometer.gyro to the SPEC')
    period = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    # window over which the angular rate is smoothed and differentiated, by a cubic [s]
    seconds = 0.21
    half = max(2, round(seconds / period / 2))
    if len(t) < 2 * half + 2:
        raise DataError(f'{len(t)} samples are too few to differentiate the angular rate')
    inside, rate = slice(half, -half), gyro @ mounting.R_sensor_accelerometer.T
    omega, alpha = (signal.savgol_filter(rate, 2 * half + 1, 3, order, period, axis=0)[inside]
                    for order in (0, 1))
    return Prepared(t[inside], moving_regressors(gravity[inside], omega, alpha, mounting.position),
                    raw[inside])


TINY = 1e-200
"""Least power that anything is divided by."""

BLOCK = 0.25
"""Length of a block [s], doubled as often as :data:`MOST_BLOCKS` requires."""
MOST_BLOCKS = 65536

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Blocks:
    """
    Consecutive stretches of equally many samples.

    Attributes
    ----------
    samples : int
        In each block.
    period : float
        Between samples, median [s].
    start, end : ndarray, shape (b,)
        Stamps of the first and last sample [s].
    regressors, raw : ndarray, shape (b, m), (b, n)
        Means.
    square : ndarray, shape (b,)
        Mean of |g|^2 over the samples, noise subtracted [(m/s^2)^2].
    raw_noise, gravity_noise : ndarray, shape (n, n), (3, 3)
        Covariance of a sample's white noise, from third differences in quiet blocks.
    roughness : ndarray, shape (b,)
        RMS over raw channels of the third differences, over that of a quiet block.
    gap : ndarray of bool, shape (b,)
        A step of the stamps within the block or right before it is too long.
    clipped : ndarray of bool, shape (b, n)
        The channel sits at its extreme.
    """

    samples: int
    period: float
    start: Array
    end: Array
    regressors: Array
    raw: Array
    square: Array
    raw_noise: Array
    gravity_noise: Array
    roughness: Array
    gap: Mask
    clipped: Mask

    def __len__(self) -> int:
        return len(self.start)

    @property
    def length(self) -> float:
        """Length of a block [s]."""
        return self.samples * self.period

    @property
    def gravity_norm(self) -> Array:
        """Magnitude of measured gravity, shape (b,) [m/s^2]."""
        return np.sqrt(np.maximum(self.square, 0.0))

    def levelled(self, offset: Array) -> 'Blocks':
        """Take an offset (3,) off measured gravity."""
        regressors = self.regressors.copy()
        regressors[:, :3] -= offset
        square = self.square - 2 * self.regressors[:, :3] @ offset + offset @ offset
        return replace(self, regressors=regressors, square=square)

    def of_magnitude(self, magnitude: float) -> 'Blocks':
        """Scale measured gravity to a magnitude [m/s^2]."""
        regressors = self.regressors.copy()
        regressors[:, :3] *= (magnitude / self.gravity_norm)[:, None]
        return replace(self, regressors=regressors,
                       square=np.full(len(self), magnitude ** 2))


def to_blocks(recording: Prepared, window: tuple[float, float] | None = None,
              poses: bool = False) -> Blocks:
    """
    Reduce a recording to blocks.

    Parameters
    ----------
    window : (float, float) or None
        In which no channel may stick [s]; None: anywhere.
    poses : bool
        Every sample is a block of its own.

    Raises
    ------
    DataError
        There are fewer samples than a block has, or a channel sticks.
    """
    t = recording.t
    period = float(np.median(np.diff(t[:100_000]))) if len(t) > 2 else np.inf
    samples = 1 if poses and len(t) > 2 else max(1, round(min(BLOCK / period, 1e9)))
    while len(t) // samples > MOST_BLOCKS:
        samples *= 2
    count = len(t) // samples
    if len(t) < 3 or not count:
        raise DataError(f'{len(t)} samples are too few for one block of {BLOCK:g} s; check the '
                        'unit of time')
    n = recording.raw.shape[1]
    at_a_time = max(1, 16384 // samples)
    parts, correlation, loudness = [], np.zeros(()), np.zeros(())
    for start in range(0, count, at_a_time):
        part = slice(start * samples, min(count, start + at_a_time) * samples)
        x = np.vstack([recording.regressors[part].T, recording.raw[part].T])
        x = x.reshape(len(x), -1, samples)
        both = np.concatenate([x[-n:], x[:3]])
        rough = both[..., 3:] - both[..., :-3] - 3.0 * (both[..., 2:-1] - both[..., 1:-2])
        power = (rough ** 2).sum(axis=2).T
        parts.append((x.mean(axis=2).T, (x[:3] ** 2).sum(axis=0).mean(axis=1), power,
                      (both[..., 1:] == both[..., :-1]).all(axis=2).T))
        if not start:
            loudness = np.maximum(np.median(power, axis=0), TINY)
        ratio = np.maximum((power / loudness).mean(axis=1), TINY)
        loud = (rough / ratio[:, None]).reshape(len(rough), -1)
        correlation = correlation + loud @ rough.reshape(len(rough), -1).T
    means, square, power, stands = (np.concatenate(arrays) for arrays in zip(*parts))
    if samples > 1 and stands.any():
        _refuse_stuck(recording, window)
    whole = count * samples
    noise, roughness = _noise(recording.raw[:whole], power, samples, correlation)
    clipped = np.array([np.isin(column[:whole], limits_of(column)) for column in recording.raw.T])
    stamps = t[:whole].reshape(count, samples)
    steps = np.diff(t[:whole], prepend=t[0] - period).reshape(count, samples)
    # a step of the stamps longer than this many median periods is a gap
    gap = 5.0
    return Blocks(
        samples, period, stamps[:, 0].copy(), stamps[:, -1].copy(), means[:, :-n],
        means[:, -n:], square - np.trace(noise[n:, n:]), noise[:n, :n], noise[n:, n:], roughness,
        steps.max(axis=1) > gap * period, clipped.reshape(n, count, samples).any(axis=2).T)


def _refuse_stuck(recording: Prepared, window: tuple[float, float] | None) -> None:
    """Look closer where a channel or the accelerometer repeats itself for a whole block."""
    n = recording.raw.shape[1]
    for name, channels, values in (
            ('the sensor', [f'channel {k + 1}' for k in range(n)], recording.raw),
            ('accelerometer', [f'gravity along {axis}' for axis in 'xyz'],
             recording.regressors[:, :3])):
        stream = Stream(recording.t, values)
        used = stream if window is None else stream.between(*window)
        if len(used) > 1:
            refuse_stuck(used, name, channels)


def _noise(raw: Array, power: Array, samples: int, correlation: Array) -> tuple[Array, Array]:
    """
    Return the noise covariance of raw and gravity, and the roughness of each block.

    ``power`` (b, n + 3) is that of the third differences of raw channels and gravity in a block,
    ``correlation`` (n + 3, n + 3) that between them, loud blocks weighted down.
    """
    n = raw.shape[1]
    some = raw[::max(1, len(raw) // 100_000)]  # steps of counts show in these already
    # no channel is taken to be less noisy than this share of its span over the recording, and not
    # less than rounding makes it, the step of its counts over the root of 12
    least = 1e-4
    floor = np.append(np.maximum((least * np.ptp(raw, axis=0)) ** 2, [
        resolution(column) ** 2 / 12 for column in some.T]), np.zeros(3))
    power = power / max(1, difference_gain(3) * (samples - 3))
    level = np.maximum(power, floor)
    typical = np.maximum(np.median(level, axis=0), TINY)
    roughness = np.sqrt((level[:, :n] / typical[:n]).mean(axis=1))
    quiet = roughness <= np.median(roughness) * 1.5
    size = np.sqrt(power[quiet].mean(axis=0))
    scale = np.sqrt(np.maximum(np.diag(correlation), TINY))
    return correlation * np.outer(size / scale, size / scale) + np.diag(floor), roughness
