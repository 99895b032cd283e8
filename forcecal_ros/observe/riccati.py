"""Stationary Kalman gains by the discrete Riccati equation, detectability checked first."""

from typing import NamedTuple

from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are


class StationaryFilter(NamedTuple):
    """
    Stationary Kalman filter of x' = A x + w, y = C x + v.

    Attributes
    ----------
    gain : ndarray, shape (n, m)
        Of the update ``x += gain (y - C x)``.
    predicted, updated : ndarray, shape (n, n)
        Error covariance before and after the update.
    """

    gain: Array
    predicted: Array
    updated: Array


def undetectable_states(A: Array, C: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """
    Name the states that no measurement will ever correct although they do not fade.

    Hautus' test: a mode of ``A`` on or outside the unit circle must be seen by ``C``. The modes'
    tolerance allows for the integrators' multiple eigenvalue 1, which rounding spreads.

    Parameters
    ----------
    A : ndarray, shape (n, n)
    C : ndarray, shape (m, n)
    names : tuple of str
        One for each state.

    Returns
    -------
    tuple of str
        States that take part in an unseen mode; empty when the pair is detectable.
    """
    n = len(A)
    scale = np.max(np.abs(C), axis=1, keepdims=True)
    C = C / np.where(scale > 0, scale, 1.0)
    unseen = np.zeros(n, dtype=bool)
    for mode in np.linalg.eigvals(A):
        if abs(mode) < 1.0 - 1e-6:
            continue
        mode = 1.0 if abs(mode - 1.0) < 1e-4 else mode
        _, sigma, vh = np.linalg.svd(np.vstack([mode * np.eye(n) - A, C]))
        for vector in vh[sigma < 1e-9 * max(1.0, sigma[0])]:
            unseen |= np.abs(vector) > 1e-6
    return tuple(name for name, hit in zip(names, unseen) if hit)


def stationary_filter(
        A: Array, C: Array, Q: Array, R: Array, names: tuple[str, ...],
        S: Array | None = None) -> StationaryFilter:
    """
    Design the stationary Kalman filter, after making sure that there is one.

    Riccati solvers answer for undetectable pairs as well, with a number that looks like a
    standard deviation and means nothing.

    Parameters
    ----------
    A, C : ndarray, shapes (n, n), (m, n)
    Q, R : ndarray, shapes (n, n), (m, m)
        Covariances of w and v.
    names : tuple of str
        One for each state.
    S : ndarray, shape (n, m), optional
        Covariance of w with v of the same instant.

    Returns
    -------
    StationaryFilter

    Raises
    ------
    UnobservableError
        A state is not detectable, or the equation has no stabilising solution.
    """
    lost = undetectable_states(A, C, names)
    if lost:
        raise UnobservableError(
            f'{", ".join(lost)} cannot be told from the measurements at hand '
            f'({len(A)} states, {len(C)} measurements); '
            'add the pose, or leave the accelerometer offset out (observer offset: off)')
    try:
        P = solve_discrete_are(A.T, C.T, Q, R, s=S)
    except LinAlgError as error:
        raise UnobservableError(
            f'no stationary gain for {", ".join(names)}: {error}; check the covariances') from None
    innovation = C @ P @ C.T + R
    gain = np.linalg.solve(innovation, C @ P).T
    return StationaryFilter(gain, P, P - gain @ innovation @ gain.T)
