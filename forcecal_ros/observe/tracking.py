"""Filters that follow a pose: third order, their poles fixed whatever the period.

Plain floats and tuples, since a step of a few hundred operations is dearer in arrays. Quaternions
are xyzw, map ft_sensor to base and need no particular sign.
"""

from math import cos, cosh, exp, sqrt
from typing import NamedTuple

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)

JUMP_SQUARED = 0.09
"""An orientation more than 0.3 rad from where it was predicted is no noise but another motion:
the filter starts anew there. Its square [rad^2]."""


class Poles(NamedTuple):
    """
    Poles of a third-order filter: ``-real`` and ``-mean +- sqrt(-split)`` [1/s, 1/s, 1/s^2].

    A positive ``split`` is a complex pair, a negative one a real pair.
    """

    real: float
    mean: float
    split: float


def butterworth(corner: float) -> Poles:
    """
    Return the poles of the stationary Kalman filter for a white third derivative.

    ``corner`` is the sixth root of the density of that derivative over that of the measurement
    [rad/s].
    """
    return Poles(corner, corner / 2, 0.75 * corner * corner)


def tracking_gains(dt: float, poles: Poles) -> Vector:
    """
    Place the poles of a filter on position, velocity and acceleration for one period ``dt`` [s].

    Returns what an innovation adds to position, to velocity and to acceleration
    [1, 1/s, 1/s^2].
    """
    z = exp(-poles.real * dt)
    r = exp(-poles.mean * dt)
    split = poles.split
    pair = 2 * r * (cos(sqrt(split) * dt) if split >= 0 else cosh(sqrt(-split) * dt))
    c2, c1, c0 = -(z + pair), z * pair + r * r, -z * r * r
    a = 1 + c0
    g = c1 + c2 + a
    b = c2 + 3 - a - g / 2
    return a, b / dt, g / (dt * dt)


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


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the turn b followed by a, both about axes that stay."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (aw * bx + bw * ax + ay * bz - az * by, aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx, aw * bw - ax * bx - ay * by - az * bz)


def rotate_back(q: Quaternion, v: Vector) -> Vector:
    """Return ``R^T v``: the coordinates in ft_sensor of a vector given in base."""
    return rotate((-q[0], -q[1], -q[2], q[3]), v)


def turned(q: Quaternion, dx: float, dy: float, dz: float) -> Quaternion:
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


class Rotation(NamedTuple):
    """Filtered orientation, with angular velocity and acceleration in ft_sensor at time ``t``."""

    t: float
    q: Quaternion
    omega: Vector
    alpha: Vector


def track_rotation(state: Rotation, t: float, q: Quaternion, poles: Poles) -> Rotation:
    """
    Take in one orientation measured at ``t`` > ``state.t``: predict, compare on SO(3), correct.

    Starts anew after a jump, see ``JUMP_SQUARED``.
    """
    dt = t - state.t
    (wx, wy, wz), (ax, ay, az) = state.omega, state.alpha
    h = dt / 2
    wx, wy, wz = wx + h * ax, wy + h * ay, wz + h * az
    predicted = turned(state.q, wx * dt, wy * dt, wz * dt)
    ex, ey, ez = rotation_between(predicted, q)
    if not ex * ex + ey * ey + ez * ez < JUMP_SQUARED:
        return Rotation(t, q, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    k1, k2, k3 = tracking_gains(dt, poles)
    return Rotation(
        t, turned(predicted, k1 * ex, k1 * ey, k1 * ez),
        (wx + h * ax + k2 * ex, wy + h * ay + k2 * ey, wz + h * az + k2 * ez),
        (ax + k3 * ex, ay + k3 * ey, az + k3 * ez))
