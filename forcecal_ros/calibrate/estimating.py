"""Estimating equations: solve score(theta) = 0, and say how noise in the score spreads."""

from collections.abc import Callable

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
import numpy as np

_STEPS = 20
"""Newton's method doubles its digits with each step; what needs more does not converge."""

_SETTLED = 0.05
"""Last step, in standard errors with the other unknowns held; the next is a hundredth of it."""


def solve_score(score: Callable[[Array], Array], slope: Callable[[Array], Array], start: Array
                ) -> tuple[Array, Array]:
    """
    Newton's method.

    Parameters
    ----------
    score : callable
        (p,) to (p,); its root is the estimate.
    slope : callable
        (p,) to (p, p): derivative of the score, noise left out where that makes a difference.
    start : ndarray, shape (p,)

    Returns
    -------
    theta : ndarray, shape (p,)
    slope : ndarray, shape (p, p)
        There.

    Raises
    ------
    DataError
        It does not converge.
    """
    theta = start.copy()
    for _ in range(_STEPS):
        derivative = slope(theta)
        scale = np.sqrt(np.abs(np.diag(derivative)))
        scale[scale == 0] = 1.0
        scaled = derivative / np.outer(scale, scale)
        move = np.linalg.lstsq(scaled, score(theta) / scale, rcond=None)[0]
        theta = theta - move / scale
        if (np.abs(move) <= _SETTLED).all():
            return theta, derivative
    raise DataError(f'the fit does not settle within {_STEPS} steps; '
                    'the recording may hold contact in phases of free motion')


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
