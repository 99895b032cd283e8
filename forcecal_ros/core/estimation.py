"""One robust linear fit with standard errors of blocks, derivatives and a filter's gain."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_discrete_are
from scipy.special import chdtri, fdtri, ndtri, stdtrit

FREEDOM = 4.0
"""Degrees of freedom of Student's t: contact is its tails."""

BLOCKS = 40
"""Blocks of a recording that are taken as independent of each other."""

RIDGE = 1e-12
"""Share of the largest diagonal element that is added to all: rounding. What the rows do not
determine gets a standard error a million times that of what they do."""

CHANCE = 1e-3
"""Probability by which one test takes noise for more than that: a combination of columns, a mean
of residuals, an offset. Of 1495 looks at the residuals of 299 fault-free recordings the least
probable had 5e-3, where as many independent ones would have had 7e-4."""

COVERED = 0.975
"""Share of a normal distribution below 1.96 standard errors, and of estimates below theirs."""

CHUNK = 48
"""Rows of one matrix product, too few for threads, which take longer to meet than to multiply."""


class RobustFit(NamedTuple):
    """
    One robust regression.

    Attributes
    ----------
    theta : ndarray, shape (k,)
    residual : ndarray, shape (n, c, d)
    scale : ndarray, shape (g, c)
        Of one channel's residual in each group of rows and of channels.
    sandwich : callable
        Computes the covariance when it is first asked for: that takes as long as the fit itself,
        and many a fit is only compared with others.
    """

    theta: Array
    residual: Array
    scale: Array
    sandwich: Callable[[], Array]

    @property
    def covariance(self) -> Array:
        """Sandwich over blocks (k, k): 1.96 standard errors to either side hold 95 %."""
        return self.sandwich()

    @property
    def std(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def robust_fit(X: Array, y: Array, prior: Array | None = None, blocks: int = BLOCKS,
               tolerance: float = 1e-5, groups: NDArray[np.intp] | None = None, channels: int = 3,
               freedom: float = FREEDOM, noise: Array | None = None,
               about: Array | float = 0.0) -> RobustFit:
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
    noise : ndarray, shape (n, c d, k), or None
        A draw of the noise in X, independent of it. Its squares are subtracted from those of X,
        where they would dilute the estimates.
    about : ndarray, shape (k,), or 0
        By how much of each column y was raised, noise and all: 0 but in a linearised problem.
    """
    n, d, k = len(y), channels, X.shape[2]
    c = y.shape[1] // d
    groups = np.unique(np.zeros(n) if groups is None else groups, return_inverse=True)[1]
    members = np.arange(groups.max(initial=0) + 1)[:, None] == groups  # (g, n)
    each = members.astype(float)
    size = np.sqrt(np.einsum('nij,nij->j', X, X) / n) + 1e-150
    X, y = (X / size).reshape(-1, d, k), y.reshape(n, c, d)
    stated = np.zeros(k) if prior is None else prior / size**2
    squares_of = _weighing(np.concatenate([X, y.reshape(-1, d, 1)], axis=2))
    D = np.zeros((0, d, k)) if noise is None else (noise / size).reshape(-1, d, k)
    noise_of, about = _weighing(D), about * size * np.ones(k)
    X, D = X.reshape(-1, k), D.reshape(-1, k)

    weight = bend = np.ones((n, c)) / np.maximum(np.var(y, axis=(0, 2)), 1e-300)
    scale = np.zeros((len(members), c))
    for _ in range(50):
        before = scale
        A = squares_of(weight)
        normal, shown = A[:k, :k], np.eye(k)
        if noise is not None:
            normal, shown = _less_noise(normal, noise_of(weight), noise_of(bend), len(X))
        moment = shown @ (A[:k, k] - A[:k, :k] @ about) + normal @ about
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
        # mean slope of the weighted residual: the weight falls as the residual grows
        unit = square / scale[groups]
        bend = weight * np.maximum(1 - 2 * unit / (d * (freedom + unit)), 0.1)
        if before.any() and np.all(np.abs(scale - before) < tolerance * scale):
            break

    def sandwich() -> Array:
        score = X * (weight[:, :, None] * residual).reshape(-1, 1)
        if noise is not None:
            score += D * (np.repeat(bend, d) * (D @ (theta - about)))[:, None]
        score = score.reshape(n, -1, k).sum(axis=1)
        edges = np.linspace(0, n, min(blocks, n) + 1).astype(int)[:-1]
        sums = np.add.reduceat(score, edges, axis=0)
        # a row's slope depends on its own residual, so that its mean over block and group is taken
        block = np.repeat(np.arange(len(edges)), np.diff(np.append(edges, n)))
        cell = len(members) * block + groups
        slope = np.stack([np.bincount(cell, part) for part in bend.T], axis=1)
        slope = (slope / np.maximum(np.bincount(cell), 1)[:, None])[cell]
        rows = X.reshape(n, -1, k) * np.sqrt(np.repeat(slope, d, axis=1))[:, :, None]
        squares = np.stack([part.reshape(-1, k).T @ part.reshape(-1, k)
                            for part in np.split(rows, edges[1:])])
        normal, shown = squares.sum(axis=0), np.eye(k)
        if noise is not None:
            part = noise_of(slope)
            normal, shown = _less_noise(normal, part, part, len(X))
        inverse = np.linalg.inv(normal + ridge)
        with np.errstate(over='ignore'):
            covariance = _covariance(inverse, sums @ shown.T, shown @ squares @ shown.T, ridge)
            return np.asarray((covariance + inverse @ ridge @ inverse) / np.outer(size, size))

    return RobustFit(theta / size, residual, np.sqrt(scale), cache(sandwich))


def _covariance(inverse: Array, sums: Array, squares: Array, ridge: Array) -> Array:
    """
    Return the covariance (k, k) of estimates from sums of scores (b, k) over blocks.

    A block's scores are raised by its leverage, its share of all squares (b, k, k): it is fitted
    by itself in part (CR2 of Bell and McCaffrey 2002). Standard errors of few blocks are scaled by
    Student's t, whose degrees of freedom are matched as if residuals were independent, so that
    estimates lie within 1.96 of them as often as normal ones. What one block alone shows has no
    score; its residuals are taken as independent.
    """
    root = np.linalg.cholesky(squares.sum(axis=0) + ridge)
    whitened = np.linalg.inv(root)
    shares = whitened @ squares @ whitened.T
    leverage, vectors = np.linalg.eigh(shares)
    # below the mean share of a block it counts as shown by that block alone
    others = np.maximum(1 - leverage, 1 / len(sums))
    by_vector = inverse @ root @ vectors
    parts = by_vector / np.sqrt(others)[:, None, :] @ vectors.swapaxes(1, 2)
    single = by_vector * np.sqrt(np.where(1 - leverage < others, leverage, 0.0))[:, None, :]
    estimates = np.einsum('bij,bj->bi', parts, sums @ whitened.T)
    # covariance of these estimates, of two blocks each, if residuals were independent
    products = parts @ shares
    between = -np.einsum('bij,cij->ibc', products, products)
    between += np.einsum('bij,bij->ib', products, parts)[:, :, None] * np.eye(len(sums))
    trace = np.einsum('ibb->i', between)
    dof = trace**2 / np.maximum(np.einsum('ibc,ibc->i', between, between), 1e-300)
    t_ratio = stdtrit(np.maximum(dof, 1.0), COVERED) / ndtri(COVERED)  # dof 0: no block, no score
    return np.asarray(estimates.T @ estimates * np.outer(t_ratio, t_ratio)
                      + np.einsum('bij,bkj->ik', single, single))


def _weighing(Z: Array) -> Callable[[Array], Array]:
    """Return the sum (k, k) of weighted squares of rows (m, d, k), as a function of weights."""
    k = Z.shape[2]
    upper = np.triu_indices(k)  # products of a row with itself: an iteration weighs them alone
    products = (np.swapaxes(Z, 1, 2) @ Z)[:, upper[0], upper[1]]
    short = -len(Z) % CHUNK
    products = np.pad(products, ((0, short), (0, 0))).reshape(-1, CHUNK, products.shape[1])
    weights = np.zeros(len(Z) + short)

    def squares(weight: Array) -> Array:
        weights[:len(Z)] = weight.ravel()
        A = np.empty((k, k))
        A[upper] = A.T[upper] = (weights.reshape(-1, 1, CHUNK) @ products).sum(axis=(0, 1))
        return A

    return squares


def _less_noise(squares: Array, noise: Array, excess: Array, rows: int) -> tuple[Array, Array]:
    """
    Return squares (k, k) less the excess, and the projection to what is more than noise of n rows.

    Combinations of columns that are not significantly more than their noise show nothing: what is
    left of them would be chance over a small difference.
    """
    regular = squares + RIDGE * squares.diagonal().max() * np.eye(len(squares))
    part, vectors = eigh(noise, regular)
    lost = vectors[:, part * fdtri(rows, rows, 1.0 - CHANCE) > 1.0]
    kept = np.eye(len(squares)) - regular @ lost @ lost.T
    return kept @ (squares - excess) @ kept.T, kept


def jacobian(score: Callable[[Array], Array], theta: Array, steps: Array) -> Array:
    """
    Differentiate numerically, column by column.

    Parameters
    ----------
    score : callable
        (p,) to (q,).
    theta, steps : ndarray, shape (p,)

    Returns
    -------
    ndarray, shape (q, p)
    """
    return np.stack([(score(theta + step) - score(theta - step)) / (2 * size)
                     for size, step in zip(steps, np.diag(steps), strict=True)], axis=1)


def stationary_gain(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """
    Return the gain (n, m) of the stationary Kalman filter of x' = A x + w, y = C x + v.

    Parameters
    ----------
    A, C : ndarray, shapes (n, n), (m, n)
    Q, R : ndarray, shapes (n, n), (m, m)
        Covariances of w and v.

    Raises
    ------
    UnobservableError
        The Riccati equation has no stabilising solution.
    """
    try:
        P = solve_discrete_are(A.T, C.T, Q, R)
    except ValueError as error:  # LinAlgError is one; reordering the pencil raises others
        raise UnobservableError(f'no stationary gain for {len(A)} states: {error}; check the '
                                'covariances') from None
    return np.asarray(np.linalg.solve(C @ P @ C.T + R, C @ P).T)
