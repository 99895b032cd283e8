"""Residuals of a fit, and where they deviate most from noise: an instant, a stretch, all along."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

_STRETCHES = (1, 5, 25, 125, 400)
"""Lengths of the stretches whose means are tested, in values: one to 8 s of 20 ms blocks."""

_WHOLE = 0.6
"""Share of a stretch's values that have to count for its mean to be tested."""


class Residuals(NamedTuple):
    """
    Residuals of a fit, and their noise.

    Attributes
    ----------
    times : ndarray, shape (n,)
        [s]
    values : ndarray, shape (n, k)
        Unit of the signal.
    sigma : ndarray, shape (n, k)
        Noise of each value.
    inflation : ndarray, shape (k,)
        Variance of the mean of n values, times n, over that of one.
    use : ndarray of bool, shape (n,)
        Which of them count.
    """

    times: Array
    values: Array
    sigma: Array
    inflation: Array
    use: NDArray[np.bool_]


class Deviation(NamedTuple):
    """
    The stretch of residuals that deviates most from zero.

    Attributes
    ----------
    sigmas : float
        Of its mean, in standard errors.
    size : float
        Its mean [unit of the signal].
    time : float
        Its middle [s].
    """

    sigmas: float
    size: float
    channel: int
    time: float


def largest_deviation(residuals: Residuals) -> Deviation:
    """
    Find the stretch whose mean deviates most from zero in standard errors, of any length.

    Returns
    -------
    Deviation
        Of 0 standard errors where nothing counts.
    """
    found = Deviation(0.0, 0.0, 0, 0.0)
    use = residuals.use & np.isfinite(residuals.values).all(axis=1)
    z = np.where(use[:, None], residuals.values / residuals.sigma, 0.0)
    sums = np.concatenate([np.zeros((1, z.shape[1])), np.cumsum(z, axis=0)])
    counts = np.concatenate([[0], np.cumsum(use)])
    for length in _STRETCHES:
        if length > len(z):
            break
        n = counts[length:] - counts[:-length]
        whole = n >= _WHOLE * length
        if not whole.any():
            continue
        sigmas = np.abs(sums[length:] - sums[:-length])[whole] / np.sqrt(
            n[whole, None] * residuals.inflation)
        i, channel = (int(j) for j in np.unravel_index(np.argmax(sigmas), sigmas.shape))
        if sigmas[i, channel] > found.sigmas:
            first = int(np.flatnonzero(whole)[i])
            stretch = slice(first, first + length)
            size = residuals.values[stretch, channel][use[stretch]].mean()
            found = Deviation(float(sigmas[i, channel]), float(size), channel,
                              float(residuals.times[stretch].mean()))
    return found
