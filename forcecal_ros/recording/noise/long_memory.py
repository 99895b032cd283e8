"""Noise with a long memory, such as 1/f: how much of it its own past predicts."""

from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

SPANS = ((1, 16), (16, 64), (64, 256), (256, 1024))
"""Past blocks whose means predict slow noise, from and up to."""


def unpredicted(values: Array, rows: NDArray[np.bool_]) -> float:
    """
    Sum of squares that the means of the past do not predict.

    A heterogeneous autoregression (Corsi, J. Financial Econometrics 7, 2009): four means over
    ever longer spans stand for the thousand coefficients of a long memory.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rows : ndarray of bool, shape (n,)
        Which of them are predicted; their past may be any.
    """
    sums = np.concatenate([[0.0], np.cumsum(values)])
    now = np.arange(len(values))
    past = np.stack([(sums[np.maximum(now - first + 1, 0)] - sums[np.maximum(now - last + 1, 0)])
                     / (last - first) for first, last in SPANS], axis=1)[rows]
    w = values[rows]
    gram = past.T @ past + 1e-9 * np.eye(len(SPANS))
    vector = past.T @ w
    return float(w @ w - vector @ np.linalg.solve(gram, vector))
