"""Standard errors that hold when residuals are correlated in time.

The filter correlates neighbouring samples, and so do hysteresis, flex and what else the model
leaves out. Residuals are therefore taken of block means of the unfiltered recording. The
covariance of every weighted sum of them is built from their autocovariance. Weights are the
regressors as the filter leaves them: motion about as fast as its window is less there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.core.estimation import jacobian
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled
from forcecal_ros.core.noise.autocovariance import andrews_lags, Autocovariance, noise_of_residuals
from forcecal_ros.insitu.blocks import Blocks, Mask, TINY
from forcecal_ros.insitu.moments import gathered, Moments, smooth
import numpy as np
from scipy.special import chdtrc, fdtrc


class Residual(NamedTuple):
    """
    Residual of one data set.

    Attributes
    ----------
    long_run : ndarray, shape (n, n)
        Covariance of a sample that correlation makes of it.
    scores : ndarray, shape ((1 + q) n, (1 + q) n)
        Covariance of sum over samples of [1, pseudo-sample weights] (x) residual.
    """

    long_run: Array
    scores: Array


def residuals(data_sets: Sequence[tuple[Moments, Blocks, Mask]], seconds: float, order: int
              ) -> list[Residual]:
    """
    Fit pseudo-samples to every data set beside one constant for all, and return what is left.

    Parameters
    ----------
    seconds : float
        Window of the filter that the moments are of; 0: none [s].
    order : int
        Of its polynomial.
    """
    x = [np.where(use[:, None], _regressors(moments, blocks), 0.0)
         for moments, blocks, use in data_sets]
    beside = []
    for one, (_, blocks, use) in zip(x, data_sets):
        values = np.column_stack([one[:, 0], np.where(use[:, None], blocks.raw, 0.0)])
        q = np.linalg.qr(one[:, 1:])[0]
        beside.append(values - q @ (q.T @ values))
    weighted = np.sum([one[:, 0] @ one for one in beside], axis=0)
    if weighted[0] > 1e-9 * sum(map(len, beside)):  # else they say what a constant would
        weighted /= weighted[0]
    out = []
    for one, values, (_, blocks, use) in zip(x, beside, data_sets):
        left = values[:, 1:] - np.outer(values[:, 0], weighted[1:])
        window = round(seconds / blocks.length / 2) * 2 + 1
        noise, size = _noise(left, int(use.sum()), one.shape[1]), blocks.samples
        out.append(Residual(noise.long_run * size, noise.covariance_of_products(
            _as_filtered(one, use, window, order) * size)))
    return out


def _noise(left: Array, used: int, unknowns: int) -> Autocovariance:
    """Measure what is left of so many blocks; the slower it is, the more of it a fit took."""
    lags = andrews_lags(left, used)
    noise = noise_of_residuals(left, lags, used)
    slow = float(np.trace(noise.long_run) / max(np.trace(noise.covariance), TINY))
    return noise_of_residuals(left, lags, max(
        round(used - unknowns * max(slow, 1.0)), used // 4, 1))


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
        out[start:end] = gathered(smooth(x[start:end], window, order).values, window, order)
    return out


def _regressors(moments: Moments, blocks: Blocks) -> Array:
    return np.column_stack([np.ones(len(blocks)), blocks.regressors @ moments.combine])


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
    J = jacobian(function, x, steps)
    return np.asarray(J @ covariance @ J.T)


SIGNIFICANT = 1e-4
"""Probability by noise alone below which a departure, or a cause of it, is taken to be there."""

ENOUGH = 5
"""Blocks for each regressor that are needed to tell causes apart: with two, means of sound poses
show a hysteresis once in four times."""


@dataclass(frozen=True)
class Departure:
    """
    What leaves the three-dimensional subspace of one data set, beyond noise.

    Attributes
    ----------
    times_noise : float
        RMS of the departure over that of a block mean's noise, in the same directions.
    p : float
        Chance of a departure this large from noise alone.
    """

    times_noise: float
    p: float

    @property
    def significant(self) -> bool:
        """Whether noise does not explain it."""
        return self.p < SIGNIFICANT


def departure(blocks: Blocks, use: Mask) -> Departure:
    """
    Compare the scatter outside the three strongest directions with the noise.

    Parameters
    ----------
    use : ndarray of bool, shape (b,)
    """
    root = np.linalg.cholesky(blocks.raw_noise / blocks.samples)
    white = np.linalg.solve(root, (blocks.raw[use] - blocks.raw[use].mean(axis=0)).T).T
    energy = (np.linalg.svd(white, compute_uv=False)[3:] ** 2).sum()
    freedom = (len(white) - 4) * (white.shape[1] - 3)
    return Departure(float(np.sqrt(max(energy / freedom - 1, 0.0))),
                     float(chdtrc(freedom, energy)))


@dataclass(frozen=True)
class Cause:
    """
    One explanation of the residuals of the affine map of gravity, over all data sets.

    Attributes
    ----------
    covariance : ndarray, shape (n, n)
        Of its contribution to the raw channels.
    p : float
        Chance that noise as it is correlated looks like this.
    """

    covariance: Array
    p: float

    @property
    def significant(self) -> bool:
        """Whether it is there."""
        return self.p < SIGNIFICANT


@dataclass(frozen=True)
class Causes:
    """
    Explanations of the residuals of the affine maps of gravity.

    Attributes
    ----------
    bending, hysteresis : Cause
        Each beside the other.
    lags : tuple of ndarray, shape (b, n)
        Hysteresis in the raw channels of each data set's blocks; zero where there is none.
    """

    bending: Cause
    hysteresis: Cause
    lags: tuple[Array, ...]


def causes(data_sets: Sequence[tuple[Blocks, Mask]]) -> Causes | None:
    """
    Regress the residuals of the affine maps on squares of gravity and on plays of the channels.

    Returns
    -------
    Causes or None
        None where there are too few blocks to tell.
    """
    # unit gravity: on the sphere squares of two components say what the third is, and would
    # explain its measured noise
    maps = [np.column_stack([np.ones(len(blocks)),
                             blocks.regressors[:, :3] / blocks.gravity_norm[:, None]])
            for blocks, _ in data_sets]
    fitted = [x @ np.linalg.lstsq(x[use], blocks.raw[use], rcond=None)[0]
              for x, (blocks, use) in zip(maps, data_sets)]
    spans = np.max([np.ptp(f[use], axis=0) for f, (_, use) in zip(fitted, data_sets)], axis=0)
    root = np.linalg.cholesky(np.mean(
        [blocks.raw_noise / blocks.samples for blocks, _ in data_sets], axis=0))
    residual = np.vstack([np.linalg.solve(root, (blocks.raw - f)[use].T).T
                          for f, (blocks, use) in zip(fitted, data_sets)])
    # widths of the play operators that make up a hysteresis, as shares of a channel's span
    widths = (0.0025, 0.005, 0.01)
    all_plays = [np.hstack([_play(f / spans, width) for width in widths]) for f in fitted]
    squares = _beside_affine([_squares(x) for x in maps], maps, data_sets)
    plays = _beside_affine(all_plays, maps, data_sets)
    if len(residual) < ENOUGH * (squares.shape[1] + plays.shape[1]):
        return None
    bending, _ = _cause(residual, squares, plays, root)
    hysteresis, size = _cause(residual, plays, squares, root)
    size = size * hysteresis.significant
    return Causes(bending, hysteresis, tuple(of @ size for of in all_plays))


def _squares(x: Array) -> Array:
    """Squares and products of unit gravity; the last square follows from the others."""
    return np.stack([x[:, i] * x[:, j] for i in range(1, 4) for j in range(i, 4)][:-1], axis=1)


def _beside_affine(values: Sequence[Array], maps: Sequence[Array],
                   data_sets: Sequence[tuple[Blocks, Mask]]) -> Array:
    """Take the affine map of gravity out of the blocks in use, and stack these."""
    bases = [np.linalg.qr(x[use])[0] for x, (_, use) in zip(maps, data_sets)]
    return np.vstack([of[use] - q @ (q.T @ of[use])
                      for of, q, (_, use) in zip(values, bases, data_sets)])


def _play(values: Array, width: float) -> Array:
    """Play operator (Prandtl, Ishlinskii): how far a column is ahead of what it drags, -1..1."""
    half = width / 2
    behind = np.empty_like(values)
    _drag(values, half, behind)
    return (values - behind) / half


@compiled
def _drag(values: Array, half: float, behind: Array) -> None:
    """Let every column drag something along that it can be ahead or short of by ``half``."""
    for k in range(values.shape[1]):
        state = values[0, k]
        for i in range(len(values)):
            state = min(max(state, values[i, k] - half), values[i, k] + half)
            behind[i, k] = state


def _cause(residual: Array, these: Array, others: Array, root: Array) -> tuple[Cause, Array]:
    """
    F test of some regressors beside others; noise and its correlation are the residual's.

    Returns the coefficients of these regressors too, in raw units.
    """
    both = np.hstack([these, others])
    theta = np.linalg.lstsq(both, residual, rcond=None)[0]
    unexplained = residual - both @ theta
    freedom = len(residual) - both.shape[1]
    scatter = unexplained.T @ unexplained / freedom + 1e-6 * np.eye(residual.shape[1])
    white = np.linalg.inv(np.linalg.cholesky(scatter)).T
    q, _ = np.linalg.qr(others)
    explained = (((residual - q @ (q.T @ residual)) @ white) ** 2).sum() \
        - ((unexplained @ white) ** 2).sum()
    unknowns = these.shape[1] * residual.shape[1]
    size = theta[:these.shape[1]] @ root.T
    part = these @ size
    return Cause(part.T @ part / len(residual), float(fdtrc(
        unknowns, freedom * residual.shape[1],
        max(0.0, explained / unknowns / _inflation(unexplained @ white))))), size


def _inflation(residual: Array) -> float:
    """How many times larger correlation makes the variance of a slow weighted sum."""
    noise = noise_of_residuals(residual, max(1, int(len(residual) ** (1 / 3))))
    return max(1.0, float(np.trace(noise.long_run) / np.trace(noise.covariance)))


def hidden_covariance(moments: Sequence[Moments], causes: Causes | None) -> Array | None:
    """
    Covariance that the hidden part of a bend adds, at rest.

    Parameters
    ----------
    causes : Causes or None
        None where they are not identifiable.

    Returns
    -------
    ndarray or None
        Of [offset, raw pseudo-samples of every data set]; None where nothing bends.
    """
    if causes is None or not causes.bending.significant:
        return None
    n = len(causes.bending.covariance)
    x = [np.column_stack([m.ones, m.directions]) for m in moments]
    gram = np.sum([one.T @ one for one in x], axis=0)
    gram[0, 0] = sum(m.count for m in moments)
    of_offset = np.eye(1, gram.shape[0])
    linear = np.kron(np.vstack([of_offset, *x]), np.eye(n))
    # what is hidden along each regressor over what is seen of a bend, as RMS; from simulated legs
    # with bias, hysteresis and flex at 1, 3 and 10 times the protocol's
    # (benchmark/insitu_protocol.py), where 92 to 99 % of the truths are then within two standard
    # errors, 60 to 65 % without
    by_seen = 2.0
    hidden = np.kron(by_seen ** 2 * gram[0, 0] * np.linalg.inv(gram), causes.bending.covariance)
    return np.asarray(linear @ hidden @ linear.T)
