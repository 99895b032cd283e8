"""The paper's observer: its matrices, and its gain by Riccati equation or by pole placement.

Model, [Gamez2005] Eq. 5 with xi = [x, dx/dt], u the force of the robot on the tool and F that
of the tool on its environment:

    d xi/dt = A xi + B (u - F)
    y = C xi + D_u u + D_F F,    y = [x, dx/dt, d2x/dt2],    d2x/dt2 = (u - F) / m

Observer d xi^/dt = A xi^ + B u + K (y - C xi^ - D_u u), whose error xi~ = xi - xi^ obeys

    d xi~/dt = (A - K C) xi~ - (B + K D_F) F                               [Gamez2005] Eq. 4

(in print y stands for y - C xi). The third row of C is zero, so the third column of K cannot
move A - K C: setting k23 = 1 leaves the stability alone, and with B + K D_F = [-k13, 1 - k23] / m
it takes F out of the second equation.
"""

from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.linalg import solve_continuous_are

A = np.array([[0.0, 1.0], [0.0, 0.0]])
C = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
for _matrix in (A, C):
    _matrix.setflags(write=False)

STATES = ('position', 'velocity')


class ObserverModel(NamedTuple):
    """Matrices of [Gamez2005] Eq. 5; shapes (2, 2), (2,), (3, 2), (3,), (3,)."""

    A: Array
    B: Array
    C: Array
    D_u: Array
    D_F: Array


def observer_model(mass: float) -> ObserverModel:
    """
    Tool dynamics along x, [Gamez2005] Eq. 5.

    Parameters
    ----------
    mass : float
        [kg]
    """
    third = np.array([0.0, 0.0, 1 / mass])
    return ObserverModel(A, np.array([0.0, 1 / mass]), C, third, -third)


def error_dynamics(model: ObserverModel, K: Array) -> tuple[Array, Array]:
    """
    Matrices of the observer's error, [Gamez2005] Eq. 4.

    Parameters
    ----------
    K : ndarray, shape (2, 3)

    Returns
    -------
    tuple of ndarray, shapes (2, 2), (2,)
        d xi~/dt = first xi~ + second F.
    """
    return model.A - K @ model.C, -(model.B + K @ model.D_F)


def check_detectable(A: Array, C: Array, names: tuple[str, ...]) -> None:
    """
    Refuse a design for states that no measurement corrects although they do not fade.

    Riccati solvers answer for such pairs as well. Hautus' test in continuous time.

    Parameters
    ----------
    A, C : ndarray, shapes (n, n), (m, n)
    names : tuple of str
        Of the states.

    Raises
    ------
    UnobservableError
        Names the states.
    """
    n = len(A)
    size = max(float(np.abs(A).max()), 1e-12)
    unseen: set[str] = set()
    for mode in np.linalg.eigvals(A):
        if mode.real < -1e-9 * size:
            continue
        mode = 0.0 if abs(mode) < 1e-6 * size else mode
        _, sigma, vh = np.linalg.svd(np.vstack([mode * np.eye(n) - A, C]))
        for vector in vh[sigma < 1e-9 * max(1.0, sigma[0])]:
            unseen |= {names[i] for i in np.flatnonzero(np.abs(vector) > 1e-6)}
    if unseen:
        raise UnobservableError(
            f'{", ".join(name for name in names if name in unseen)} cannot be told from the '
            f'{len(C)} measurements of the observer; add the measurement that sees it')


def riccati_gain(A: Array, C: Array, Q: Array, R: Array,
                 names: tuple[str, ...] = STATES) -> Array:
    """
    Gain K = P C^T R^-1 with P A^T + A P - P C^T R^-1 C P + Q = 0.

    [Gamez2005] Eq. 18 and [Gamez2005] Eq. 19 (in the text before: [Gamez2005] Eq. 7 and
    [Gamez2005] Eq. 8).

    Parameters
    ----------
    A, C : ndarray, shapes (n, n), (m, n)
    Q, R : ndarray, shapes (n, n), (m, m)
        Continuous covariances of Eq. 6.
    names : tuple of str
        Of the states, for the message.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    UnobservableError
        Not detectable, R is singular, or Q and R lie too far apart.
    """
    check_detectable(A, C, names)
    scale = np.sqrt(np.diag(R))
    if not (scale > 0).all() or np.linalg.cond(R / np.outer(scale, scale)) > 1e12:
        raise UnobservableError('R is singular: a measurement without any noise, or two that '
                                'carry the same; record the sensors at their own resolution')
    # measurements in units of their own noise: metres and m/s^2 lie ten decades apart
    c, r = C / scale[:, np.newaxis], R / np.outer(scale, scale)
    try:
        K = np.linalg.solve(r, c @ solve_continuous_are(A.T, c.T, Q, r)).T
    except ValueError as error:  # LinAlgError is one; reordering the pencil raises others
        raise UnobservableError(f'no stationary gain for these covariances ({error}); they lie '
                                'too many decades apart: check the units') from error
    if not np.isfinite(K).all():
        raise UnobservableError('no finite gain for these covariances; check their units')
    return K / scale


def pole_gain(A: Array, C: Array, poles: tuple[float, ...]) -> Array:
    """
    Gain that puts the poles of A - K C where they are wanted, the paper's other way.

    Parameters
    ----------
    A, C : ndarray, shapes (2, 2), (3, 2)
    poles : tuple of float
        [1/s]

    Returns
    -------
    ndarray, shape (2, 3)
        Its third column is zero: that one moves no pole.
    """
    from scipy.signal import place_poles  # takes a second, and the other way needs none of it

    K = np.zeros((len(A), len(C)))
    seen = np.abs(C).any(axis=1)
    K[:, seen] = place_poles(A.T, C[seen].T, poles).gain_matrix.T
    return K


def with_unit_k23(K: Array) -> Array:
    """Return K with k23 = 1, step 11 of the procedure: Newton's law in Eq. 3."""
    K = np.array(K, dtype=float)
    K[1, 2] = 1.0
    return K
