"""What the filters share: a belief, a function seen three ways, conditioning; and the EKF."""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf


class Gaussian(NamedTuple):
    """A belief: ``mean`` (n,) and covariance ``cov`` (n, n)."""

    mean: Array
    cov: Array


class Function(NamedTuple):
    """
    A function of the state, in the three forms filters ask for.

    Attributes
    ----------
    value : callable
        x (n,) -> (k,).
    difference : callable
        (x (n,), dx (p, n)) -> (p, k): ``value(x + dx) - value(x)`` of each row, worked out so
        that a small dx does not drown in the rounding of a large x.
    jacobian : callable
        x (n,) -> (k, n).
    """

    value: Callable[[Array], Array]
    difference: Callable[[Array, Array], Array]
    jacobian: Callable[[Array], Array]


def linear(matrix: Array, offset: Array | float = 0.0) -> Function:
    """Return ``matrix @ x + offset``, matrix (k, n), as a :class:`Function`."""
    transposed = matrix.T
    return Function(lambda x: matrix @ x + offset, lambda x, dx: dx @ transposed,
                    lambda x: matrix)


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

    By dtrsm, not dtrtrs: OpenBLAS starts threads for the latter whatever the size, and on a busy
    machine waits half a millisecond for them.
    """
    return np.asarray(dtrsm(1.0, factor, values, lower=1))


def mahalanobis(innovation: Array, cov: Array) -> float:
    """Return ``e^T cov^-1 e``, chi-square with k degrees of freedom where all is as modelled."""
    e = whiten(cholesky(cov), innovation[:, None])
    return float((e * e).sum())


def predict(belief: Gaussian, transition: Function, Q: Array) -> Gaussian:
    """
    Carry a belief forward: x = f(x), P = G P G^T + Q, as [Ukf2025] prints it.

    Exact for a linear f. All transitions of this package are linear in the state, so sigma points
    have nothing to add here.
    """
    G = transition.jacobian(belief.mean)
    return Gaussian(transition.value(belief.mean), G @ belief.cov @ G.T + Q)


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


def expect(belief: Gaussian, measurement: Function, R: Array) -> Expected:
    """Foretell a reading by the Jacobian at the mean; ``R`` (k, k) covariance of its noise."""
    H = measurement.jacobian(belief.mean)
    cross = belief.cov @ H.T
    return Expected(measurement.value(belief.mean), H @ cross + R, cross)


def update(belief: Gaussian, reading: Array, measurement: Function, R: Array) -> Gaussian:
    """Take in a reading (k,) whose noise has the covariance ``R`` (k, k)."""
    return condition(belief, expect(belief, measurement, R), reading)
