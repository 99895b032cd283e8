"""The white part of a signal's noise, from differences, whether the signal moves or not."""

from math import comb

from forcecal_ros.geometry import Array
import numpy as np


def difference_gain(order: int) -> int:
    """Variance of the d-th difference of white noise over that of the noise: 2, 6, 20, ..."""
    return comb(2 * order, order)


def white_covariance(values: Array, order: int = 2) -> Array:
    """
    Covariance of the white noise in a signal that is smooth otherwise.

    Differences take off what is smooth, the better the higher their order; vibration near the
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
