"""
Autocovariance of coloured noise, and the variance of means and weighted sums that follows from it.

A variance of a sum of correlated terms is a sum over lags; with the lags of a sample it is the
HAC estimate (heteroskedasticity and autocorrelation consistent: Newey and West, Econometrica 55,
1987).

Far lags are mostly estimation noise. A window that falls off keeps the sum over lags, a long-run
variance, from being mostly that.
"""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.special import ndtri

SHORTEST = 10
"""Blocks in a row that noise can be measured on."""

MOST_LAGS = 24
"""Blocks over which noise at standstill may be correlated, half a second of 20 ms each."""

_FINEST = 1e-7
"""Standard deviation of noise, as a share of the largest reading, that is taken for rounding."""


class Autocovariance(NamedTuple):
    """
    Estimate for a stationary noise e of k channels.

    Attributes
    ----------
    lags : ndarray, shape (1 + m, k, k)
        E[e_n e_(n + l)^T] for l = 0..m.
    weights : ndarray, shape (m,)
        Lag window at 1..m.
    """

    lags: Array
    weights: Array

    @property
    def covariance(self) -> Array:
        """Of one sample, shape (k, k)."""
        return np.asarray(self.lags[0])

    @property
    def long_run(self) -> Array:
        """Long-run covariance: n times that of a mean of n samples, shape (k, k)."""
        return self._over_lags(lambda lag: self.lags[lag])

    @property
    def at_least_white(self) -> Array:
        """
        Long-run covariance, shape (k, k), in no direction below that of white noise.

        A few hundred values show some direction of six as anticorrelated by chance, whose mean
        would be known too well.
        """
        rounding = max(1e-12 * float(np.trace(self.covariance)), np.finfo(float).tiny)
        factor = np.linalg.cholesky(self.covariance + rounding * np.eye(len(self.covariance)))
        inverse = np.linalg.inv(factor)
        values, vectors = np.linalg.eigh(inverse @ self.long_run @ inverse.T)
        root = factor @ vectors * np.sqrt(values.clip(min=1.0))
        return np.asarray(root @ root.T)

    def covariance_of_products(self, regressors: Array) -> Array:
        """
        Covariance of the sum of ``kron(regressors[n], e[n])``, the scores of a linear regression.

        Parameters
        ----------
        regressors : ndarray, shape (n, q)

        Returns
        -------
        ndarray, shape (q k, q k)
        """
        return self._over_lags(
            lambda lag: np.asarray(np.kron(_lagged(regressors, lag), self.lags[lag])))

    def _over_lags(self, term: Callable[[int], Array]) -> Array:
        total = term(0).copy()
        for lag, weight in enumerate(self.weights, 1):
            part = term(lag)
            total += weight * (part + part.T)
        return total


def _lagged(values: Array, lag: int) -> Array:
    return np.asarray(values[:len(values) - lag].T @ values[lag:])


