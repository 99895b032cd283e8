"""What hangs on the sensor, and the wrench that its weight and inertia put there."""

from typing import NamedTuple

from forcecal_ros.observe.tracking import Vector


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
    Force [N] and torque [N m] that weight and motion of the tool put on the wire.

    With r = c + s x_hat and f_c = f + alpha x d + omega x (omega x d), all in ft_sensor:
    ``-(m f_c)`` and ``-(r x m f_c + I alpha + omega x I omega)``; [Gamez2005] Eq. 1 in six axes.
    The tool's sliding adds the same to accelerometer and centre of mass, so ``f`` holds it.
    At rest ``f = -g``, and the weight is what remains: ``m g`` and ``r x m g``.

    Parameters
    ----------
    f : tuple of 3 float
        Specific force at the accelerometer [m/s^2].
    omega, alpha : tuple of 3 float
        Angular velocity [rad/s] and acceleration [rad/s^2].
    s : float
        Displacement along x [m].
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
