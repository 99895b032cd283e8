"""Wrench of a rigid body as a linear map of the readings of accelerometer and gyro.

At rest the regressor is gravity alone, [Traversaro2014] Eq. 3-5. Its future work, motion, adds
angular acceleration and products of the angular rate: twelve numbers a sample, in which the wire
wrench (environment on tool) of a rigid body is still linear. The sensor's offset is then estimated
along with the matrix, as the wrench that the matrix makes of it: a thirteenth regressor, 1. (Apart
from it, a constant is almost in the span of twelve regressors when a limb swings like a pendulum.)
"""

from functools import cache

from forcecal_ros.core.geometry import Array, skew
import numpy as np
from numpy.typing import ArrayLike

STATIC, MOVING = 3, 13
"""Number of regressors at rest and in motion."""

PHYSICAL = 10
"""Parameters of a rigid body: mass, moment, inertia."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def moving_regressors(gravity: Array, omega: Array, alpha: Array, position: ArrayLike) -> Array:
    """
    Regressors in motion, for the sensor's origin.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        Minus the accelerometer's specific force, in the sensor frame [m/s^2].
    omega, alpha : ndarray, shape (n, 3)
        Angular rate [rad/s] and acceleration [rad/s^2], in the sensor frame.
    position : array_like, shape (3,)
        Of the accelerometer in the sensor frame [m].

    Returns
    -------
    ndarray, shape (n, 13)
        g - a of the sensor's origin, alpha, wx wx, wy wy, wz wz, wx wy, wx wz, wy wz, and 1.
    """
    p = np.broadcast_to(np.asarray(position, dtype=float), omega.shape)
    at_origin = gravity + np.cross(alpha, p) + np.cross(omega, np.cross(omega, p))
    products = np.stack([omega[:, i] * omega[:, j] for i, j in _PAIRS], axis=1)
    return np.concatenate([at_origin, alpha, products, np.ones((len(alpha), 1))], axis=1)


def gravity_map(mass: float, moment: ArrayLike) -> Array:
    """
    M of [Traversaro2014] Eq. 4-5, M = [m I; m (c x)]: gravity to wrench, both in the sensor frame.

    Parameters
    ----------
    mass : float
        [kg]
    moment : array_like, shape (3,)
        Mass times centre of mass [kg m].

    Returns
    -------
    ndarray, shape (6, 3)
    """
    return np.vstack([mass * np.eye(3), skew(moment)])


def motion_map(mass: float, moment: ArrayLike, inertia: ArrayLike, constant: ArrayLike) -> Array:
    """
    Extend :func:`gravity_map` to motion, on the thirteen regressors.

    Parameters
    ----------
    mass : float
        [kg]
    moment : array_like, shape (3,)
        Mass times centre of mass [kg m].
    inertia : array_like, shape (6,)
        xx, yy, zz, xy, xz, yz about the sensor's origin [kg m^2].
    constant : array_like, shape (6,)
        Wrench that is always there: what the matrix makes of the sensor's offset [N, N m].

    Returns
    -------
    ndarray, shape (6, 13)
    """
    h = np.asarray(moment, dtype=float)
    J = inertia_matrix(inertia)
    out = np.zeros((6, MOVING))
    out[:, :3] = gravity_map(mass, h)
    out[:3, 3:6] = skew(h)
    out[3:, 3:6] = -J
    for k, (i, j) in enumerate(_PAIRS):
        symmetric = np.zeros((3, 3))
        symmetric[i, j] = symmetric[j, i] = 1.0
        square = symmetric - np.trace(symmetric) * np.eye(3)
        out[:3, 6 + k] = -square @ h
        out[3:, 6 + k] = -_rate_torque(i, j, J)
    out[:, 12] = constant
    return out


def _rate_torque(i: int, j: int, J: Array) -> Array:
    """Part of omega x J omega that goes with the product of rates i and j."""
    e = np.eye(3)
    torque = np.cross(e[i], J @ e[j])
    return torque if i == j else torque + np.cross(e[j], J @ e[i])


def inertia_matrix(inertia: ArrayLike) -> Array:
    """Return the symmetric matrix of xx, yy, zz, xy, xz, yz [kg m^2]."""
    J = np.zeros((3, 3))
    for value, (i, j) in zip(np.asarray(inertia, dtype=float), _PAIRS):
        J[i, j] = J[j, i] = value
    return J


def inertia_vector(matrix: ArrayLike) -> Array:
    """Return xx, yy, zz, xy, xz, yz of a symmetric matrix [kg m^2]."""
    return np.array([np.asarray(matrix)[i, j] for i, j in _PAIRS])


def point_inertia(mass: float, position: ArrayLike) -> Array:
    """Return xx, yy, zz, xy, xz, yz of a point mass about the origin [kg m^2]."""
    p = np.asarray(position, dtype=float)
    return inertia_vector(mass * (p @ p * np.eye(3) - np.outer(p, p)))


@cache
def body_basis(regressors: int) -> Array:
    """
    Return the maps of unit body parameters: mass, moment; in motion inertia and constant too.

    Parameters
    ----------
    regressors : int
        3 at rest, 13 in motion.

    Returns
    -------
    ndarray, shape (4, 6, 3) or (16, 6, 13)
        Read-only; see :func:`body_map`.
    """
    if regressors == STATIC:
        basis = np.stack([gravity_map(unit[0], unit[1:]) for unit in np.eye(4)])
    else:
        basis = np.stack([motion_map(unit[0], unit[1:4], unit[4:10], unit[10:])
                          for unit in np.eye(PHYSICAL + 6)])
    basis.setflags(write=False)
    return basis


def body_map(theta: Array, regressors: int) -> Array:
    """
    Map of a body from its parameters, in which it is linear.

    Parameters
    ----------
    theta : ndarray, shape (4,) or (16,)
        Mass [kg], moment [kg m]; in motion also inertia about the origin [kg m^2] and constant
        wrench [N, N m].

    Returns
    -------
    ndarray, shape (6, regressors)
    """
    return np.asarray(np.tensordot(theta, body_basis(regressors), 1))


def load_parameters(mass: float, position: ArrayLike, regressors: int) -> Array:
    """Return the parameters of an added point mass, shape (4,) at rest or (16,) in motion."""
    p = np.asarray(position, dtype=float)
    still = np.concatenate([[mass], mass * p])
    if regressors == STATIC:
        return still
    return np.concatenate([still, point_inertia(mass, p), np.zeros(6)])
