"""Where the tool is and how it accelerates: pose and accelerometer told apart from offset.

One third-order filter serves twice. Its third state ``o`` is what the accelerometer shows too
much: dv/dt = R (f - o) + g. Without an accelerometer, f = 0 and ``-o`` is the specific force
itself, as the second derivative of the pose has it. Force innovations never enter here: a
contact must not become an offset.
"""

from math import inf
from typing import NamedTuple

from forcecal_ros.observe.tracking import (
    Poles,
    Quaternion,
    rotate,
    rotate_back,
    tracking_gains,
    Vector,
)

OFFSET_DELAY = 0.3
"""Time a started filter is given to find its velocity before it moves the offset [s]."""

NO_RUN = inf
"""Stands for the run of an accelerometer where there is none."""

_JUMP = 0.25
"""Square of the surprise that starts the filter anew, at the place measured [m^2]."""


class Place(NamedTuple):
    """
    Place of the accelerometer at one pose.

    Attributes
    ----------
    t : float
        Stamp of the pose [s].
    since : float
        Stamp the filter was started at [s].
    run : float
        Which uninterrupted run of the accelerometer drives it; ``NO_RUN``: none does.
    p, v : tuple of 3 float
        In base [m], [m/s].
    o : tuple of 3 float
        In ft_sensor [m/s^2]: the accelerometer's offset, or minus the specific force.
    integral : tuple of 3 float
        Specific force as measured, integrated over time in ft_sensor [m/s].
    """

    t: float
    since: float
    run: float
    p: Vector
    v: Vector
    o: Vector
    integral: Vector


def gravity_in_sensor(q: Quaternion, gravity: float) -> Vector:
    """
    Return the acceleration of gravity in ft_sensor.

    Parameters
    ----------
    q : tuple of 4 float
        Orientation of ft_sensor.
    gravity : float
        [m/s^2]

    Returns
    -------
    tuple of 3 float
        [m/s^2]
    """
    return rotate_back(q, (0.0, 0.0, -gravity))


def track_place(
        place: Place, t: float, q: Quaternion, omega: Vector, position: Vector,
        integral: Vector, gravity: float, poles: Poles) -> Place:
    """
    Take in one measured position: carry on with the specific force, compare, correct.

    Parameters
    ----------
    place : Place
    t : float
        Stamp, later than ``place.t`` [s].
    q : tuple of 4 float
        Orientation at ``t``.
    omega : tuple of 3 float
        Angular velocity in ft_sensor [rad/s].
    position : tuple of 3 float
        Measured place of the accelerometer in base [m].
    integral : tuple of 3 float
        See :class:`Place`; at ``t``.
    gravity : float
        [m/s^2]
    poles : Poles

    Returns
    -------
    Place
        Starts anew, offset kept, where prediction and measurement are more than 0.5 m apart.
    """
    dt = t - place.t
    (px, py, pz), (vx, vy, vz), (ox, oy, oz) = place.p, place.v, place.o
    gx, gy, gz = integral
    hx, hy, hz = place.integral
    fx, fy, fz = (gx - hx) / dt - ox, (gy - hy) / dt - oy, (gz - hz) / dt - oz
    wx, wy, wz = omega
    h = dt / 2
    # the mean of f belongs to the orientation half a period ago
    ax, ay, az = rotate(q, (fx - h * (wy * fz - wz * fy), fy - h * (wz * fx - wx * fz),
                            fz - h * (wx * fy - wy * fx)))
    az -= gravity
    px, py, pz = px + dt * (vx + h * ax), py + dt * (vy + h * ay), pz + dt * (vz + h * az)
    ex, ey, ez = position[0] - px, position[1] - py, position[2] - pz
    if not ex * ex + ey * ey + ez * ez < _JUMP:
        return Place(t, t, place.run, position, (0.0, 0.0, 0.0), place.o, integral)
    k1, k2, k3 = tracking_gains(dt, poles)
    if place.run == NO_RUN or t - place.since > OFFSET_DELAY:
        cx, cy, cz = rotate_back(q, (ex, ey, ez))
        ox, oy, oz = ox - k3 * cx, oy - k3 * cy, oz - k3 * cz
    return Place(
        t, place.since, place.run,
        (px + k1 * ex, py + k1 * ey, pz + k1 * ez),
        (vx + dt * ax + k2 * ex, vy + dt * ay + k2 * ey, vz + dt * az + k2 * ez),
        (ox, oy, oz), integral)


class Load(NamedTuple):
    """
    What hangs on the sensor, as plain numbers.

    Attributes
    ----------
    m : float
        [kg]
    cx, cy, cz : float
        Centre of mass at zero displacement, in ft_sensor [m].
    dx, dy, dz : float
        From the accelerometer to the centre of mass [m].
    ixx, iyy, izz, ixy, ixz, iyz : float
        Inertia about the centre of mass [kg m^2].
    """

    m: float
    cx: float
    cy: float
    cz: float
    dx: float
    dy: float
    dz: float
    ixx: float
    iyy: float
    izz: float
    ixy: float
    ixz: float
    iyz: float


def tool_wrench(
        load: Load, f: Vector, omega: Vector, alpha: Vector, s: float,
) -> tuple[float, float, float, float, float, float]:
    """
    Force and torque that weight and motion of the tool put on the wire.

    With r = c + s x_hat and f_c = f + alpha x d + omega x (omega x d), all in ft_sensor:
    ``-(m f_c)`` and ``-(r x m f_c + I alpha + omega x I omega)``; [Gamez2005] Eq. 1 in six axes.
    The tool's sliding adds the same to accelerometer and centre of mass, so ``f`` holds it.

    Parameters
    ----------
    load : Load
    f : tuple of 3 float
        Specific force at the accelerometer [m/s^2].
    omega, alpha : tuple of 3 float
        Angular velocity [rad/s] and acceleration [rad/s^2].
    s : float
        Displacement along x [m].

    Returns
    -------
    tuple of 6 float
        [N, N m]
    """
    m, rx, ry, rz, dx, dy, dz, ixx, iyy, izz, ixy, ixz, iyz = load
    fx, fy, fz = f
    wx, wy, wz = omega
    ax, ay, az = alpha
    w2 = wx * wx + wy * wy + wz * wz
    wd = wx * dx + wy * dy + wz * dz
    fx = m * (fx + ay * dz - az * dy + wx * wd - w2 * dx)
    fy = m * (fy + az * dx - ax * dz + wy * wd - w2 * dy)
    fz = m * (fz + ax * dy - ay * dx + wz * wd - w2 * dz)
    rx += s
    hx = ixx * wx + ixy * wy + ixz * wz
    hy = ixy * wx + iyy * wy + iyz * wz
    hz = ixz * wx + iyz * wy + izz * wz
    return (-fx, -fy, -fz,
            rz * fy - ry * fz - (ixx * ax + ixy * ay + ixz * az) + wz * hy - wy * hz,
            rx * fz - rz * fx - (ixy * ax + iyy * ay + iyz * az) + wx * hz - wz * hx,
            ry * fx - rx * fy - (ixz * ax + iyz * ay + izz * az) + wy * hx - wx * hy)
