"""A recording of any length as at most a few thousand blocks: means, noise, suspicious samples."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from forcecal_ros.checks.signals import CLIPPED, CLIPPED_IN_STEPS, Extreme, refuse_stuck
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.streams import Stream
from forcecal_ros.insitu.prepare import Prepared
from forcecal_ros.insitu.tally import joined, merged, Tally, tally_of, TINY, usual_power
import numpy as np
from numpy.typing import NDArray

BLOCK = 0.25
"""Length of a block [s], doubled as often as :data:`MOST_BLOCKS` wants."""
MOST_BLOCKS = 65536
GAP = 5.0
"""A step of the stamps longer than this many median periods is a gap."""
FLOOR = 1e-4
"""
No channel is taken to be less noisy than this share of its span over the recording, and not less
than rounding makes it, the step of its counts over the root of 12.
"""
IN_STEPS = 0.05
"""A channel comes in steps if that share of its samples repeats the one before."""
BEFORE = 4096
"""So many samples before a piece tell what its channels do when they do not stick."""

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
        Mean of |g|^2 over the samples, noise taken off [(m/s^2)^2].
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


def to_blocks(chunks: Iterable[Prepared], window: tuple[float, float] | None = None,
              poses: bool = False) -> Blocks:
    """
    Reduce a recording to blocks in one pass and constant memory.

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
    tallies: list[Tally] = []
    correlation: Array = np.zeros(())
    loudness: Array | None = None
    held: Prepared | None = None
    before: Prepared | None = None
    samples, period = 0, float('nan')
    for chunk in chunks:
        held = chunk if held is None or not len(held.t) else Prepared(
            *(np.concatenate(pair) for pair in zip(held, chunk)))
        if not samples:
            if len(held.t) < 3:
                continue
            period = float(np.median(np.diff(held.t[:100_000])))
            samples = 1 if poses else max(1, round(BLOCK / period))
        whole = len(held.t) // samples
        if whole:
            chunk = held.take(slice(whole * samples))
            if loudness is None:
                loudness = usual_power(chunk, samples)
            tally, covariance, stands = tally_of(chunk, samples, loudness)
            tallies.append(tally)
            if samples > 1 and stands:
                _refuse_stuck(before, chunk, window)
            before = chunk.take(slice(-BEFORE, None))
            correlation = correlation + covariance
            held = held.take(slice(whole * samples, None))
        if sum(len(tally.start) for tally in tallies) > MOST_BLOCKS:
            tallies = [merged(joined(tallies))]
            samples *= 2
    if not tallies:
        if held is None:
            raise DataError('there are no samples in it; look at its file')
        raise DataError(f'{len(held.t)} samples are too few for one block '
                        f'of {BLOCK:g} s; is the time in seconds?')
    return _finish(joined(tallies), samples, period, correlation)


def _refuse_stuck(before: Prepared | None, chunk: Prepared, window: tuple[float, float] | None
                  ) -> None:
    """Look closer where a channel or the accelerometer repeats itself for a whole block."""
    both = [chunk] if before is None else [before, chunk]
    t = np.concatenate([one.t for one in both])
    for name, channels, values in (
            ('the sensor', [f'channel {k + 1}' for k in range(chunk.raw.shape[1])],
             np.concatenate([one.raw for one in both])),
            ('accelerometer', [f'gravity along {axis}' for axis in 'xyz'],
             np.concatenate([one.regressors[:, :3] for one in both]))):
        used = Stream(t, values) if window is None else Stream(t, values).between(*window)
        if len(used) > 1:
            refuse_stuck(used, name, channels)


def _finish(tally: Tally, samples: int, period: float, correlation: Array) -> Blocks:
    n = tally.low.shape[1]
    means = tally.sums / samples
    noise, roughness = _noise(tally, samples, n, correlation)
    before = np.concatenate([[period], tally.start[1:] - tally.end[:-1]])
    return Blocks(
        samples, period, tally.start, tally.end, means[:, :-n], means[:, -n:],
        tally.square / samples - np.trace(noise[n:, n:]), noise[:n, :n], noise[n:, n:], roughness,
        np.maximum(tally.step, before) > GAP * period, _clipped(tally, samples))


def _noise(tally: Tally, samples: int, n: int, correlation: Array) -> tuple[Array, Array]:
    """Return the noise covariance of raw and gravity, and the roughness of each block."""
    extremes = np.concatenate([tally.low, tally.high])
    floor = np.append(np.maximum((FLOOR * np.ptp(extremes, axis=0)) ** 2,
                                 [_step(column) ** 2 / 12 for column in extremes.T]), np.zeros(3))
    power = tally.differences.astype(float) / max(1, difference_gain(3) * (samples - 3))
    level = np.maximum(power, floor)
    typical = np.maximum(np.median(level, axis=0), TINY)
    roughness = np.sqrt((level[:, :n] / typical[:n]).mean(axis=1))
    quiet = roughness <= np.median(roughness) * 1.5
    size = np.sqrt(power[quiet].mean(axis=0))
    scale = np.sqrt(np.maximum(np.diag(correlation), TINY))
    return correlation * np.outer(size / scale, size / scale) + np.diag(floor), roughness


def _step(values: Array) -> float:
    """Smallest step between values: that of the counts, or next to nothing where there is none."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if len(steps) else 0.0


def _clipped(tally: Tally, samples: int) -> Mask:
    """
    Find where channels stop at a limit.

    One whose neighbouring samples are alike in most blocks repeats its extreme as any other value.
    """
    alike = np.median(tally.still, axis=0) / max(1, samples - 1)
    least = np.where(alike > IN_STEPS, CLIPPED_IN_STEPS, CLIPPED)
    clipped = np.zeros(tally.low.shape, dtype=bool)
    for extreme, count, again, end in (
            (tally.low, tally.at_low, tally.low_again, tally.low.min(axis=0)),
            (tally.high, tally.at_high, tally.high_again, tally.high.max(axis=0))):
        at_end = extreme == end
        often, repeated = (np.where(at_end, x, 0).sum(axis=0) for x in (count, again))
        stops = [Extreme(int(n), int(m)).is_limit(k) for n, m, k in zip(often, repeated, least)]
        clipped |= at_end & np.array(stops) & (alike < 0.5)
    return clipped
