"""One robust linear fit of wrenches, with standard errors of blocks."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np

FREEDOM = 4.0
"""Degrees of freedom of Student's t: contact is its tails."""

BLOCKS = 40
"""Blocks of a recording that are taken as independent of each other."""


class RobustFit(NamedTuple):
    """
    One robust regression.

    Attributes
    ----------
    theta : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        Sandwich over blocks.
    residual : ndarray, shape (n, c, 3)
    scale : ndarray, shape (c,)
        Of one channel's residual in each group of three channels.
    """

    theta: Array
    covariance: Array
    residual: Array
    scale: Array

    @property
    def std(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def robust_fit(X: Array, y: Array, prior: Array | None = None, blocks: int = BLOCKS) -> RobustFit:
    """
    Fit y (n, 3 c) by X (n, 3 c, k) with Student's t on each group of three channels.

    Parameters
    ----------
    prior : ndarray, shape (k,), or None
        Precision of a Gaussian prior about 0 of each unknown; None: none.
    blocks : int
        Independent blocks of rows for the covariance.
    """
    n, c, k = len(y), y.shape[1] // 3, X.shape[2]
    size = np.sqrt(np.einsum('nij,nij->j', X, X) / n) + 1e-300
    X = (X / size).reshape(n, c, 3, k)
    y = y.reshape(n, c, 3)
    ridge = np.diag(1e-12 * np.ones(k) if prior is None else prior / size**2 + 1e-12)
    weight = np.ones((n, c)) / np.maximum(np.var(y, axis=(0, 2)), 1e-300)
    scale = np.zeros(c)
    for _ in range(50):
        before = scale
        A = np.einsum('nc,ncij,ncil->jl', weight, X, X, optimize=True) + ridge
        theta = np.linalg.solve(A, np.einsum('nc,ncij,nci->j', weight, X, y, optimize=True))
        residual = y - X @ theta
        square = (residual**2).sum(axis=2) + 1e-300
        if not before.any():
            scale = np.median(square, axis=0) / 2.366  # of three Gaussian channels
        share = (FREEDOM + 3) / (FREEDOM + square / scale)
        scale = (share * square).mean(axis=0) / 3
        weight = share / scale
        if before.any() and np.all(np.abs(scale - before) < 1e-5 * scale):
            break
    score = np.einsum('nc,ncij,nci->nj', weight, X, residual, optimize=True)
    edges = np.linspace(0, n, min(blocks, n) + 1).astype(int)[:-1]
    sums = np.add.reduceat(score, edges, axis=0)
    spread = sums.T @ sums * len(edges) / max(len(edges) - k, 1)  # k sums of scores are zero
    # curvature of Student's t: what weights lose beside the plain weighted squares
    unit = square / scale
    bend = weight * np.maximum(1 - 2 * unit / (3 * (FREEDOM + unit)), 0.1)
    H = np.einsum('nc,ncij,ncil->jl', bend, X, X, optimize=True) + ridge
    inverse = np.linalg.pinv(H, rcond=1e-12, hermitian=True)
    covariance = inverse @ spread @ inverse / np.outer(size, size)
    return RobustFit(theta / size, covariance, residual, np.sqrt(scale))
