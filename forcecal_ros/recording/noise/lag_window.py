"""
Lag windows (kernels) that weigh an estimated autocovariance, and how many lags they take.

Far lags are mostly estimation noise. A window that falls off keeps the sum over lags, a long-run
variance, from being mostly that.
"""

from forcecal_ros.geometry import Array
import numpy as np
from scipy.special import ndtri

BANDWIDTH = 2.3
"""Factor of Andrews' rule, twice his: recordings hold few periods of their slowest motion."""

MOST_LAGS = 0.25
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
            # what has begun to fade goes on for a while below what can be told from nothing
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
    return int(min(np.ceil(BANDWIDTH * (alpha * samples) ** (1 / 3)), MOST_LAGS * samples))


def _persistence(residuals: Array, lag: int, samples: int) -> float:
    """AR(1) coefficient that the correlation at a lag stands for; later lags see past noise."""
    power = (residuals ** 2).sum(axis=0)
    products = (residuals[lag:] * residuals[:-lag]).sum(axis=0)
    strongest = float((products[power > 0] / power[power > 0]).max(initial=0.0))
    if lag > 1 and strongest < 2.5 / np.sqrt(samples):
        return 0.0
    return float(np.clip(strongest, 0.0, 1.0) ** (1 / lag)) * MOST_PERSISTENT
