"""Estimating equations: solve score(theta) = 0, and say how noise in the score spreads."""

from collections.abc import Callable

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
import numpy as np

_SETTLED, _FAR = 1e-3, 0.1
"""Steps in standard errors, the other unknowns held."""


def solve_score(score: Callable[[Array], Array], start: Array, steps: Array,
                iterations: int = 20) -> tuple[Array, Array]:
    """
    Newton's method with central differences, taken afresh while it still takes large steps.

    Parameters
    ----------
    score : callable
        (p,) to (p,); its root is the estimate.
    start : ndarray, shape (p,)
    steps : ndarray, shape (p,)
        Of the differences: a size at which each unknown makes a small difference.
    iterations : int
        At most.

    Returns
    -------
    theta : ndarray, shape (p,)
    jacobian : ndarray, shape (p, p)
        Of the score, there.

    Raises
    ------
    DataError
        It does not converge.
    """
    theta = start.copy()
    far = True
    for _ in range(iterations):
        if far:
            derivative = jacobian(score, theta, steps)
            scale = np.sqrt(np.abs(np.diag(derivative)))
            scale[scale == 0] = 1.0
        scaled = derivative / np.outer(scale, scale)
        move = np.linalg.lstsq(scaled, score(theta) / scale)[0]
        theta = theta - move / scale
        if (np.abs(move) <= _SETTLED).all():
            return theta, jacobian(score, theta, steps)
        far = bool((np.abs(move) > _FAR).any())
    raise DataError(f'the fit does not settle within {iterations} steps; '
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
