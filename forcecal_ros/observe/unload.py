"""Stages weight and inertia: bias and load of the tool off one wrench."""

from math import exp, inf
from typing import NamedTuple

from forcecal_ros.checks.signals import ABSURD
from forcecal_ros.observe import status as st
from forcecal_ros.observe.align import Reading
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.inertial import tool_wrench
from forcecal_ros.observe.motion import carried, gravity_in_sensor, MotionEstimate, NO_RUN
from forcecal_ros.observe.sample import NO_WRENCH, Wrench
from forcecal_ros.observe.status import saturated
from forcecal_ros.observe.tracking import turned, Vector, ZERO
from forcecal_ros.observe.weighing import weigh, Weighing

_ABSURD_SQUARED = ABSURD * ABSURD


class Tool(NamedTuple):
    """
    What is remembered from the last wrench that was used.

    Attributes
    ----------
    t : float
        Its stamp [s].
    s : float
        Displacement along x of the tool [m].
    weighing : Weighing
    """

    t: float = -inf
    s: float = 0.0
    weighing: Weighing = Weighing()


class Unloaded(NamedTuple):
    """
    One wrench as the filters take it in.

    Attributes
    ----------
    t : float
        Stamp [s].
    status : int
        Bits of :mod:`forcecal_ros.observe.status`; ``INVALID``: all else is zero.
    measured : tuple of 6 float
        Wire - bias - inertial [N, N m].
    inertial : tuple of 6 float
        What weight and motion of the tool put on the wire [N, N m].
    f : tuple of 3 float
        Specific force at the accelerometer, as far as it counts [m/s^2].
    """

    t: float
    status: int
    measured: Wrench
    inertial: Wrench
    f: Vector


def unload(tool: Tool, motion: MotionEstimate, t: float, wire: Wrench, force: Reading, s: float,
           model: Model) -> tuple[Tool, Unloaded]:
    """
    Take bias, weight and inertia off a wrench as on the wire.

    Parameters
    ----------
    t : float
        [s]
    wire : tuple of 6 float
        [N, N m]
    force
        Of the accelerometer at ``t``.
    s : float
        Displacement at ``t``; NaN where no sensor tells [m].
    """
    w0, w1, w2, w3, w4, w5 = wire
    b0, b1, b2, b3, b4, b5 = model.bias
    status = 0
    if s != s:
        s = 0.0
        if model.stiffness > 0:
            status = st.DISPLACEMENT_FROM_FORCE
            s = tool.s
            s += (1 - exp(-model.relaxation * (t - tool.t))) * ((w0 - b0) / model.stiffness - s)
    if model.weight_only:
        status, f, omega, alpha = _kinematics_at_rest(status, motion, t, model)
    else:
        status, f, omega, alpha = _kinematics(status, motion, t, force, model)
    if status & st.NO_GRAVITY:
        return tool, Unloaded(t, status, NO_WRENCH, NO_WRENCH, ZERO)
    weighing = tool.weighing
    if model.weighs and not model.weight_only and not status & (st.NO_ACCELEROMETER | st.NO_POSE):
        weighing, f = _weighed(weighing, motion, t, f, model)
    if model.limited and saturated(wire, model.wrench_limit):
        status |= st.SATURATED
    i0, i1, i2, i3, i4, i5 = inertial = tool_wrench(model.load, f, omega, alpha, s)
    m0, m1, m2 = w0 - b0 - i0, w1 - b1 - i1, w2 - b2 - i2
    m3, m4, m5 = w3 - b3 - i3, w4 - b4 - i4, w5 - b5 - i5
    if not (m0 * m0 + m1 * m1 + m2 * m2 + m3 * m3 + m4 * m4 + m5 * m5 < _ABSURD_SQUARED):
        return tool, Unloaded(t, st.BAD_WRENCH, NO_WRENCH, NO_WRENCH, ZERO)
    return Tool(t, s, weighing), Unloaded(t, status, (m0, m1, m2, m3, m4, m5), inertial, f)


def _kinematics(status: int, motion: MotionEstimate, t: float, force: Reading, model: Model
                ) -> tuple[int, Vector, Vector, Vector]:
    """Return status, specific force at the accelerometer, angular velocity and acceleration."""
    rotation, place = motion.rotation, motion.place
    omega = alpha = ZERO
    if t - rotation.t > model.pose_timeout:
        status |= st.NO_POSE
    else:
        h = t - rotation.t
        wx, wy, wz = rotation.omega
        ax, ay, az = alpha = rotation.alpha
        omega = (wx + h * ax, wy + h * ay, wz + h * az)
        if not motion.position:
            status |= st.NO_POSITION
    if force.known:
        fx, fy, fz = force.f
        if force.full:
            status |= st.SATURATED
        if motion.offset_known:
            ox, oy, oz = motion.offset
            fx, fy, fz = fx - ox, fy - oy, fz - oz
        elif model.ac_rate > 0:
            status |= st.NO_GRAVITY
        if place.t == -inf or status & st.NO_POSE:
            status |= st.OFFSET_HELD
        return status, (fx, fy, fz), omega, alpha
    if status & st.NO_POSE:
        return status | st.NO_ACCELEROMETER | st.NO_GRAVITY, ZERO, omega, alpha
    o = place.o
    if place.run != NO_RUN or place.t < rotation.t:
        o = gravity_in_sensor(rotation.q, model.gravity)
    ox, oy, oz = carried(o, omega, t - rotation.t)
    return status | st.NO_ACCELEROMETER, (-ox, -oy, -oz), omega, alpha


def _weighed(weighing: Weighing, motion: MotionEstimate, t: float, f: Vector, model: Model
             ) -> tuple[Weighing, Vector]:
    """Return the specific force without what is not taken for motion."""
    gx, gy, gz = _gravity(motion, t, model)
    fx, fy, fz = f
    weighing, (x, y, z) = weigh(weighing, t, (fx + gx, fy + gy, fz + gz), model.share,
                                model.level, model.pause)
    return weighing, (fx - x, fy - y, fz - z)


def _gravity(motion: MotionEstimate, t: float, model: Model) -> Vector:
    """Return gravity in ft_sensor as the pose has it now [m/s^2]."""
    rotation = motion.rotation
    h = t - rotation.t
    wx, wy, wz = rotation.omega
    return gravity_in_sensor(turned(rotation.q, h * wx, h * wy, h * wz), model.gravity)


def _kinematics_at_rest(status: int, motion: MotionEstimate, t: float, model: Model
                        ) -> tuple[int, Vector, Vector, Vector]:
    """Return the same as if the tool hung still in its present orientation: weight alone."""
    if t - motion.rotation.t > model.pose_timeout:
        return status | st.NO_POSE | st.NO_GRAVITY, ZERO, ZERO, ZERO
    x, y, z = _gravity(motion, t, model)
    return status, (-x, -y, -z), ZERO, ZERO
