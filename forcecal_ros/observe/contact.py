"""From aligned signals to one contact wrench: what the step does once all has arrived."""

from math import exp, inf, isfinite, nan
from typing import NamedTuple

from forcecal_ros.observe import status as st
from forcecal_ros.observe.align import Reading
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.newton import newton_step, NewtonState
from forcecal_ros.observe.inertial import (
    gravity_in_sensor,
    NO_RUN,
    Place,
    tool_wrench,
    track_place,
)
from forcecal_ros.observe.status import saturated
from forcecal_ros.observe.tracking import (
    Poles,
    Quaternion,
    rotate,
    Rotation,
    track_rotation,
    Vector,
)

Wrench = tuple[float, float, float, float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
NOTHING: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

NOWHERE = Place(-inf, -inf, NO_RUN, ZERO, ZERO, ZERO, ZERO)
STOPPED = NewtonState(nan, nan)

PAUSE = 0.1
"""After a longer pause of the wrench the contact filter starts anew [s]."""

_FORGET = 1.5
"""An offset begun as a guess is forgotten at this over its age, until the filter is slower."""

_ABSURD_SQUARE = 1e18
"""Square of a wrench that no sensor reads; NaN is not below it either."""


class ContactSample(NamedTuple):
    """
    What one wrench was found to hold; all in ft_sensor, about its origin, wire sign.

    Attributes
    ----------
    t : float
        Stamp of the wrench [s].
    contact : tuple of 6 float
        Contact wrench, environment on tool [N, N m].
    status : int
        Bits of :mod:`forcecal_ros.observe.status`.
    measured : tuple of 6 float
        Contact wrench before the filter: wire - bias - inertial (the paper's u - m a).
    innovation : tuple of 6 float
        ``measured`` less what the filter expected.
    inertial : tuple of 6 float
        What weight and motion of the tool put on the wire.
    """

    t: float
    contact: Wrench
    status: int
    measured: Wrench
    innovation: Wrench
    inertial: Wrench


class Motion(NamedTuple):
    """
    What the poses taught.

    Attributes
    ----------
    rotation : Rotation
        Of time -inf before the first pose.
    place : Place
        Of time -inf where nothing tells.
    offset : tuple of 3 float
        Of the accelerometer beyond its calibration, ft_sensor [m/s^2].
    offset_known, position : bool
        Whether there is an offset, and whether the last pose held a position.
    """

    rotation: Rotation = Rotation(-inf, (0.0, 0.0, 0.0, 1.0), ZERO, ZERO)
    place: Place = NOWHERE
    offset: Vector = ZERO
    offset_known: bool = False
    position: bool = False


class Filter(NamedTuple):
    """
    The contact filter.

    Attributes
    ----------
    t : float
        Stamp of the last wrench that was used [s].
    contact : tuple of 6 float
        [N, N m]
    s : float
        Displacement of the tool then [m].
    newton : NewtonState
        NaN where it is not running.
    axis : tuple of 3 float
        x of ft_sensor in base, which ``newton`` is along.
    """

    t: float = -inf
    contact: Wrench = NOTHING
    s: float = 0.0
    newton: NewtonState = STOPPED
    axis: Vector = ZERO


def take_pose(motion: Motion, t: float, position: Vector, q: Quaternion, late: bool,
              force: Reading, s: float, model: Model) -> Motion:
    """
    Take in a pose whose turn has come.

    Parameters
    ----------
    motion : Motion
    t : float
        Its stamp [s].
    position : tuple of 3 float
        [m]; not finite where only the orientation is known.
    q : tuple of 4 float
        xyzw, normalised.
    late : bool
        Whether the samples around its stamp may be gone: then only the rotation is followed.
    force : Reading
        Of the accelerometer at ``t``, with integral.
    s : float
        Displacement at ``t`` [m].
    model : Model

    Returns
    -------
    Motion
    """
    rotation, place = motion.rotation, motion.place
    offset, offset_known = motion.offset, motion.offset_known
    if 0 < t - rotation.t <= model.pose_timeout:
        rotation = track_rotation(rotation, t, q, model.rotation_poles)
    else:
        rotation = Rotation(t, q, ZERO, ZERO)
    if late:
        return Motion(rotation, place, offset, offset_known, motion.position)
    known = isfinite(position[0] + position[1] + position[2])
    fresh = known == motion.position and 0 < t - place.t <= model.pose_timeout
    anchor = ZERO
    if known:
        qx, qy, qz = model.place
        rx, ry, rz = rotate(rotation.q, (qx + s, qy, qz))
        anchor = (position[0] + rx, position[1] + ry, position[2] + rz)
    if not force.known:
        place = _place_by_pose(place, rotation, anchor, fresh and known, model)
    elif model.ac_rate > 0 or (known and (model.track_offset or model.newton)):
        f, run = force.f, force.run
        if not fresh or place.run != run:
            if model.ac_rate > 0 and place.run != run:
                gx, gy, gz = gravity_in_sensor(rotation.q, model.gravity)
                offset, offset_known = (f[0] + gx, f[1] + gy, f[2] + gz), True
            place = Place(t, t, run, anchor, ZERO, offset, force.integral)
        else:
            poles = model.offset_poles if known else model.reach_poles
            age = t - place.since
            if model.ac_rate > 0 and age * poles.real < _FORGET:
                poles = Poles(_FORGET / age, poles.mean, poles.split)
            place = track_place(place, t, rotation.q, rotation.omega, anchor, force.integral,
                                model.gravity, poles)
            if model.ac_rate > 0 or model.track_offset:
                offset, offset_known = place.o, True
    else:
        place = NOWHERE
    return Motion(rotation, place, offset, offset_known, known)


def _place_by_pose(place: Place, rotation: Rotation, anchor: Vector, moving: bool, model: Model
                   ) -> Place:
    """Carry on without an accelerometer; at rest where the place was not known before."""
    t = rotation.t
    if not moving or place.run != NO_RUN:
        v = place.v if moving else ZERO
        return Place(t, t, NO_RUN, anchor, v, gravity_in_sensor(rotation.q, model.gravity), ZERO)
    carried = Place(place.t, place.since, place.run, place.p, place.v,
                    _carried(place.o, rotation.omega, t - place.t), place.integral)
    return track_place(carried, t, rotation.q, rotation.omega, anchor, ZERO, model.gravity,
                       model.motion_poles)


def _carried(v: Vector, omega: Vector, dt: float) -> Vector:
    """Turn a vector fixed in base as ft_sensor sees it a moment later."""
    (x, y, z), (wx, wy, wz) = v, omega
    return (x - dt * (wy * z - wz * y), y - dt * (wz * x - wx * z), z - dt * (wx * y - wy * x))


def observe(filter_: Filter, motion: Motion, t: float, wire: Wrench, force: Reading, s: float,
            model: Model) -> tuple[Filter, ContactSample]:
    """
    Answer one wrench.

    Parameters
    ----------
    filter_ : Filter
    motion : Motion
    t : float
        [s]
    wire : tuple of 6 float
        As on the wire.
    force : Reading
        Of the accelerometer at ``t``.
    s : float
        Displacement at ``t``; NaN where no sensor tells [m].
    model : Model

    Returns
    -------
    Filter
    ContactSample
    """
    w0, w1, w2, w3, w4, w5 = wire
    b0, b1, b2, b3, b4, b5 = model.bias
    dt = t - filter_.t
    status = 0
    if isfinite(s):
        pass
    elif model.stiffness > 0:
        status = st.DISPLACEMENT_FROM_FORCE
        s = filter_.s
        s += (1 - exp(-model.relaxation * dt)) * ((w0 - b0) / model.stiffness - s)
    else:
        s = 0.0
    status, f, omega, alpha = _kinematics(status, motion, t, force, model)
    if status & st.NO_GRAVITY:
        return filter_, ContactSample(t, filter_.contact, status, NOTHING, NOTHING, NOTHING)
    if model.limited and saturated(wire, model.wrench_limit):
        status |= st.SATURATED
    i0, i1, i2, i3, i4, i5 = inertial = tool_wrench(model.load, f, omega, alpha, s)
    m0, m1, m2 = w0 - b0 - i0, w1 - b1 - i1, w2 - b2 - i2
    m3, m4, m5 = w3 - b3 - i3, w4 - b4 - i4, w5 - b5 - i5
    if not m0 * m0 + m1 * m1 + m2 * m2 + m3 * m3 + m4 * m4 + m5 * m5 < _ABSURD_SQUARE:
        return filter_, ContactSample(t, filter_.contact, st.BAD_WRENCH, NOTHING, NOTHING, NOTHING)
    measured = (m0, m1, m2, m3, m4, m5)
    if dt > PAUSE:
        if filter_.t > -inf:
            status |= st.RESTARTED
        innovation, contact = NOTHING, measured
    else:
        c0, c1, c2, c3, c4, c5 = filter_.contact
        e0, e1, e2, e3, e4, e5 = innovation = (
            m0 - c0, m1 - c1, m2 - c2, m3 - c3, m4 - c4, m5 - c5)
        k = 1 - exp(-model.rate * dt)
        contact = (c0 + k * e0, c1 + k * e1, c2 + k * e2, c3 + k * e3, c4 + k * e4, c5 + k * e5)
    newton, axis = STOPPED, ZERO
    if model.newton:
        newton, axis, along = _newton(filter_, dt, t, w0 - b0, f, motion, model)
        contact = (along, m1, m2, m3, m4, m5)
    return (Filter(t, contact, s, newton, axis),
            ContactSample(t, contact, status, measured, innovation, inertial))


def _kinematics(status: int, motion: Motion, t: float, force: Reading, model: Model
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
    ox, oy, oz = _carried(o, omega, t - rotation.t)
    return status | st.NO_ACCELEROMETER, (-ox, -oy, -oz), omega, alpha


def _newton(filter_: Filter, dt: float, t: float, wire_x: float, f: Vector, motion: Motion,
            model: Model) -> tuple[NewtonState, Vector, float]:
    """
    Run the paper's observer along x; its force comes back in the wire's sign.

    Position and velocity are those of the tool as the pose filter has them; without a position
    they count as met, which leaves Newton's law. The paper's x does not turn: where the sensor
    does, the observer's position and velocity are turned along, so that only translation drives
    its error.
    """
    state, m = filter_.newton, model.load.m
    rotation, place = motion.rotation, motion.place
    if place.t == -inf or not motion.position:
        return STOPPED, ZERO, wire_x + m * f[0]
    g = gravity_in_sensor(rotation.q, model.gravity)[0]
    nx, ny, nz = axis = rotate(rotation.q, (1.0, 0.0, 0.0))
    v = nx * place.v[0] + ny * place.v[1] + nz * place.v[2]
    x = nx * place.p[0] + ny * place.p[1] + nz * place.p[2] + v * (t - place.t)
    if not isfinite(state.x) or dt > PAUSE:
        state = NewtonState(x, v)
        dt = 0.0
    else:
        dx, dy, dz = nx - filter_.axis[0], ny - filter_.axis[1], nz - filter_.axis[2]
        (px, py, pz), (vx, vy, vz) = place.p, place.v
        state = NewtonState(state.x + dx * px + dy * py + dz * pz,
                            state.v + dx * vx + dy * vy + dz * vz)
    state, force = newton_step(state, dt, -wire_x + m * g, f[0] + g, x, v, m, model.K)
    return state, axis, -force
