"""The white part of a signal's noise, and what rounding to steps leaves of it in a mean."""

from math import comb

from forcecal_ros.core.geometry import Array
import numpy as np


def difference_gain(order: int) -> int:
    """Variance of the d-th difference of white noise over that of the noise: 2, 6, 20, ..."""
    return comb(2 * order, order)


def white_covariance(values: Array, order: int = 2) -> Array:
    """
    Covariance of the white noise in a signal that is smooth otherwise.

    Differences subtract what is smooth, the better the higher their order; vibration near the
    sampling rate counts as noise.

    Parameters
    ----------
    values : ndarray, shape (n, k)
    order : int
        Of the differences.

    Returns
    -------
    ndarray, shape (k, k)
    """
    d = np.diff(values, order, axis=0)
    return np.asarray(d.T @ d / (len(d) * difference_gain(order)))


_HARMONICS = np.arange(1, 200)
"""Of the sawtooth that rounding is: without noise the first 199 hold 99.7 % of its variance."""


def rounding_variance(step: float, variance: float) -> float:
    """
    Variance of the mean of rounded readings about the mean of what is rounded.

    Rounding errors repeat in every reading as far as noise does not spread them over steps: with
    white noise of a level that lies anywhere within a step q, the k-th harmonic of the error,
    q / (pi k), is damped by exp(-2 (pi k sigma / q)^2) (Widrow and Kollar, Quantization Noise,
    Cambridge 2008, chapter 4).

    Parameters
    ----------
    step : float
        Unit of the signal.
    variance : float
        Of the rounded readings within a level, rounding included.
    """
    if step <= 0.0:
        return 0.0
    within = variance / step**2
    # of all that rounding and noise do, s^2 + 1/12, what repeats in every reading is not within
    low, high = 0.0, within + 1.0
    for _ in range(50):
        middle = (low + high) / 2.0
        low, high = ((middle, high) if middle + 1.0 / 12.0 - _repeated(middle) < within
                     else (low, middle))
    return step**2 * _repeated(low)


def _repeated(square: float) -> float:
    """Variance of the error that repeats in every reading, of noise by its square, for step 1."""
    damped: Array = np.exp(-(2.0 * np.pi * _HARMONICS)**2 * square) / (np.pi * _HARMONICS)**2
    return float(damped.sum() / 2.0)
