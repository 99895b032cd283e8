"""
Gaussian filters: a belief, a function of the state, conditioning, and the unscented transform.

[Ukf2025] sets alpha = 0.001, beta = 2, kappa = 0, which puts the sigma points a few thousandths
of a standard deviation from the mean and gives the centre the weight -10^6: the textbook sums
lose six to seven digits to it. Summed by pairs the weights are harmless. With h = alpha sqrt(n),
columns L_i of the Cholesky factor, and for each pair

    D_i = [y(x + h L_i) - y(x - h L_i)] / 2h
    C_i = [y(x + h L_i) + y(x - h L_i) - 2 y(x)] / 2h

the same transform, term by term, is

    mean = y(x) + m,  m = sum_i C_i / h
    P_yy = sum_i (D_i D_i^T + C_i C_i^T) + (beta - alpha^2) m m^T
    P_xy = sum_i L_i D_i^T

and the differences come from :attr:`Function.difference`, which never subtracts large numbers.
For a linear function this is the Kalman filter, to rounding: :func:`expect_linear`.
"""

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

ALPHA, BETA = 1e-3, 2.0
"""Spread of the sigma points and weight of the centre, [Ukf2025]; kappa is zero [1]."""


class Gaussian(NamedTuple):
    """A belief: ``mean`` (n,) and covariance ``cov`` (n, n)."""

    mean: Array
    cov: Array


class Function(NamedTuple):
    """
    A function of the state.

    Attributes
    ----------
    value : callable
        x (n,) -> (k,).
    difference : callable
        (x (n,), dx (p, n)) -> (p, k): ``value(x + dx) - value(x)`` of each row, worked out so
        that a small dx does not drown in the rounding of a large x.
    """

    value: Callable[[Array], Array]
    difference: Callable[[Array, Array], Array]


class Expected(NamedTuple):
    """
    A reading before it is taken, jointly with the state.

    Attributes
    ----------
    mean : ndarray, shape (k,)
    cov : ndarray, shape (k, k)
        Noise included: P_yy of [Ukf2025].
    cross : ndarray, shape (n, k)
        Covariance of state and reading: P_xy.
    """

    mean: Array
    cov: Array
    cross: Array


def first(k: int, expected: Expected) -> Expected:
    """Return the first k elements of a reading, for when the others are missing."""
    return Expected(expected.mean[:k], expected.cov[:k, :k], expected.cross[:, :k])


class NotPositiveDefinite(ArithmeticError):
    """A covariance has lost its meaning; the caller starts anew."""


def cholesky(cov: Array) -> Array:
    """
    Return the lower Cholesky factor.

    Raises
    ------
    NotPositiveDefinite
    """
    factor, info = dpotrf(cov, lower=1, clean=1)
    # LAPACK overlooks NaN, which ends up in the last pivot
    n = len(cov)
    if info or not factor[-1, -1] > 0:
        raise NotPositiveDefinite(f'leading minor {info or n} of {n} is not positive')
    return np.asarray(factor)


def whiten(factor: Array, values: Array) -> Array:
    """
    Return ``factor^-1 values`` for a lower triangular factor, shapes (k, k), (k, p).

    By dtrsm, not dtrtrs: OpenBLAS starts threads for the latter at any size, and on a busy
    machine waits half a millisecond for them.
    """
    return np.asarray(dtrsm(1.0, factor, values, lower=1))


def mahalanobis(innovation: Array, cov: Array) -> float:
    """Return ``e^T cov^-1 e``, chi-square with k degrees of freedom where all is as modelled."""
    e = whiten(cholesky(cov), innovation[:, None])
    return float((e * e).sum())


def predict(belief: Gaussian, A: Array, Q: Array) -> Gaussian:
    """
    Carry a belief forward: x = A x, P = A P A^T + Q, as [Ukf2025] prints it.

    All transitions of this package are linear, so sigma points have nothing to add here.
    """
    return Gaussian(A @ belief.mean, A @ belief.cov @ A.T + Q)


def condition(belief: Gaussian, expected: Expected, reading: Array,
              frozen: slice | None = None) -> Gaussian:
    """
    Take in a reading (k,): x + K e, P - K P_yy K^T with K = P_xy P_yy^-1, [Ukf2025].

    ``frozen`` are states that the reading must not move (Schmidt's filter): their means and
    covariances stay, the others are estimated knowing how uncertain these are.

    Raises
    ------
    NotPositiveDefinite
        ``expected.cov`` is no covariance.
    """
    factor = cholesky(expected.cov)
    k = len(reading)
    columns = np.empty((k, len(belief.mean) + 1), order='F')
    columns[:, :-1] = expected.cross.T
    columns[:, -1] = reading - expected.mean
    white = whiten(factor, columns)
    gain, e = white[:, :-1], white[:, -1]
    mean, cov = belief.mean + e @ gain, belief.cov - gain.T @ gain
    if frozen is not None:
        mean[frozen] = belief.mean[frozen]
        cov[frozen, frozen] = belief.cov[frozen, frozen]
    return Gaussian(mean, cov)


def expect_linear(belief: Gaussian, H: Array, offset: Array | float, R: Array) -> Expected:
    """Predict a reading ``H x + offset`` (k,); ``R`` (k, k) is the covariance of its noise."""
    cross = belief.cov @ H.T
    return Expected(H @ belief.mean + offset, H @ cross + R, cross)


def expect(belief: Gaussian, measurement: Function, R: Array) -> Expected:
    """
    Predict a reading by its 2 n + 1 sigma points; ``R`` (k, k) is the covariance of its noise.

    Raises
    ------
    NotPositiveDefinite
        The belief's covariance is none.
    """
    mean = belief.mean
    factor = cholesky(belief.cov)
    h = ALPHA * sqrt(len(mean))
    offsets = h * factor.T
    moved = measurement.difference(mean, np.concatenate([offsets, -offsets]))
    plus, minus = moved[:len(mean)], moved[len(mean):]
    D = (plus - minus) * (0.5 / h)
    C = (plus + minus) * (0.5 / h)
    centre, cov = measurement.value(mean), D.T @ D + R
    if np.count_nonzero(C):
        shift = C.sum(axis=0) / h
        centre = centre + shift
        cov = cov + C.T @ C + (BETA - ALPHA ** 2) * np.outer(shift, shift)
    return Expected(centre, cov, factor @ D)
