"""
Motion of the sensor by its poses, and specific force by the accelerometer.

One third-order filter serves twice. Its third state ``o`` is the offset of the accelerometer:
dv/dt = R (f - o) + g. Without an accelerometer, f = 0 and ``-o`` is the specific force itself, the
second derivative of the pose. Force innovations never enter here: a contact must not become an
offset. Plain floats and tuples, since a step of a few hundred operations is slower in arrays.
"""

from math import cos, cosh, exp, inf, isfinite, sqrt
from typing import NamedTuple

from forcecal_ros.core.geometry import (
    advance_rotation,
    Quaternion,
    rotate,
    rotate_back,
    rotation_between,
    Vector,
    ZERO,
)
from forcecal_ros.observe.align import Reading
from forcecal_ros.observe.bandwidth import Poles
from forcecal_ros.observe.design import Model, NEWTON
from forcecal_ros.observe.sample import saturated

NO_RUN = inf
"""The run of an accelerometer where there is none."""


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


class Rotation(NamedTuple):
    """Filtered orientation, with angular velocity and acceleration in ft_sensor at time ``t``."""

    t: float
    q: Quaternion
    omega: Vector
    alpha: Vector


def track_rotation(state: Rotation, t: float, q: Quaternion, poles: Poles) -> Rotation:
    """
    Take in one orientation measured at ``t`` > ``state.t``: predict, compare on SO(3), correct.

    Starts anew after a jump of 0.3 rad.
    """
    dt = t - state.t
    (wx, wy, wz), (ax, ay, az) = state.omega, state.alpha
    h = dt / 2
    wx, wy, wz = wx + h * ax, wy + h * ay, wz + h * az
    predicted = advance_rotation(state.q, wx * dt, wy * dt, wz * dt)
    ex, ey, ez = rotation_between(predicted, q)
    # an orientation more than 0.3 rad from where it was predicted is no noise but another motion:
    # the filter starts anew there. Its square [rad^2]
    if not ex * ex + ey * ey + ez * ez < 0.09:
        return Rotation(t, q, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    k1, k2, k3 = tracking_gains(dt, poles)
    return Rotation(
        t, advance_rotation(predicted, k1 * ex, k1 * ey, k1 * ez),
        (wx + h * ax + k2 * ex, wy + h * ay + k2 * ey, wz + h * az + k2 * ez),
        (ax + k3 * ex, ay + k3 * ey, az + k3 * ez))


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


UNKNOWN_PLACE = Place(-inf, -inf, NO_RUN, ZERO, ZERO, ZERO, ZERO)


class MotionEstimate(NamedTuple):
    """
    Motion of ft_sensor as estimated from the poses.

    Attributes
    ----------
    rotation : Rotation
        Of time -inf before the first pose.
    place : Place
        Of time -inf where not known.
    offset : tuple of 3 float
        Of the accelerometer beyond its calibration, ft_sensor [m/s^2].
    offset_known, position : bool
        Whether there is an offset, and whether the last pose held a position.
    """

    rotation: Rotation = Rotation(-inf, (0.0, 0.0, 0.0, 1.0), ZERO, ZERO)
    place: Place = UNKNOWN_PLACE
    offset: Vector = ZERO
    offset_known: bool = False
    position: bool = False


def gravity_in_sensor(q: Quaternion, gravity: float) -> Vector:
    """Return the acceleration of gravity in ft_sensor, whose orientation is ``q`` [m/s^2]."""
    return rotate_back(q, (0.0, 0.0, -gravity))


def carried(v: Vector, omega: Vector, dt: float) -> Vector:
    """Turn a vector fixed in base as ft_sensor sees it ``dt`` later."""
    (x, y, z), (wx, wy, wz) = v, omega
    return (x - dt * (wy * z - wz * y), y - dt * (wz * x - wx * z), z - dt * (wx * y - wy * x))


def take_pose(motion: MotionEstimate, t: float, position: Vector, q: Quaternion, late: bool,
              force: Reading, s: float, model: Model) -> MotionEstimate:
    """
    Take in a pose whose turn has come.

    Parameters
    ----------
    t : float
        Its stamp [s].
    position : tuple of 3 float
        [m]; not finite where only the orientation is known.
    q : tuple of 4 float
        xyzw, normalised.
    late : bool
        Whether the samples around its stamp may be gone: then only the rotation is followed.
    force
        Of the accelerometer at ``t``, with integral.
    s : float
        Displacement at ``t`` [m].
    """
    # the offset of an AC-coupled accelerometer begins as a guess. With a pole at this over the
    # age of the filter its error falls as age^-1.5, fast at first; once the designed pole is the
    # slower one, that takes over
    guess_forgotten = 1.5
    rotation, place = motion.rotation, motion.place
    offset, offset_known = motion.offset, motion.offset_known
    if 0 < t - rotation.t <= model.pose_timeout:
        rotation = track_rotation(rotation, t, q, model.rotation_poles)
    else:
        rotation = Rotation(t, q, ZERO, ZERO)
    if late:
        return MotionEstimate(rotation, place, offset, offset_known, motion.position)
    known = isfinite(position[0] + position[1] + position[2])
    fresh = known == motion.position and 0 < t - place.t <= model.pose_timeout
    anchor = ZERO
    if known:
        qx, qy, qz = model.place
        rx, ry, rz = rotate(rotation.q, (qx + s, qy, qz))
        anchor = (position[0] + rx, position[1] + ry, position[2] + rz)
    if not force.known:
        place = _place_by_pose(place, rotation, anchor, fresh and known, model)
    elif model.ac_rate > 0 or (known and (model.track_offset or model.filter == NEWTON)):
        f, run = force.f, force.run
        if not fresh or place.run != run:
            if model.ac_rate > 0 and place.run != run:
                gx, gy, gz = gravity_in_sensor(rotation.q, model.gravity)
                offset, offset_known = (f[0] + gx, f[1] + gy, f[2] + gz), True
            place = Place(t, t, run, anchor, ZERO, offset, force.integral)
        else:
            poles = model.offset_poles if known else model.reach_poles
            age = t - place.since
            if model.ac_rate > 0 and age * poles.real < guess_forgotten:
                poles = Poles(guess_forgotten / age, poles.mean, poles.split)
            place = track_place(place, t, rotation.q, rotation.omega, anchor, force.integral,
                                model.gravity, poles)
            if model.ac_rate > 0 or model.track_offset:
                offset, offset_known = place.o, True
    else:
        place = UNKNOWN_PLACE
    return MotionEstimate(rotation, place, offset, offset_known, known)


def _place_by_pose(place: Place, rotation: Rotation, anchor: Vector, moving: bool, model: Model
                   ) -> Place:
    """Carry on without an accelerometer; at rest where the place was not known before."""
    t = rotation.t
    if not moving or place.run != NO_RUN:
        v = place.v if moving else ZERO
        return Place(t, t, NO_RUN, anchor, v, gravity_in_sensor(rotation.q, model.gravity), ZERO)
    carried_on = Place(place.t, place.since, place.run, place.p, place.v,
                   carried(place.o, rotation.omega, t - place.t), place.integral)
    return track_place(carried_on, t, rotation.q, rotation.omega, anchor, ZERO, model.gravity,
                       model.motion_poles)


def track_place(
        place: Place, t: float, q: Quaternion, omega: Vector, position: Vector,
        integral: Vector, gravity: float, poles: Poles) -> Place:
    """
    Take in one measured position: carry on with the specific force, compare, correct.

    Parameters
    ----------
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

    Returns
    -------
    Place
        Starts anew, offset kept, after a jump of 0.5 m.
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
    # a pose further than 0.5 m from where it was predicted is no noise but another place (a robot
    # that was moved, a new base frame): the filter starts anew there. Its square [m^2]
    if not ex * ex + ey * ey + ez * ez < 0.25:
        return Place(t, t, place.run, position, (0.0, 0.0, 0.0), place.o, integral)
    k1, k2, k3 = tracking_gains(dt, poles)
    # a filter that was just started does not know its velocity, and would take the error that this
    # makes for an offset: it leaves the offset alone for this long [s]
    if place.run == NO_RUN or t - place.since > 0.3:
        cx, cy, cz = rotate_back(q, (ex, ey, ez))
        ox, oy, oz = ox - k3 * cx, oy - k3 * cy, oz - k3 * cz
    return Place(
        t, place.since, place.run,
        (px + k1 * ex, py + k1 * ey, pz + k1 * ez),
        (vx + dt * ax + k2 * ex, vy + dt * ay + k2 * ey, vz + dt * az + k2 * ez),
        (ox, oy, oz), integral)


Sample = tuple[float, float, float, float, float, float, float, float, bool]
"""(time, usable from, specific force (3), its integral (3), full)."""

NOTHING_BEFORE: Sample = (-inf, -inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)


def next_sample(before: Sample, highpass: Vector, t: float, reading: Vector, usable: float,
                begins: bool, model: Model) -> tuple[Sample, Vector]:
    """
    Turn one reading into a sample, the integral by trapezoids.

    Parameters
    ----------
    before
        The sample before; not looked at where a run begins.
    highpass : tuple of 3 float
        High-pass state: what an AC-coupled accelerometer had lost of the specific force then
        [m/s^2].
    t : float
        Stamp as sent [s].
    reading : tuple of 3 float
        In the unit of the calibration: volts, or m/s^2.
    usable : float
        From which stamp on it may be used [s].
    begins : bool
        Whether a run begins with it.

    Returns
    -------
    sample : tuple
    highpass : tuple of 3 float
        Its state now [m/s^2].
    """
    o0, o1, o2, a, b, c, d, e, f, g, h, i = model.volts
    full = model.accelerometer_limit[0] < inf and saturated(reading, model.accelerometer_limit)
    v0, v1, v2 = reading[0] - o0, reading[1] - o1, reading[2] - o2
    fx, fy, fz = a * v0 + b * v1 + c * v2, d * v0 + e * v1 + f * v2, g * v0 + h * v1 + i * v2
    tau = t - model.delay
    if begins:
        return (tau, usable, fx, fy, fz, 0.0, 0.0, 0.0, full), (0.0, 0.0, 0.0)
    start, _, px, py, pz, jx, jy, jz, _ = before
    half = (tau - start) / 2
    if model.ac_rate > 0:
        # y is what the high-pass leaves of f: dz/dt = rate y, f = y + z
        zx, zy, zz = highpass
        gain = half * model.ac_rate
        zx += gain * (px - zx + fx)
        zy += gain * (py - zy + fy)
        zz += gain * (pz - zz + fz)
        highpass = (zx, zy, zz)
        fx, fy, fz = fx + zx, fy + zy, fz + zz
    jx, jy, jz = jx + half * (px + fx), jy + half * (py + fy), jz + half * (pz + fz)
    return (tau, usable, fx, fy, fz, jx, jy, jz, full), highpass
