"""Rotations, cross products and wrench transport, in the conventions of this package.

A rotation ``R_a_b`` maps coordinates in frame b to frame a; inside the package rotations are
(3, 3) matrices, at its edges xyzw quaternions as in ROS messages.
"""

from math import sqrt

from forcecal_ros.core.schema import Vector7
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

Vector = tuple[float, float, float]
"""Of plain floats, for streams: an array costs more than some ten operations."""

Quaternion = tuple[float, float, float, float]
"""xyzw."""

ZERO: Vector = (0.0, 0.0, 0.0)

ITSELF: Vector7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Pose of a frame in itself."""

POSE_LENGTH = 7
"""A pose is so many numbers in a flat list: x y z [m], qx qy qz qw."""

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


def continuous_sign(xyzw: Array) -> Array:
    """
    Choose the sign of each quaternion so that it follows on the one before.

    Parameters
    ----------
    xyzw : ndarray, shape (n, 4)

    Returns
    -------
    ndarray, shape (n, 4)
    """
    turned = np.einsum('ni,ni->n', xyzw[1:], xyzw[:-1]) < 0.0
    return np.asarray(xyzw * np.cumprod(np.append(1.0, 1.0 - 2.0 * turned))[:, np.newaxis])


def quaternion_of(rotation: Array) -> tuple[float, float, float, float]:
    """
    Return the xyzw quaternion of one exact rotation matrix, in plain floats for fast streams.

    Thirty times quicker than :func:`quaternion_from_matrix`, which also corrects what is not quite
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
    R = np.array(rotation, dtype=float)
    sine = 0.5 * np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0],
                           R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    size, cosine = np.linalg.norm(sine, axis=-1), 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(size, cosine)
    ratio = np.where(size > 0.0, angle / np.where(size > 0.0, size, 1.0), 1.0)
    out = sine * ratio[..., np.newaxis]
    far = cosine < 0.0  # about half a turn the sine shows little of the axis
    if far.any():
        out[far] = Rotation.from_matrix(R[far]).as_rotvec()
    return np.asarray(out)


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


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return ``R v``: the coordinates in base of a vector given in ft_sensor."""
    x, y, z, w = q
    vx, vy, vz = v
    tx = 2 * (y * vz - z * vy)
    ty = 2 * (z * vx - x * vz)
    tz = 2 * (x * vy - y * vx)
    return (vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx)


def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """Return ``R^T v``: the coordinates in ft_sensor of a vector given in base."""
    return rotate((-q[0], -q[1], -q[2], q[3]), v)


def compose(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the turn b followed by a, both about axes that stay."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (aw * bx + bw * ax + ay * bz - az * by, aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx, aw * bw - ax * bx - ay * by - az * bz)


def combine(a: tuple[float, ...], b: Vector7) -> Vector7:
    """
    Return the pose ``b``, given in the frame that has the pose ``a``, where ``a`` is given.

    Parameters
    ----------
    a, b : tuple of 7 float
        x y z [m] qx qy qz qw; of many instants, arrays in place of numbers.
    """
    x, y, z, i, j, k, r = a
    u, v, w = rotate((i, j, k, r), b[:3])
    return (x + u, y + v, z + w, *compose((i, j, k, r), b[3:]))


def invert(pose: Vector7) -> Vector7:
    """Return the pose of the frame that a pose is given in, in the frame that has it."""
    i, j, k, r = pose[3:]
    x, y, z = rotate_back(pose[3:], pose[:3])
    return (-x, -y, -z, -i, -j, -k, r)


def advance_rotation(q: Quaternion, dx: float, dy: float, dz: float) -> Quaternion:
    """Turn ``q`` by a small rotation vector given in ft_sensor [rad], and normalise."""
    x, y, z, w = q
    hx, hy, hz = dx / 2, dy / 2, dz / 2
    h2 = hx * hx + hy * hy + hz * hz
    k = 1 - h2 / 6 + h2 * h2 / 120
    hx, hy, hz = hx * k, hy * k, hz * k
    hw = sqrt(max(0.0, 1 - h2 * k * k))
    x, y, z, w = (w * hx + x * hw + y * hz - z * hy,
                  w * hy - x * hz + y * hw + z * hx,
                  w * hz + x * hy - y * hx + z * hw,
                  w * hw - x * hx - y * hy - z * hz)
    n = 1 / sqrt(x * x + y * y + z * z + w * w)
    return x * n, y * n, z * n, w * n


def rotation_between(a: Quaternion, b: Quaternion) -> Vector:
    """Return the rotation vector, in ft_sensor, that turns ``a`` into ``b``; exact when small."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    w = aw * bw + ax * bx + ay * by + az * bz
    k = 2.0 if w >= 0 else -2.0
    x = k * (aw * bx - ax * bw - ay * bz + az * by)
    y = k * (aw * by + ax * bz - ay * bw - az * bx)
    z = k * (aw * bz - ax * by + ay * bx - az * bw)
    n2 = (x * x + y * y + z * z) / 4
    s = 1 + n2 / 6 + 0.075 * n2 * n2
    return x * s, y * s, z * s
