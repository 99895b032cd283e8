"""One robust linear fit of wrenches, with standard errors of blocks."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

FREEDOM = 4.0
"""Degrees of freedom of Student's t: contact is its tails."""

BLOCKS = 40
"""Blocks of a recording that are taken as independent of each other."""

RIDGE = 1e-12
"""Share of the largest diagonal element that is added to all: rounding. What the rows do not
determine gets a standard error a million times that of what they do."""

CHUNK = 96
"""Rows of one matrix product, too few for threads, which take longer to meet than to multiply."""


class RobustFit(NamedTuple):
    """
    One robust regression.

    Attributes
    ----------
    theta : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        Sandwich over blocks.
    residual : ndarray, shape (n, c, d)
    scale : ndarray, shape (g, c)
        Of one channel's residual in each group of rows and of channels.
    """

    theta: Array
    covariance: Array
    residual: Array
    scale: Array

    @property
    def std(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def robust_fit(X: Array, y: Array, prior: Array | None = None, blocks: int = BLOCKS,
               tolerance: float = 1e-5, groups: NDArray[np.intp] | None = None, channels: int = 3
               ) -> RobustFit:
    """
    Fit y (n, c d) by X (n, c d, k) with Student's t on each group of d channels.

    Parameters
    ----------
    prior : ndarray, shape (k,), or None
        Precision of a Gaussian prior about 0 of each unknown; None: none.
    blocks : int
        Independent blocks of rows for the covariance.
    tolerance : float
        Relative change of the scales at which iterations end.
    groups : ndarray of int, shape (n,), or None
        Which rows share a scale, 0, 1, ...; None: all.
    channels : int
        In a group of channels, d.
    """
    n, d, k = len(y), channels, X.shape[2]
    c = y.shape[1] // d
    groups = (np.zeros(n, dtype=np.intp) if groups is None
              else np.unique(groups, return_inverse=True)[1])
    members = np.arange(groups.max() + 1)[:, None] == groups  # (g, n)
    size = np.sqrt(np.einsum('nij,nij->j', X, X) / n) + 1e-150
    X = (X / size).reshape(-1, k)
    y = y.reshape(n, c, d)
    short = -len(X) % CHUNK
    chunks = np.pad(X, ((0, short), (0, 0))).reshape(-1, CHUNK, k)
    readings = np.pad(y.ravel(), (0, short)).reshape(-1, CHUNK, 1)

    def product(weight: Array, right: Array) -> Array:
        shares = np.pad(np.repeat(weight, d), (0, short)).reshape(-1, CHUNK, 1)
        return np.asarray((np.swapaxes(chunks * shares, 1, 2) @ right).sum(axis=0))

    stated = np.zeros(k) if prior is None else prior / size**2
    weight = np.ones((n, c)) / np.maximum(np.var(y, axis=(0, 2)), 1e-300)
    scale = np.zeros((len(members), c))
    for _ in range(50):
        before = scale
        normal = product(weight, chunks)
        ridge = np.diag(stated + RIDGE * normal.diagonal().max())
        theta = np.linalg.solve(normal + ridge, product(weight, readings))[:, 0]
        residual = y - np.einsum('ij,j->i', X, theta).reshape(n, c, d)
        square = (residual**2).sum(axis=2) + 1e-150
        if not before.any():
            middle = np.stack([np.median(square[rows], axis=0) for rows in members])
            scale = middle / chdtri(d, 0.5)  # of d Gaussian channels
        share = (FREEDOM + d) / (FREEDOM + square / scale[groups])
        scale = np.stack([(share * square)[rows].mean(axis=0) for rows in members]) / d
        weight = share / scale[groups]
        if before.any() and np.all(np.abs(scale - before) < tolerance * scale):
            break
    score = (X * (weight[:, :, None] * residual).reshape(-1, 1)).reshape(n, -1, k).sum(axis=1)
    edges = np.linspace(0, n, min(blocks, n) + 1).astype(int)[:-1]
    sums = np.add.reduceat(score, edges, axis=0)
    spread = sums.T @ sums * len(edges) / max(len(edges) - k, 1)  # k sums of scores are zero
    # curvature of Student's t: what weights lose beside the plain weighted squares
    unit = square / scale[groups]
    bend = weight * np.maximum(1 - 2 * unit / (d * (FREEDOM + unit)), 0.1)
    inverse = np.linalg.inv(product(bend, chunks) + ridge)
    with np.errstate(over='ignore'):
        covariance = inverse @ (spread + ridge) @ inverse / np.outer(size, size)
    return RobustFit(theta / size, covariance, residual, np.sqrt(scale))
