"""
[Traversaro2014] Lemma 1 as a check: how far raw measurements leave their three dimensions.

With a rigid body at rest and a linear sensor only noise does. What follows squares and products of
gravity bends under load (a joint such as a knee, the mount of sensor or accelerometer); what
follows the sense in which a channel last moved is hysteresis, and is taken off.

Squares of gravity are seen as far as they leave the affine map. The rest of them bends offset and
slopes, the same in all data sets and however long these are, so that no residual tells its size.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled
from forcecal_ros.core.noise.autocovariance import noise_of_residuals
from forcecal_ros.insitu.blocks import Blocks, Mask
from forcecal_ros.insitu.moments import Moments
import numpy as np
from scipy.special import chdtrc, fdtrc

SIGNIFICANT = 1e-4
"""Probability by noise alone below which a departure, or a cause of it, is taken to be there."""

ENOUGH = 5
"""Blocks for each regressor that are needed to tell causes apart: with two, means of sound poses
show a hysteresis once in four times."""

PLAYS = (0.0025, 0.005, 0.01)
"""Widths of the play operators that make up a hysteresis, as shares of a channel's span."""

HIDDEN = 2.0
"""
What is hidden along each regressor over what is seen of a bend, as RMS; from simulated legs with
bias, hysteresis and flex at 1, 3 and 10 times the protocol's (`benchmark/insitu_protocol.py`),
where 92 to 99 % of the truths are then within two standard errors, 60 to 65 % without.
"""


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
    all_plays = [np.hstack([_play(f / spans, width) for width in PLAYS]) for f in fitted]
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
        None where they could not be told.

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
    hidden = np.kron(HIDDEN ** 2 * gram[0, 0] * np.linalg.inv(gram), causes.bending.covariance)
    return np.asarray(linear @ hidden @ linear.T)
