"""Rotations, cross products and wrench transport, in the conventions of this package.

A rotation ``R_a_b`` maps coordinates in frame b to frame a; inside the package rotations are
(3, 3) matrices, at its edges xyzw quaternions as in ROS messages.
"""

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""Magnitude of gravity where nothing else is stated [m/s^2]."""


def skew(v: ArrayLike) -> Array:
    """
    Matrix of the cross product: ``skew(v) @ w == np.cross(v, w)``.

    Parameters
    ----------
    v : array_like, shape (..., 3)
        Any unit.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def rotation_about(axis: str, angle: float) -> Array:
    """
    Elementary rotation, as ``Rot(Y, angle)`` of the paper [Gamez2005] Eq. 9.

    Parameters
    ----------
    axis : str
        One of ``x``, ``y``, ``z``.
    angle : float
        [rad]

    Returns
    -------
    ndarray, shape (3, 3)
    """
    return np.asarray(Rotation.from_euler(axis, angle).as_matrix())


def matrix_from_quaternion(xyzw: ArrayLike) -> Array:
    """
    Rotation matrices of xyzw quaternions, which need not be exactly normalised.

    Parameters
    ----------
    xyzw : array_like, shape (..., 4)

    Returns
    -------
    ndarray, shape (..., 3, 3)

    Raises
    ------
    ValueError
        A quaternion has zero norm.
    """
    return np.asarray(Rotation.from_quat(np.array(xyzw, dtype=float)).as_matrix())


def quaternion_from_matrix(rotation: ArrayLike) -> Array:
    """
    Return xyzw quaternions of rotation matrices.

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 4)
    """
    return np.asarray(Rotation.from_matrix(np.array(rotation, dtype=float)).as_quat())


def read_from_w(R_base_sensor: Array) -> Array:
    """Return orientations as they are if quaternions w, x, y, z were read as x, y, z, w."""
    return matrix_from_quaternion(quaternion_from_matrix(R_base_sensor)[:, [1, 2, 3, 0]])


def quaternion_of(rotation: Array) -> tuple[float, float, float, float]:
    """
    Return the xyzw quaternion of one exact rotation matrix, in plain floats for fast streams.

    Thirty times quicker than :func:`quaternion_from_matrix`, which also mends what is not quite
    a rotation.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)

    Returns
    -------
    tuple of 4 float
        Of unit norm.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)
    largest = max(squares)
    if largest == squares[3]:
        x, y, z, w = h - f, c - g, d - b, largest
    elif largest == squares[0]:
        x, y, z, w = largest, b + d, c + g, h - f
    elif largest == squares[1]:
        x, y, z, w = b + d, largest, f + h, c - g
    else:
        x, y, z, w = c + g, f + h, largest, d - b
    k = 1 / sqrt(x * x + y * y + z * z + w * w)
    return x * k, y * k, z * k, w * k


def rotation_vector(rotation: ArrayLike) -> Array:
    """
    Logarithm on SO(3): the rotation vector of each matrix.

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3)
        [rad], of norm at most pi.
    """
    return np.asarray(Rotation.from_matrix(np.array(rotation, dtype=float)).as_rotvec())


def rotation_from_vector(vector: ArrayLike) -> Array:
    """
    Exponential on SO(3): the matrix of each rotation vector.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
        [rad]

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    return np.asarray(Rotation.from_rotvec(np.array(vector, dtype=float)).as_matrix())
