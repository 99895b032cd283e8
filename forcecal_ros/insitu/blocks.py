"""A recording of any length as at most a few thousand blocks: means, noise, suspicious samples."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.insitu.prepare import Prepared
import numpy as np
from numpy.typing import NDArray

BLOCK = 0.25
"""Length of a block [s], doubled as often as :data:`MOST_BLOCKS` wants."""
MOST_BLOCKS = 4096
GAP = 5.0
"""A step of the stamps longer than this many median periods is a gap."""
FLOOR = 1e-4
"""No channel is taken to be less noisy than this share of its span over the recording."""

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
    raw_noise: Array
    gravity_noise: Array
    roughness: Array
    gap: Mask
    clipped: Mask

    def __len__(self) -> int:
        return len(self.start)

    @property
    def gravity_norm(self) -> Array:
        """Norm of the mean of the first three regressors, shape (b,) [m/s^2]."""
        return np.asarray(np.linalg.norm(self.regressors[:, :3], axis=1))


class _Tally(NamedTuple):
    """What is summed, counted or compared in each block; the first axis is the block."""

    start: Array
    end: Array
    step: Array
    sums: Array
    differences: Array
    low: Array
    high: Array
    at_low: Array
    at_high: Array
    still: Array


def to_blocks(pieces: Iterable[Prepared]) -> Blocks:
    """
    Reduce a recording to blocks in one pass and constant memory.

    Parameters
    ----------
    pieces : iterable of Prepared

    Returns
    -------
    Blocks

    Raises
    ------
    DataError
        There are fewer samples than a block has.
    """
    tallies: list[_Tally] = []
    held: Prepared | None = None
    samples, period = 0, float('nan')
    for piece in pieces:
        held = piece if held is None else Prepared(
            *(np.concatenate(pair) for pair in zip(held, piece)))
        if not samples:
            if len(held.t) < 3:
                continue
            period = float(np.median(np.diff(held.t[:100_000])))
            samples = max(1, round(BLOCK / period))
        whole = len(held.t) // samples
        if whole:
            tallies.append(_tally(held.take(slice(whole * samples)), samples))
            held = held.take(slice(whole * samples, None))
        if sum(len(tally.start) for tally in tallies) > MOST_BLOCKS:
            tallies = [_merge(_join(tallies))]
            samples *= 2
    if not tallies:
        raise DataError(f'{0 if held is None else len(held.t)} samples are too few for one block '
                        f'of {BLOCK:g} s; is the time in seconds?')
    return _finish(_join(tallies), samples, period)


def _tally(piece: Prepared, samples: int) -> _Tally:
    t = piece.t.reshape(-1, samples)
    raw = piece.raw.reshape(len(t), samples, -1)
    regressors = piece.regressors.reshape(len(t), samples, -1)
    rough = np.diff(np.concatenate([raw, regressors[..., :3]], axis=2), 3, axis=1)
    low, high = raw.min(axis=1), raw.max(axis=1)
    return _Tally(
        t[:, 0], t[:, -1], np.diff(t, axis=1).max(axis=1, initial=0.0),
        np.concatenate([regressors, raw], axis=2).sum(axis=1),
        np.einsum('bsi,bsj->bij', rough, rough), low, high,
        (raw == low[:, None]).sum(axis=1), (raw == high[:, None]).sum(axis=1),
        (np.diff(raw, axis=1) == 0).sum(axis=1))


def _join(tallies: list[_Tally]) -> _Tally:
    return _Tally(*(np.concatenate(arrays) for arrays in zip(*tallies)))


def _merge(tally: _Tally) -> _Tally:
    """Merge blocks in pairs; an odd one at the end is given up."""
    a, b = (_Tally(*(array[i:len(tally.start) // 2 * 2:2] for array in tally)) for i in (0, 1))
    step = np.maximum(np.maximum(a.step, b.step), b.start - a.end)
    low, high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
    return _Tally(
        a.start, b.end, step, a.sums + b.sums, a.differences + b.differences, low, high,
        a.at_low * (a.low == low) + b.at_low * (b.low == low),
        a.at_high * (a.high == high) + b.at_high * (b.high == high), a.still + b.still)


def _finish(tally: _Tally, samples: int, period: float) -> Blocks:
    n = tally.low.shape[1]
    means = tally.sums / samples
    noise, roughness = _noise(tally, samples, n)
    before = np.concatenate([[period], tally.start[1:] - tally.end[:-1]])
    return Blocks(
        samples, period, tally.start, tally.end, means[:, :-n], means[:, -n:],
        noise[:n, :n], noise[n:, n:], roughness,
        np.maximum(tally.step, before) > GAP * period, _clipped(tally, samples))


def _noise(tally: _Tally, samples: int, n: int) -> tuple[Array, Array]:
    """Return the noise covariance of raw and gravity, and the roughness of each block."""
    span = np.append(np.ptp(np.concatenate([tally.low, tally.high]), axis=0), np.zeros(3))
    floor = np.diag((FLOOR * span) ** 2)
    per_block = tally.differences / max(1, 20 * (samples - 3))
    level = np.maximum(np.einsum('bii->bi', per_block), np.diag(floor))
    typical = np.maximum(np.median(level, axis=0), np.finfo(float).tiny)
    roughness = np.sqrt((level[:, :n] / typical[:n]).mean(axis=1))
    quiet = roughness <= np.median(roughness) * 1.5
    return per_block[quiet].mean(axis=0) + floor, roughness


def _clipped(tally: _Tally, samples: int) -> Mask:
    """
    Find channels that sit at their extreme while elsewhere they are noisy.

    A channel is clipped where its samples at the recording's extreme stand still, five in a block
    at least, although its neighbours differ in most blocks.
    """
    lively = np.median(tally.still, axis=0) < 0.5 * (samples - 1)
    clipped = np.zeros(tally.low.shape, dtype=bool)
    for extreme, count, end in ((tally.low, tally.at_low, tally.low.min(axis=0)),
                                (tally.high, tally.at_high, tally.high.max(axis=0))):
        at_end = extreme == end
        stuck = at_end & (count >= 5) & (tally.still >= 4)
        clipped |= at_end & stuck.any(axis=0) & lively
    return clipped
