"""[Traversaro2014] Lemma 1 as a check: what of the raw measurements leaves the three dimensions.

A rigid body at rest and a linear sensor leave nothing but noise. What they leave otherwise is
told apart: what follows squares and products of gravity bends under load (a joint such as a knee,
the mount of sensor or accelerometer); what follows the sense in which a channel last moved is
hysteresis; the rest is drift, cables or a light touch.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.geometry import Array
from forcecal_ros.insitu.blocks import Blocks, Mask
import numpy as np
from scipy import stats

SIGNIFICANT = 1e-3
CAUSE = 1e-4
"""Chances below which a departure, or a cause of it, is not taken for noise."""
PLAYS = (0.0025, 0.005, 0.01)
"""Widths of the plays that hysteresis is composed of, as shares of a channel's span."""


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
    blocks : Blocks
    use : ndarray of bool, shape (b,)

    Returns
    -------
    Departure
    """
    white = _whiten(blocks, blocks.raw[use] - blocks.raw[use].mean(axis=0))
    energy = (np.linalg.svd(white, compute_uv=False)[3:] ** 2).sum()
    freedom = (len(white) - 4) * (white.shape[1] - 3)
    return Departure(float(np.sqrt(max(energy / freedom - 1, 0.0))),
                     float(stats.chi2.sf(energy, freedom)))


@dataclass(frozen=True)
class Cause:
    """
    One explanation of what the affine map of gravity leaves, over all data sets.

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
        return self.p < CAUSE


@dataclass(frozen=True)
class Causes:
    """``bending`` beside hysteresis, and ``hysteresis`` beside bending."""

    bending: Cause
    hysteresis: Cause


def causes(data_sets: Sequence[tuple[Blocks, Mask]]) -> Causes:
    """
    Regress what the affine maps leave on squares of gravity and on plays of the channels.

    Parameters
    ----------
    data_sets : sequence of (Blocks, ndarray of bool)

    Returns
    -------
    Causes
    """
    each = [np.ptp(_fitted(blocks, use)[use], axis=0) for blocks, use in data_sets]
    spans: Array = np.asarray(np.max(each, axis=0))
    parts = [_regression(b, u, spans) for b, u in data_sets]
    left = np.vstack([part[0] for part in parts])
    squares, plays = (np.vstack([part[k] for part in parts]) for k in (1, 2))
    blocks = data_sets[0][0]
    root = np.linalg.cholesky(blocks.raw_noise / blocks.samples)
    return Causes(_cause(left, squares, plays, root), _cause(left, plays, squares, root))


def _whiten(blocks: Blocks, values: Array) -> Array:
    root = np.linalg.cholesky(blocks.raw_noise / blocks.samples)
    return np.asarray(np.linalg.solve(root, values.T).T)


def _affine(blocks: Blocks) -> Array:
    """
    Constant and unit gravity of every block.

    Unit, because on the sphere squares of two components say what the third is: they would
    explain its measured noise.
    """
    g = blocks.regressors[:, :3] / blocks.gravity_norm[:, None]
    return np.column_stack([np.ones(len(blocks)), g])


def _fitted(blocks: Blocks, use: Mask) -> Array:
    """Raw block means as the affine map of gravity has them."""
    x = _affine(blocks)
    return np.asarray(x @ np.linalg.lstsq(x[use], blocks.raw[use], rcond=None)[0])


def _regression(blocks: Blocks, use: Mask, spans: Array) -> tuple[Array, Array, Array]:
    """Return whitened residual, squares of gravity, plays; all with the affine part taken out."""
    x = _affine(blocks)
    squares = np.stack([x[:, i] * x[:, j] for i in range(1, 4) for j in range(i, 4)], axis=1)
    fitted = _fitted(blocks, use)
    plays = np.hstack([_play(fitted / spans, width) for width in PLAYS])
    q, _ = np.linalg.qr(x[use])
    residual = _whiten(blocks, blocks.raw[use] - fitted[use])
    squares, plays = (y[use] - q @ (q.T @ y[use]) for y in (squares[:, :-1], plays))
    return residual, squares, plays


def _play(values: Array, width: float) -> Array:
    """How far each column is ahead of a play that it drags along, -1..1."""
    half = width / 2
    behind = np.empty_like(values)
    state = values[0]
    for i, row in enumerate(values):
        state = np.minimum(np.maximum(state, row - half), row + half)
        behind[i] = state
    return (values - behind) / half


def _cause(left: Array, these: Array, others: Array, root: Array) -> Cause:
    """F test of some regressors beside others; noise and its correlation are the residual's."""
    both = np.hstack([these, others])
    theta = np.linalg.lstsq(both, left, rcond=None)[0]
    rest = left - both @ theta
    freedom = len(left) - both.shape[1]
    white = np.linalg.inv(np.linalg.cholesky(rest.T @ rest / freedom)).T
    q, _ = np.linalg.qr(others)
    explained = (((left - q @ (q.T @ left)) @ white) ** 2).sum() - ((rest @ white) ** 2).sum()
    unknowns = these.shape[1] * left.shape[1]
    part = these @ theta[:these.shape[1]] @ root.T
    return Cause(part.T @ part / len(left), float(stats.f.sf(
        explained / unknowns / _inflation(rest @ white), unknowns, freedom * left.shape[1])))


def _inflation(rest: Array) -> float:
    """How many times larger correlation makes the variance of a slow weighted sum."""
    power = (rest ** 2).sum()
    lags = max(1, int(len(rest) ** (1 / 3)))
    return float(max(1.0, 1 + 2 * sum(
        (1 - k / (lags + 1)) * (rest[k:] * rest[:-k]).sum() / power for k in range(1, lags + 1))))
