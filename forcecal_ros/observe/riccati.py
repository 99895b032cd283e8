"""Stationary Kalman gains by the discrete Riccati equation, detectability checked first."""

from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.linalg import solve_discrete_are


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

    An unobservable subspace is harmless only where everything in it decays. A is (n, n), C
    (m, n), with one name for each state; none is returned when the pair is detectable.
    """
    n = len(A)
    scale = np.max(np.abs(C), axis=1, keepdims=True)
    rows = C / np.where(scale > 0, scale, 1.0)
    # A - 1 sees the same as A does, and short periods do not drown in the 1
    change = A - np.eye(n)
    change = change / max(float(np.abs(change).max()), 1e-300)
    seen = np.vstack([rows @ np.linalg.matrix_power(change, i) for i in range(n)])
    _, sigma, vh = np.linalg.svd(seen)
    unseen = vh[np.count_nonzero(sigma > 1e-9 * sigma[0]):].T
    modes = np.linalg.eigvals(unseen.T @ A @ unseen) if unseen.size else np.zeros(0)
    return tuple(name for name, part in zip(names, np.abs(unseen).max(axis=1, initial=0.0))
                 if part > 1e-6 and np.abs(modes).max(initial=0.0) > 1 - 1e-6)


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
    names
        One for each state.
    S : ndarray, shape (n, m), optional
        Covariance of w with v of the same instant.

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
            'leave the accelerometer offset out (observer offset: off)')
    try:
        P = solve_discrete_are(A.T, C.T, Q, R, s=S)
    except ValueError as error:  # LinAlgError is one; reordering the pencil raises others
        raise UnobservableError(
            f'no stationary gain for {", ".join(names)}: {error}; check the covariances') from None
    innovation = C @ P @ C.T + R
    gain = np.linalg.solve(innovation, C @ P).T
    return StationaryFilter(gain, P, P - gain @ innovation @ gain.T)
