"""Standard errors that hold when residuals are correlated in time.

The filter correlates neighbouring samples, and so do hysteresis, flex and what else the model
leaves out. Residuals are therefore taken of block means of the unfiltered recording, each stretch
of some seconds under the fit to all other stretches, so that what a stretch bends the fit by is
not lost. The covariance of every weighted sum of them is built from their autocovariance. Weights
are the regressors as the filter leaves them: motion about as fast as its window is less there.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import (
    andrews_lags,
    Autocovariance,
    noise_of_residuals,
)
from forcecal_ros.insitu.blocks import Blocks, Mask
from forcecal_ros.insitu.moments import Moments
from forcecal_ros.insitu.smoothing import gathered, smooth
import numpy as np
from numpy.typing import NDArray

STRETCH = 6.0
"""Length of the stretches that are held out, at most a fifth of what is used [s]."""

MOST_STRETCHES = 200
"""Number of stretches at most: those of longer recordings are longer."""

NOTHING = 1e-9
"""Share of a constant that is taken for rounding: in motion the constant is a regressor itself."""


class Sums(NamedTuple):
    """Least-squares sums of blocks: of [1, weights] with itself (u, u) and with raw (u, n)."""

    normal: Array
    right: Array

    @property
    def weight(self) -> float:
        """What the blocks know of a constant beside the regressors, in blocks."""
        s, G = self.normal[0, 1:], self.normal[1:, 1:]
        weight = self.normal[0, 0] - s @ np.linalg.lstsq(G, s, rcond=None)[0]
        return float(weight) if weight > NOTHING * self.normal[0, 0] else 0.0

    @property
    def weighted_constant(self) -> Array:
        """The constant times its weight, shape (n,)."""
        s, G = self.normal[0, 1:], self.normal[1:, 1:]
        return np.asarray(self.right[0] - s @ np.linalg.lstsq(G, self.right[1:], rcond=None)[0])

    def slopes(self, constant: Array) -> Array:
        """Coefficients of the weights beside a given constant, shape (u - 1, n)."""
        right = self.right[1:] - np.outer(self.normal[1:, 0], constant)
        return np.linalg.lstsq(self.normal[1:, 1:], right, rcond=None)[0]


class Residual(NamedTuple):
    """
    Held-out residual of one data set.

    ``regressors`` (b, 1 + q) constant and pseudo-sample weights, filtered twice, zero where a
    block is not used; ``samples`` in a block; ``noise`` of the block means.
    """

    regressors: Array
    samples: int
    noise: Autocovariance

    @property
    def long_run(self) -> Array:
        """Covariance of a sample that correlation makes of it, shape (n, n)."""
        return self.noise.long_run * self.samples


def residuals(data_sets: Sequence[tuple[Moments, Blocks, Mask]], seconds: float, order: int
              ) -> list[Residual]:
    """
    Hold out stretch after stretch: its residuals under the fit to all others.

    Parameters
    ----------
    seconds : float
        Window of the filter that the moments are of; 0: none [s].
    order : int
        Of its polynomial.
    """
    x = [np.where(use[:, None], _regressors(moments, blocks), 0.0)
         for moments, blocks, use in data_sets]
    sums = [_sums(one, blocks.raw) for one, (_, blocks, _) in zip(x, data_sets)]
    weight = sum(one.weight for one in sums)
    constant = np.sum([one.weighted_constant for one in sums], axis=0)
    out = []
    for one, total, (_, blocks, use) in zip(x, sums, data_sets):
        held_out = np.zeros_like(blocks.raw)
        for part in _stretches(blocks, use):
            own = _sums(one[part], blocks.raw[part])
            others = Sums(total.normal - own.normal, total.right - own.right)
            offset = _divide(constant - total.weighted_constant + others.weighted_constant,
                             weight - total.weight + others.weight)
            held_out[part] = blocks.raw[part] - offset - one[part, 1:] @ others.slopes(offset)
        window = round(seconds / blocks.length / 2) * 2 + 1
        out.append(_residual(_as_filtered(one, use, window, order), held_out, blocks.samples))
    return out


def _as_filtered(x: Array, use: Mask, window: int, order: int) -> Array:
    """
    Filter regressors twice, run by run: sum (S x)(S r) is sum (S' S x) r.

    ``window`` is in blocks; one that holds no more than the polynomial changes nothing.
    """
    if window <= order + 1:
        return x
    out = np.zeros_like(x)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], use, [False]]).astype(int)))
    for start, end in ends.reshape(-1, 2):
        smoothed = [part.values for part in smooth([x[start:end]], window, order)]
        out[start:end] = gathered(np.concatenate(smoothed), window, order)
    return out


def doubt_covariance(data_sets: Sequence[tuple[Moments, Blocks, Mask]],
                     doubts: Sequence[Sequence[tuple[Mask, Mask]]]) -> Array:
    """
    Say what found ends of windows, which may lie further in or out, add to the covariance.

    Parameters
    ----------
    doubts : sequence of sequence of (ndarray of bool, ndarray of bool)
        Of every data set, the narrower and the wider choice of blocks at each found end.

    Returns
    -------
    ndarray
        Of [offset, raw pseudo-samples of every data set].
    """
    def numbers(sums: Sequence[Sums]) -> Array:
        offset = _divide(np.sum([one.weighted_constant for one in sums], axis=0),
                         sum(one.weight for one in sums))
        return np.concatenate([offset, *(
            (np.outer(moments.ones, offset) + one.slopes(offset)).ravel()
            for one, (moments, _, _) in zip(sums, data_sets))])

    x = [_regressors(moments, blocks) for moments, blocks, _ in data_sets]
    sums = [_sums(one[use], blocks.raw[use]) for one, (_, blocks, use) in zip(x, data_sets)]
    size = len(numbers(sums))
    total = np.zeros((size, size))
    for k, (_, blocks, _) in enumerate(data_sets):
        for pair in doubts[k]:
            narrow, wide = (numbers([*sums[:k], _sums(x[k][use], blocks.raw[use]), *sums[k + 1:]])
                            for use in pair)
            total += np.outer(wide - narrow, wide - narrow) / 4
    return total


def _divide(weighted: Array, weight: float) -> Array:
    return weighted / weight if weight > 0 else np.zeros_like(weighted)


def _regressors(moments: Moments, blocks: Blocks) -> Array:
    return np.column_stack([np.ones(len(blocks)), blocks.regressors @ moments.combine])


def _sums(x: Array, raw: Array) -> Sums:
    return Sums(x.T @ x, x.T @ raw)


def _stretches(blocks: Blocks, use: Mask) -> Iterator[NDArray[np.intp]]:
    """Index sets of consecutive used blocks that are held out together."""
    used = np.flatnonzero(use)
    count = min(max(5, round(len(used) * blocks.length / STRETCH)), MOST_STRETCHES)
    yield from (part for part in np.array_split(used, min(count, len(used))) if len(part))


def _residual(x: Array, held_out: Array, samples: int) -> Residual:
    used = int((x[:, 0] != 0).sum())
    return Residual(x, samples, noise_of_residuals(
        held_out, andrews_lags(held_out, used), used))


def score_covariance(residual: Residual) -> Array:
    """
    Covariance of sum over samples of [1, pseudo-sample weights] (x) residual.

    Returns
    -------
    ndarray, shape ((1 + q) n, (1 + q) n)
    """
    return residual.noise.covariance_of_products(residual.regressors * residual.samples)


def propagate(function: Callable[[Array], Array], x: Array, covariance: Array) -> Array:
    """
    Covariance of a smooth function, to first order by central differences.

    Parameters
    ----------
    function : callable, (k,) -> (l,)
    x : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)

    Returns
    -------
    ndarray, shape (l, l)
    """
    steps = 1e-3 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    steps = np.where(steps > 0, steps, 1e-9 * np.maximum(np.abs(x), 1.0))
    columns = [(function(x + step) - function(x - step)) / (2 * size)
               for step, size in zip(np.diag(steps), steps)]
    jacobian = np.stack(columns, axis=1)
    return np.asarray(jacobian @ covariance @ jacobian.T)