def noise_of_windows(windows: list[Array]) -> Autocovariance:
    """
    Measure the noise of block means while nothing moves.

    The mean of each window is removed, and the bias that leaves behind is put right. As many
    lags are kept as stand out of what white noise would show: none for white noise, whose
    long-run variance they would only make worse.

    Parameters
    ----------
    windows : list of ndarray, shape (n_i, k)
        Consecutive blocks of each window; NaN rows are left out.

    Raises
    ------
    DataError
        No window is long enough.
    """
    windows = [w for w in windows if np.isfinite(w).all(1).sum() >= SHORTEST]
    if not windows:
        raise DataError(f'each standstill has fewer than {SHORTEST} blocks of samples, too few to '
                        'measure noise; hold each pose for 1 s or more')
    whole = [np.isfinite(w).all(1) for w in windows]
    clean = [np.where(ok[:, None], w - w[ok].mean(axis=0), 0.0) for w, ok in zip(windows, whole)]
    n = sum(int(ok.sum()) for ok in whole)
    longest = min(MOST_LAGS, min(len(w) for w in windows) // 3)
    pairs = np.array([max(1, sum(int((ok[:len(ok) - lag] & ok[lag:]).sum()) for ok in whole))
                      for lag in range(longest + 1)])
    lags = np.stack([np.asarray(sum(_lagged(c, lag) for c in clean)) / pairs[lag]
                     for lag in range(longest + 1)])
    finest = (_FINEST * max(float(np.nanmax(np.abs(w))) for w in windows))**2
    lags[0] += max(finest, 1e-300) * np.eye(lags.shape[1])
    # the mean of a window of T blocks takes a T-th of the variance off every lag of white noise
    m = last_correlated_lag(lags + lags[0] * len(windows) / n, n)
    raw = Autocovariance(lags[:1 + 2 * m], flat_top(m))
    shortfall = raw.long_run / max(n / len(windows) - (1 + 2 * raw.weights.sum()), 1.0)
    return raw._replace(lags=raw.lags + shortfall)


def noise_of_residuals(residuals: Array, lags: int, samples: int | None = None) -> Autocovariance:
    """
    Measure the noise that a fit leaves, its misfit included: no mean is subtracted.

    Parameters
    ----------
    residuals : ndarray, shape (n, k)
        Consecutive; zero where there is none.
    lags : int
        Of the Bartlett window.
    samples : int, optional
        How many residuals there are; n unless given.
    """
    lags = min(lags, len(residuals) - 1)
    return Autocovariance(
        np.stack([_lagged(residuals, lag) for lag in range(lags + 1)])
        / (len(residuals) if samples is None else samples), bartlett(lags))


BANDWIDTH = 2.3
"""Factor of Andrews' rule, twice his: recordings hold few periods of their slowest motion."""

LONGEST_SHARE = 0.25
"""Share of a series that the longest lag of Andrews' rule may reach."""

MOST_PERSISTENT = 0.98
"""AR(1) coefficient that full correlation is taken for; at 1 the rule's bandwidth is infinite."""

ACCIDENT = 0.01
"""
Probability that white noise of all channels seems correlated.

Politis' rule is made for one series: six channels of three seconds seemed so one time in nine, and
their long-run variance then came out at half of what it was or less.
"""

_QUIET_RUN = 5
"""Lags in a row that look like white noise and so end the correlation (Politis: K = 5)."""


def bartlett(lags: int) -> Array:
    """
    Triangular weights of lags 1..m (Newey and West, Econometrica 55, 1987).

    Sums of sample autocovariances that are divided by the full length stay positive.
    """
    return np.asarray(1 - np.arange(1, lags + 1) / (lags + 1))


def flat_top(lags: int) -> Array:
    """
    Weights of lags 1..2m: 1 up to m, then falling (Politis, Romano, J. Time Ser. Anal. 16, 1995).

    Hardly biased where the correlation ends by lag m; sums may come out negative.
    """
    return np.minimum(1.0, 2 - np.arange(1, 2 * lags + 1) / max(lags, 1))


def last_correlated_lag(lags: Array, samples: int) -> int:
    """
    Bandwidth m of :func:`flat_top` (Politis, J. Nonparametric Statistics 15, 2003).

    Parameters
    ----------
    lags : ndarray, shape (1 + l, k, k)
        Sample autocovariance.
    samples : int
        It was measured on.

    Returns
    -------
    int
        Last lag before a run of five at which no channel stands out of white noise; 0: white.
    """
    variance = np.diagonal(lags[0]).copy()
    variance[variance == 0] = 1.0
    chance = -ndtri(ACCIDENT / (2 * _QUIET_RUN * len(variance)))
    stands_out = np.abs(np.diagonal(lags, axis1=1, axis2=2) / variance).max(axis=1) \
        > max(chance, 2 * np.sqrt(np.log10(max(samples, 10)))) / np.sqrt(samples)
    most = (len(lags) - 1) // 2
    for m in range(most):
        if not stands_out[m + 1:m + 1 + _QUIET_RUN].any():
            # what has begun to fade goes on for a while below what is significant
            return min(m + 1, most) if m else 0
    return most


def andrews_lags(residuals: Array, samples: int) -> int:
    """
    Bandwidth of :func:`bartlett` by the most persistent channel (Andrews, Econometrica 59, 1991).

    Parameters
    ----------
    residuals : ndarray, shape (n, k)
        Zero where there is none.
    samples : int
        How many there are.
    """
    rho = max(_persistence(residuals, lag, samples) for lag in (1, 4))
    alpha = 4 * rho ** 2 / (1 - rho ** 2) ** 2
    return int(min(np.ceil(BANDWIDTH * (alpha * samples) ** (1 / 3)), LONGEST_SHARE * samples))


def _persistence(residuals: Array, lag: int, samples: int) -> float:
    """AR(1) coefficient that the correlation at a lag represents; later lags see past noise."""
    power = (residuals ** 2).sum(axis=0)
    products = (residuals[lag:] * residuals[:-lag]).sum(axis=0)
    strongest = float((products[power > 0] / power[power > 0]).max(initial=0.0))
    if lag > 1 and strongest < 2.5 / np.sqrt(samples):
        return 0.0
    return float(np.clip(strongest, 0.0, 1.0) ** (1 / lag)) * MOST_PERSISTENT
