"""From aligned signals to one contact wrench: what the step does once all has arrived."""

from math import exp, inf, isfinite
from typing import NamedTuple

from forcecal_ros.observe import status as st
from forcecal_ros.observe.align import around, Entry
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.inertial import gravity_in_sensor, Place, tool_wrench, track_place
from forcecal_ros.observe.newton import newton_step, NewtonState
from forcecal_ros.observe.tracking import Poles, rotate, Rotation, track_rotation, Vector

Wrench = tuple[float, float, float, float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
NOTHING: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

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
    """What the poses taught; None before the first, or where nothing tells."""

    rotation: Rotation | None = None
    place: Place | None = None
    offset: Vector | None = None
    """Of the accelerometer beyond its calibration, ft_sensor [m/s^2]."""
    position: bool = False


class Filter(NamedTuple):
    """The contact filter after the wrench of time ``t``."""

    t: float = -inf
    contact: Wrench = NOTHING
    s: float = 0.0
    newton: NewtonState | None = None
    axis: Vector = ZERO
    """x of ft_sensor in base, which ``newton`` is along."""


def take_pose(motion: Motion, pose: Entry, late: bool, accelerometer: tuple[Entry, ...],
              displacement: tuple[Entry, ...], s: float, model: Model) -> Motion:
    """
    Take in a pose whose turn has come.

    Parameters
    ----------
    motion : Motion
    pose : tuple
        Of a :class:`~forcecal_ros.observe.align.PoseQueue`.
    late : bool
        Whether the samples around its stamp may be gone: then only the rotation is followed.
    accelerometer, displacement : tuple of Entry
        Samples around the pose's stamp.
    s : float
        Displacement where no sensor tells [m].
    model : Model

    Returns
    -------
    Motion
    """
    t, _, position, q = pose
    rotation, place, offset = motion.rotation, motion.place, motion.offset
    if rotation is None or not 0 < t - rotation.t <= model.pose_timeout:
        rotation = Rotation(t, q, ZERO, ZERO)
    else:
        rotation = track_rotation(rotation, t, q, model.rotation_poles)
    if late and place is not None:
        return Motion(rotation, place, offset, motion.position)
    known = isfinite(position[0] + position[1] + position[2])
    fresh = (place is not None and known == motion.position
             and 0 < t - place.t <= model.pose_timeout)
    anchor = ZERO
    if known:
        s = _displacement(displacement, t, s, model)
        qx, qy, qz = model.place
        rx, ry, rz = rotate(rotation.q, (qx + s, qy, qz))
        anchor = (position[0] + rx, position[1] + ry, position[2] + rz)
    pair = around(accelerometer, t, model.timeout)
    if pair is None:
        place = _place_by_pose(place if fresh else None, rotation, anchor, known, model)
    elif model.ac_rate or (known and (model.track_offset or model.newton)):
        f, integral, run = _at(pair, t, 2), _integral(pair, t), pair[0][1]
        if place is None or not fresh or place.run != run:
            if model.ac_rate and (place is None or place.run != run):
                g = gravity_in_sensor(rotation.q, model.gravity)
                offset = f[0] + g[0], f[1] + g[1], f[2] + g[2]
            place = Place(t, t, run, anchor, ZERO, offset or ZERO, integral)
        else:
            poles = model.offset_poles if known else model.reach_poles
            age = t - place.since
            if model.ac_rate and age * poles.real < _FORGET:
                poles = Poles(_FORGET / age, poles.mean, poles.split)
            place = track_place(place, t, rotation.q, rotation.omega, anchor, integral,
                                model.gravity, poles)
            if model.ac_rate or model.track_offset:
                offset = place.o
    else:
        place = None
    return Motion(rotation, place, offset, known)


def _place_by_pose(place: Place | None, rotation: Rotation, anchor: Vector, known: bool,
                   model: Model) -> Place:
    """Carry on without an accelerometer; at rest where the pose holds no position."""
    t = rotation.t
    if place is None or place.run is not None or not known:
        v = ZERO if place is None or not known else place.v
        return Place(t, t, None, anchor, v, gravity_in_sensor(rotation.q, model.gravity), ZERO)
    place = place._replace(o=_carried(place.o, rotation.omega, t - place.t))
    return track_place(place, t, rotation.q, rotation.omega, anchor, ZERO, model.gravity,
                       model.motion_poles)


def _carried(v: Vector, omega: Vector, dt: float) -> Vector:
    """Turn a vector fixed in base as ft_sensor sees it a moment later."""
    (x, y, z), (wx, wy, wz) = v, omega
    return (x - dt * (wy * z - wz * y), y - dt * (wz * x - wx * z), z - dt * (wx * y - wy * x))


def _at(pair: tuple[Entry, Entry], t: float, i: int) -> Vector:
    """Interpolate three values from column ``i`` on."""
    a, b = pair
    if a is b:
        return a[i], a[i + 1], a[i + 2]
    k = (t - a[0]) / (b[0] - a[0])
    x, y, z = a[i], a[i + 1], a[i + 2]
    return x + k * (b[i] - x), y + k * (b[i + 1] - y), z + k * (b[i + 2] - z)


def _integral(pair: tuple[Entry, Entry], t: float) -> Vector:
    """Integral of the specific force up to ``t``."""
    a = pair[0]
    h = (t - a[0]) / 2
    x, y, z = _at(pair, t, 2)
    return a[5] + h * (a[2] + x), a[6] + h * (a[3] + y), a[7] + h * (a[4] + z)


def _displacement(samples: tuple[Entry, ...], t: float, s: float, model: Model) -> float:
    pair = around(samples, t, model.timeout)
    if pair is None:
        return s
    a, b = pair
    if a is b:
        return float(a[2])
    return float(a[2] + (t - a[0]) / (b[0] - a[0]) * (b[2] - a[2]))


def observe(filter_: Filter, motion: Motion, t: float, wire: Wrench,
            accelerometer: tuple[Entry, ...], displacement: tuple[Entry, ...], model: Model,
            ) -> tuple[Filter, ContactSample]:
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
    accelerometer, displacement : tuple of Entry
        Samples around ``t``.
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
    pair = around(displacement, t, model.timeout)
    if pair is not None:
        a, b = pair
        s = a[2] if a is b else a[2] + (t - a[0]) / (b[0] - a[0]) * (b[2] - a[2])
    elif model.stiffness > 0:
        status = st.DISPLACEMENT_FROM_FORCE
        s = filter_.s
        s += (1 - exp(-model.relaxation * dt)) * ((w0 - b0) / model.stiffness - s)
    else:
        s = 0.0
    status, f, omega, alpha = _kinematics(status, motion, t, accelerometer, model)
    if status & st.NO_GRAVITY:
        return filter_, ContactSample(t, filter_.contact, status, NOTHING, NOTHING, NOTHING)
    if model.limited and st.saturated(wire, model.wrench_limit):
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
    newton, axis = None, ZERO
    if model.newton:
        newton, axis, force = _newton(filter_, dt, t, w0 - b0, f, motion, model)
        contact = (force, m1, m2, m3, m4, m5)
    return (Filter(t, contact, s, newton, axis),
            ContactSample(t, contact, status, measured, innovation, inertial))


def _kinematics(status: int, motion: Motion, t: float, accelerometer: tuple[Entry, ...],
                model: Model) -> tuple[int, Vector, Vector, Vector]:
    """Return status, specific force at the accelerometer, angular velocity and acceleration."""
    rotation, place = motion.rotation, motion.place
    if rotation is None or t - rotation.t > model.pose_timeout:
        status |= st.NO_POSE
        omega = alpha = ZERO
    else:
        h = t - rotation.t
        wx, wy, wz = rotation.omega
        ax, ay, az = alpha = rotation.alpha
        omega = (wx + h * ax, wy + h * ay, wz + h * az)
        if not motion.position:
            status |= st.NO_POSITION
    pair = around(accelerometer, t, model.timeout)
    if pair is not None:
        fx, fy, fz = _at(pair, t, 2)
        if pair[0][8] or pair[1][8]:
            status |= st.SATURATED
        offset = motion.offset
        if offset is not None:
            fx, fy, fz = fx - offset[0], fy - offset[1], fz - offset[2]
        elif model.ac_rate:
            status |= st.NO_GRAVITY
        if place is None or status & st.NO_POSE:
            status |= st.OFFSET_HELD
        return status, (fx, fy, fz), omega, alpha
    if rotation is None or status & st.NO_POSE:
        return status | st.NO_ACCELEROMETER | st.NO_GRAVITY, ZERO, omega, alpha
    if place is None or place.run is not None:
        o = gravity_in_sensor(rotation.q, model.gravity)
    else:
        o = place.o
    o = _carried(o, omega, t - rotation.t)
    return status | st.NO_ACCELEROMETER, (-o[0], -o[1], -o[2]), omega, alpha


def _newton(filter_: Filter, dt: float, t: float, wire_x: float, f: Vector, motion: Motion,
            model: Model) -> tuple[NewtonState | None, Vector, float]:
    """
    Run the paper's observer along x; its force comes back in the wire's sign.

    Position and velocity are those of the tool as the pose filter has them; without a position
    they count as met, which leaves Newton's law. The paper's x does not turn: where the sensor
    does, the observer's position and velocity are turned along, so that only translation drives
    its error.
    """
    state, m = filter_.newton, model.load.m
    rotation, place = motion.rotation, motion.place
    if rotation is None or place is None or not motion.position:
        return None, ZERO, wire_x + m * f[0]
    g = gravity_in_sensor(rotation.q, model.gravity)[0]
    nx, ny, nz = axis = rotate(rotation.q, (1.0, 0.0, 0.0))
    v = nx * place.v[0] + ny * place.v[1] + nz * place.v[2]
    x = nx * place.p[0] + ny * place.p[1] + nz * place.p[2] + v * (t - place.t)
    if state is None or dt > PAUSE:
        state = NewtonState(x, v)
        dt = 0.0
    else:
        dx, dy, dz = nx - filter_.axis[0], ny - filter_.axis[1], nz - filter_.axis[2]
        (px, py, pz), (vx, vy, vz) = place.p, place.v
        state = NewtonState(state.x + dx * px + dy * py + dz * pz,
                            state.v + dx * vx + dy * vy + dz * vz)
    state, force = newton_step(state, dt, -wire_x + m * g, f[0] + g, x, v, m, model.K)
    return state, axis, -force
