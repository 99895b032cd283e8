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

CHUNK = 48
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
               tolerance: float = 1e-5, groups: NDArray[np.intp] | None = None, channels: int = 3,
               freedom: float = FREEDOM) -> RobustFit:
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
    freedom : float
        Degrees of freedom of Student's t.
    """
    n, d, k = len(y), channels, X.shape[2]
    c = y.shape[1] // d
    members = np.ones((1, n), dtype=bool)
    if groups is None:
        groups = np.zeros(n, dtype=np.intp)
    else:
        groups = np.unique(groups, return_inverse=True)[1]
        members = np.arange(groups.max() + 1)[:, None] == groups  # (g, n)
    each = members.astype(float)
    size = np.sqrt(np.einsum('nij,nij->j', X, X) / n) + 1e-150
    X = (X / size).reshape(-1, d, k)
    y = y.reshape(n, c, d)
    upper = np.triu_indices(k)  # products of a row with itself: an iteration weighs them alone
    products = np.concatenate([(np.swapaxes(X, 1, 2) @ X)[:, upper[0], upper[1]], np.einsum(
        'nij,ni->nj', X, y.reshape(-1, d))], axis=1)
    short = -len(X) % CHUNK
    products = np.pad(products, ((0, short), (0, 0))).reshape(-1, CHUNK, products.shape[1])
    shares = np.zeros(n * c + short)
    X = X.reshape(-1, k)

    def normal_of(weight: Array) -> tuple[Array, Array]:
        shares[:n * c] = weight.ravel()
        sums = (shares.reshape(-1, 1, CHUNK) @ products).sum(axis=(0, 1))
        A = np.empty((k, k))
        A[upper] = A.T[upper] = sums[:-k]
        return A, sums[-k:]

    stated = np.zeros(k) if prior is None else prior / size**2
    weight = np.ones((n, c)) / np.maximum(np.var(y, axis=(0, 2)), 1e-300)
    scale = np.zeros((len(members), c))
    for _ in range(50):
        before = scale
        normal, moment = normal_of(weight)
        ridge = np.diag(stated + RIDGE * normal.diagonal().max())
        theta = np.linalg.solve(normal + ridge, moment)
        residual = y - np.einsum('ij,j->i', X, theta).reshape(n, c, d)
        square = np.einsum('ncd,ncd->nc', residual, residual) + 1e-150
        if not before.any():
            middle = np.stack([np.median(square[rows], axis=0) for rows in members])
            scale = middle / chdtri(d, 0.5)  # of d Gaussian channels
        share = (freedom + d) / (freedom + square / scale[groups])
        scale = each @ (share * square) / (each @ share) / d  # sums of shares: Kent et al. 1994
        weight = share / scale[groups]
        if before.any() and np.all(np.abs(scale - before) < tolerance * scale):
            break
    score = (X * (weight[:, :, None] * residual).reshape(-1, 1)).reshape(n, -1, k).sum(axis=1)
    edges = np.linspace(0, n, min(blocks, n) + 1).astype(int)[:-1]
    sums = np.add.reduceat(score, edges, axis=0)
    spread = sums.T @ sums * len(edges) / max(len(edges) - k, 1)  # k sums of scores are zero
    # curvature of Student's t: what weights lose beside the plain weighted squares
    unit = square / scale[groups]
    bend = weight * np.maximum(1 - 2 * unit / (d * (freedom + unit)), 0.1)
    inverse = np.linalg.inv(normal_of(bend)[0] + ridge)
    with np.errstate(over='ignore'):
        covariance = inverse @ (spread + ridge) @ inverse / np.outer(size, size)
    return RobustFit(theta / size, covariance, residual, np.sqrt(scale))
