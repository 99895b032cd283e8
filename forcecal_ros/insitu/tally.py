"""Blocks of samples, looked at once: sums, extremes, repeats and third differences of each."""

from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled_for_numbers
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
