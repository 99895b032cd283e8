"""Gaussian evidence from Gram matrices: bounded fits and marginal likelihoods."""

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrs, dtrtri


class Gram(NamedTuple):
    """
    Inner products of whitened columns and of the whitened residual.

    Attributes
    ----------
    matrix : ndarray, shape (k, k)
    vector : ndarray, shape (k,)
        Columns times residual.
    square : float
        Of the residual.
    n : int
        Samples that count.
    log_det : float
        Of the covariance in that of noise alone, where a discrepancy is integrated out.
    """

    matrix: Array
    vector: Array
    square: float
    n: int
    log_det: float = 0.0

    def __add__(self, other: object) -> 'Gram':
        """Join two independent sets of samples."""
        assert isinstance(other, Gram)
        return Gram(self.matrix + other.matrix, self.vector + other.vector,
                    self.square + other.square, self.n + other.n,
                    self.log_det + other.log_det)

    def residual_squares(self, x: Array) -> float:
        """Return the sum of squares that columns with coefficients ``x`` leave."""
        return float(self.square - 2.0 * self.vector @ x + x @ self.matrix @ x)

    def of(self, index: NDArray[np.intp]) -> 'Gram':
        """Keep some columns only."""
        return self._replace(matrix=self.matrix[np.ix_(index, index)],
                             vector=self.vector[index])


class Prior(NamedTuple):
    """
    Independent Gaussian priors with bounds.

    Attributes
    ----------
    centre : ndarray, shape (k,)
        Where the columns were taken: the prior is on ``centre + x``.
    precision : ndarray, shape (k,)
    low, high : ndarray, shape (k,)
        Between which ``centre + x`` lies.
    """

    centre: Array
    precision: Array
    low: Array
    high: Array


class Earlier(NamedTuple):
    """
    What earlier recordings of the same robot found: log-evidences of the same explanations add.

    Attributes
    ----------
    evidence : mapping of frozenset of str to float
        Of each explanation, by the names of its effects, against the best one.
    missing : float
        Log-evidence that a model without any flaw would have more.
    numbers : mapping of str to mapping of str to (float, float)
        Parameters of effects, with their standard errors: a prior of effects that have their own.
    """

    evidence: Mapping[frozenset[str], float] = MappingProxyType({})
    missing: float = 0.0
    numbers: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType({})

    def of(self, names: Collection[str]) -> float:
        """Return that of an explanation; one that is not listed had no more than the least."""
        return self.evidence.get(frozenset(names), min(self.evidence.values(), default=0.0))


FIRST_RECORDING = Earlier()
"""Of a robot of which nothing was recorded earlier."""


class Fit(NamedTuple):
    """
    Outcome of a bounded fit.

    Attributes
    ----------
    x : ndarray, shape (k,)
        Step from the centre.
    log_evidence : float
        Marginal likelihood of the data, less that of pure noise's constant.
    volume : float
        Part of it that the parameters' uncertainty costs: it grows with what the data tell.
    free : ndarray of bool, shape (k,)
        Parameters that are not on their bound.
    factor : ndarray
        Cholesky factor of the information on these.
    """

    x: Array
    log_evidence: float
    volume: float
    free: NDArray[np.bool_]
    factor: Array

    @property
    def covariance(self) -> Array:
        """Covariance, shape (k, k): zero for parameters on their bound."""
        out = np.zeros((len(self.x),) * 2)
        if len(self.factor):
            inverse = dtrtri(self.factor, lower=1)[0]
            out[np.ix_(self.free, self.free)] = inverse.T @ inverse
        return out

    def marginal_covariance(self, gram: Gram, prior: Prior, least: Array, spread: Array) -> Array:
        """
        Return the covariance of parameters whatever the others are, shape (k, k).

        A parameter that stops at a limit of its tolerance is not known to be there. So the others
        vary with it, and each may be as far off as it would move without that limit.

        Parameters
        ----------
        gram, prior
            Of this fit.
        least : ndarray, shape (k,)
            What no parameter can be below.
        spread : ndarray, shape (k, k)
            Covariance of the products of columns and residual beside noise.
        """
        every = fit(gram, prior._replace(low=least, high=np.full(len(least), np.inf)), self)
        known = every.covariance
        known = known + known @ spread @ known + np.diag((every.x - self.x) ** 2)
        return np.asarray(known * np.outer(self.free, self.free))


def fit(gram: Gram, prior: Prior, near: Fit | None = None) -> Fit:
    """
    Fit with Gaussian priors, parameters kept within their bounds by an active set.

    After as many turns as there are parameters none is released from its bound any more.

    Parameters
    ----------
    near : Fit, optional
        Of the first parameters to like data: those on their bound begin there.
    """
    k = len(gram.vector)
    hessian = gram.matrix + np.diag(prior.precision)
    gradient = gram.vector - prior.precision * prior.centre
    low, high = prior.low - prior.centre, prior.high - prior.centre
    x, free = np.clip(np.zeros(k), low, high), np.ones(k, dtype=bool)
    if near is not None:
        m = len(near.x)
        free[:m] = near.free
        x[:m] = np.clip(near.x, low[:m], high[:m])
        free[:m] |= np.minimum(np.abs(x - low), np.abs(x - high))[:m] > 1e-9
    factor = np.zeros((0, 0))
    for _ in range(4 * k + 1):
        right = gradient[free] - hessian[free] @ np.where(free, 0.0, x)
        factor = _cholesky(hessian[free][:, free])
        step = np.zeros(k)
        step[free] = (dpotrs(factor, right, lower=1)[0] if len(right) else right) - x[free]
        # as far as to the first bound, so that every step is for the better
        with np.errstate(divide='ignore', invalid='ignore'):
            part = np.where(step > 1e-9, (high - x) / step, np.where(
                step < -1e-9, (low - x) / step, np.inf))
        first = float(part.min(initial=np.inf))
        if first < 1.0:
            hit = part <= first
            x = np.where(hit, np.where(step > 0.0, high, low), x + first * step)
            free &= ~hit
            continue
        x = x + step
        # on its bound, but held there by nothing: the other parameters have moved since
        inwards = np.where(x < high, 1.0, -1.0)
        inward = ~free * inwards * (gradient - hessian @ x)
        if not inward.max(initial=0.0) > 1e-6:
            break
        free[inward.argmax()] = True
    total = prior.centre + x
    value = gram.vector @ x - 0.5 * x @ gram.matrix @ x
    value -= 0.5 * (total * prior.precision) @ total + 0.5 * gram.square
    value -= 0.5 * gram.log_det
    volume = float(np.log(np.diag(factor)).sum() - 0.5 * np.log(prior.precision[free]).sum())
    return Fit(x, float(value) - volume, volume, free, factor)


def _cholesky(matrix: Array) -> Array:
    if not len(matrix):
        return matrix
    scale = 1.0 / np.sqrt(np.diag(matrix))
    factor = np.linalg.cholesky(matrix * np.outer(scale, scale) + 1e-12 * np.eye(len(matrix)))
    return np.asarray(factor / scale[:, np.newaxis])
