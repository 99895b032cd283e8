"""A recording of any length as at most a few thousand blocks: means, noise, suspicious samples."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from forcecal_ros.checks import limits
from forcecal_ros.checks.clipping import Extreme
from forcecal_ros.checks.repeats import refuse_stuck
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled_for_numbers
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.streams import Stream
from forcecal_ros.insitu.prepare import Prepared
import numpy as np
from numpy.typing import NDArray

TINY = 1e-200
"""Least power that anything is divided by."""

Values = NDArray[Any]


class Tally(NamedTuple):
    """What is summed, counted or compared in each block; the first axis is the block."""

    start: Values
    end: Values
    step: Values
    sums: Values
    square: Values
    differences: Values
    low: Values
    high: Values
    at_low: Values
    at_high: Values
    low_again: Values
    high_again: Values
    still: Values


def usual_power(chunk: Prepared, samples: int) -> Array:
    """
    Return the usual power of the third differences of some blocks.

    Returns
    -------
    ndarray, shape (n + 3,)
        Of the raw channels and of gravity, in their units squared, summed over a block.
    """
    tally, *_ = tally_of(chunk, samples, np.ones(chunk.raw.shape[1] + 3))
    return np.asarray(np.maximum(np.median(tally.differences.astype(float), axis=0), TINY))


def tally_of(chunk: Prepared, samples: int, loudness: Array) -> tuple[Tally, Array, bool]:
    """
    Look at some blocks.

    Parameters
    ----------
    chunk : Prepared
        A whole number of blocks.
    samples : int
        In each block.
    loudness : ndarray, shape (n + 3,)
        By :func:`usual_power`.

    Returns
    -------
    Tally
    ndarray, shape (n + 3, n + 3)
        Covariance of the third differences, summed over the blocks, loud ones scaled down.
    bool
        Whether a raw channel or an axis of gravity is the same throughout any block.
    """
    t = chunk.t.reshape(-1, samples)
    blocks, n, m = len(t), chunk.raw.shape[1], chunk.regressors.shape[1]
    correlation = np.zeros((n + 3, n + 3))
    tally = Tally(
        t[:, 0].copy(), t[:, -1].copy(), _longest_steps(t),
        np.empty((blocks, m + n)), np.empty(blocks), np.empty((blocks, n + 3), np.float32),
        np.empty((blocks, n)), np.empty((blocks, n)),
        *(np.empty((blocks, n), np.int32) for _ in range(5)))
    stands = _tally_blocks(
        chunk.raw, chunk.regressors, samples,
        loudness, correlation, *tally[3:])
    return tally, correlation, stands


@compiled_for_numbers
def _longest_steps(t: Array) -> Array:
    """Return the longest step within each block, 0 where there is none."""
    longest = np.zeros(len(t))
    for b in range(len(t)):
        for i in range(1, t.shape[1]):
            longest[b] = max(longest[b], t[b, i] - t[b, i - 1])
    return longest


@compiled_for_numbers
def _tally_blocks(raw: Array, regressors: Array, samples: int, loudness: Array,
                  correlation: Array, sums: Array, square: Array, differences: Array,
                  low: Array, high: Array, at_low: Array, at_high: Array, low_again: Array,
                  high_again: Array, still: Array) -> bool:
    """Look at every sample of some blocks; fill what is given, see :class:`Tally`."""
    n, m, stands = raw.shape[1], regressors.shape[1], False
    x, rough = np.empty((n + m, samples)), np.empty((n + 3, max(samples - 3, 0)))
    ones = np.ones(samples)
    for b in range(len(sums)):
        _turn(regressors, b * samples, x[:m])
        _turn(raw, b * samples, x[m:])
        for k in range(m + n):
            sums[b, k] = _product(x[k], ones)
        square[b] = _product(x[0], x[0]) + _product(x[1], x[1]) + _product(x[2], x[2])
        for k in range(n):
            low[b, k], high[b, k] = _extremes(x[m + k])
            stands |= low[b, k] == high[b, k]
            (at_low[b, k], at_high[b, k], low_again[b, k], high_again[b, k],
             still[b, k]) = _repeats(x[m + k], low[b, k], high[b, k])
        for k in range(3):
            least, most = _extremes(x[k])
            stands |= least == most
        ratio = 0.0
        for k in range(n + 3):
            _third_differences(x[m + k if k < n else k - n], rough[k])
            differences[b, k] = _product(rough[k], rough[k])
            ratio += differences[b, k] / loudness[k] / (n + 3)
        _add_products(rough, 1.0 / max(ratio, TINY), correlation)
    return stands


@compiled_for_numbers
def _turn(rows: Array, start: int, columns: Array) -> None:
    """Lay some rows as columns, which are quicker to go along."""
    for i in range(columns.shape[1]):
        for k in range(len(columns)):
            columns[k, i] = rows[start + i, k]


@compiled_for_numbers
def _repeats(x: Array, low: float, high: float) -> tuple[int, int, int, int, int]:
    """Count samples at the extremes, those of them that repeat the one before, all that do."""
    at_low, at_high, low_again, high_again, still = x[0] == low, x[0] == high, 0, 0, 0
    for i in range(1, len(x)):
        again = x[i] == x[i - 1]
        at_low += x[i] == low
        at_high += x[i] == high
        low_again += again & (x[i] == low)
        high_again += again & (x[i] == high)
        still += again
    return at_low, at_high, low_again, high_again, still


@compiled_for_numbers
def _third_differences(x: Array, out: Array) -> None:
    for i in range(len(x) - 3):
        out[i] = x[i + 3] - x[i] - 3.0 * (x[i + 2] - x[i + 1])


@compiled_for_numbers
def _add_products(x: Array, weight: float, out: Array) -> None:
    """Add the weighted products of all rows, summed over the columns."""
    for k in range(len(x)):
        for j in range(k + 1):
            product = weight * _product(x[k], x[j])
            out[k, j] += product
            if j < k:
                out[j, k] += product


@compiled_for_numbers
def _product(x: Array, y: Array) -> float:
    total = 0.0
    for i in range(len(x)):
        total += x[i] * y[i]
    return total


@compiled_for_numbers
def _extremes(x: Array) -> tuple[float, float]:
    low = high = x[0]
    for i in range(len(x)):
        low, high = min(low, x[i]), max(high, x[i])
    return low, high


def joined(tallies: list[Tally]) -> Tally:
    """Put tallies behind one another."""
    return Tally(*(np.concatenate(arrays) for arrays in zip(*tallies)))


def merged(tally: Tally) -> Tally:
    """Merge blocks in pairs; an odd one at the end is given up."""
    a, b = (Tally(*(array[i:len(tally.start) // 2 * 2:2] for array in tally)) for i in (0, 1))
    step = np.maximum(np.maximum(a.step, b.step), b.start - a.end)
    low, high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
    a_low, b_low, a_high, b_high = a.low == low, b.low == low, a.high == high, b.high == high
    return Tally(
        a.start, b.end, step, a.sums + b.sums, a.square + b.square,
        a.differences + b.differences, low, high,
        a.at_low * a_low + b.at_low * b_low, a.at_high * a_high + b.at_high * b_high,
        a.low_again * a_low + b.low_again * b_low, a.high_again * a_high + b.high_again * b_high,
        a.still + b.still)


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
    least = np.where(alike > IN_STEPS, limits.CLIPPED_IN_STEPS, limits.CLIPPED)
    clipped = np.zeros(tally.low.shape, dtype=bool)
    for extreme, count, again, end in (
            (tally.low, tally.at_low, tally.low_again, tally.low.min(axis=0)),
            (tally.high, tally.at_high, tally.high_again, tally.high.max(axis=0))):
        at_end = extreme == end
        often, repeated = (np.where(at_end, x, 0).sum(axis=0) for x in (count, again))
        stops = [Extreme(int(n), int(m)).is_limit(k) for n, m, k in zip(often, repeated, least)]
        clipped |= at_end & np.array(stops) & (alike < 0.5)
    return clipped
