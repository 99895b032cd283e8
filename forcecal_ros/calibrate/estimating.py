"""Numerical derivatives."""

from collections.abc import Callable

from forcecal_ros.core.geometry import Array
import numpy as np


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
    columns = []
    for i, step in enumerate(steps):
        forward, backward = theta.copy(), theta.copy()
        forward[i] += step
        backward[i] -= step
        columns.append((score(forward) - score(backward)) / (2 * step))
    return np.stack(columns, axis=1)
