"""The observer's one step: an event goes in, a new state and the estimates it completes come out.

Node and replay both call the ``on_...`` functions below and nothing else. They are pure, never
raise on a bad sample, and what they return depends on the stamps alone, not on the order in which
the topics arrived (see :mod:`forcecal_ros.observe.align`). Events are stamped in seconds since
any fixed instant; the wrench is as on the wire, environment on tool.

Latency: a wrench is answered by whichever event completes it. Accelerometer stamped alike and not
late: at once, with the later of the two messages. Else: ``delay`` (where positive) plus at most
one period of the accelerometer.
"""

from math import inf, isfinite, sqrt
from typing import NamedTuple

from forcecal_ros.observe import status as st
from forcecal_ros.observe.align import (
    Channel, PoseQueue, channel_ready, pose_ready, pruned, queued_pose, usable_from)
from forcecal_ros.observe.contact import (
    ZERO, ContactSample, Filter, Motion, Wrench, observe, take_pose)
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.tracking import Quaternion, Vector

CLOCK_JUMP = 1.0
"""A stamp that goes back by more than this starts everything anew [s]."""

KEEP = 0.005
"""Samples are kept a little longer than the wrench needs them, for poses that come late [s]."""


class State(NamedTuple):
    """Everything the observer remembers."""

    wrenches: tuple[tuple[float, Wrench], ...] = ()
    newest: float = -inf
    first: float = inf
    accelerometer: Channel = Channel()
    wash: Vector = ZERO
    """What an AC-coupled accelerometer has forgotten of the specific force [m/s^2]."""
    displacement: Channel = Channel()
    poses: PoseQueue = PoseQueue()
    motion: Motion = Motion()
    filter: Filter = Filter()
    dropped: tuple[int, int, int, int] = (0, 0, 0, 0)
    """Samples not used: wrench, accelerometer, pose, displacement."""


Result = tuple[State, tuple[ContactSample, ...]]


def _drop(state: State, which: int, count: int = 1) -> State:
    dropped = list(state.dropped)
    dropped[which] += count
    return state._replace(dropped=(dropped[0], dropped[1], dropped[2], dropped[3]))


def on_wrench(state: State, t: float, wrench: Wrench, model: Model) -> Result:
    """
    Take in one reading of the force sensor.

    Parameters
    ----------
    state : State
    t : float
        Stamp [s].
    wrench : tuple of 6 float
        Force [N] and torque [N m], environment on tool, bias included.
    model : Model

    Returns
    -------
    state : State
    samples : tuple of ContactSample
        In order of time; empty while a slower stream is waited for.
    """
    if not t > state.newest:
        if t < state.newest - CLOCK_JUMP:
            return on_wrench(State(dropped=state.dropped), t, wrench, model)
        return _drop(state, 0), ()
    if t == inf:
        return _drop(state, 0), ()
    first = state.first
    accelerometer, displacement, poses = state.accelerometer, state.displacement, state.poses
    if first == inf:
        first = t
    return _release(State(
        (*state.wrenches, (t, wrench)), t, first, accelerometer, state.wash, displacement, poses,
        state.motion, state.filter, state.dropped), model)


def on_accelerometer(state: State, t: float, reading: Vector, model: Model) -> Result:
    """
    Take in one reading of the accelerometer.

    Parameters
    ----------
    state : State
    t : float
        Stamp as sent [s].
    reading : tuple of 3 float
        In the unit of the calibration: volts, or m/s^2.
    model : Model

    Returns
    -------
    state : State
    samples : tuple of ContactSample
    """
    channel = state.accelerometer
    last = channel.last
    v0, v1, v2 = reading
    if not (last < t < inf and isfinite(v0 + v1 + v2) and model.accelerometer):
        if t < last - CLOCK_JUMP:
            return on_accelerometer(State(dropped=state.dropped), t, reading, model)
        return _drop(state, 1), ()
    o0, o1, o2, a, b, c, d, e, f, g, h, i = model.volts
    limits = model.accelerometer_limit
    full = limits[0] < inf and st.saturated(reading, limits)
    v0, v1, v2 = v0 - o0, v1 - o1, v2 - o2
    fx, fy, fz = a * v0 + b * v1 + c * v2, d * v0 + e * v1 + f * v2, g * v0 + h * v1 + i * v2
    tau = t - model.delay
    jx = jy = jz = 0.0
    wash = state.wash
    samples = channel.samples
    if samples:
        before = samples[-1]
        half = (tau - before[0]) / 2
        if model.ac_rate:
            # y is what is left of f after the high-pass: dz/dt = rate y, f = y + z
            gain = half * model.ac_rate
            zx, zy, zz = wash
            zx += gain * (before[2] - zx + fx)
            zy += gain * (before[3] - zy + fy)
            zz += gain * (before[4] - zz + fz)
            wash = (zx, zy, zz)
            fx, fy, fz = fx + zx, fy + zy, fz + zz
        jx = before[5] + half * (before[2] + fx)
        jy = before[6] + half * (before[3] + fy)
        jz = before[7] + half * (before[4] + fz)
    usable = channel.usable
    start = usable_from(last, t, model.delay, state.first, model.timeout, model.skew)
    if start > -inf:
        usable = start
    entry = (tau, usable, fx, fy, fz, jx, jy, jz, full)
    return _release(State(
        state.wrenches, state.newest, state.first, Channel((*samples, entry), t, usable), wash,
        state.displacement, state.poses, state.motion, state.filter, state.dropped), model)


def on_displacement(state: State, t: float, s: float, model: Model) -> Result:
    """
    Take in one reading of the compliant tool's displacement.

    Parameters
    ----------
    state : State
    t : float
        Stamp [s].
    s : float
        Along x of ft_sensor [m].
    model : Model

    Returns
    -------
    state : State
    samples : tuple of ContactSample
    """
    channel = state.displacement
    last = channel.last
    if not (last < t < inf and isfinite(s)):
        if t < last - CLOCK_JUMP:
            return on_displacement(State(dropped=state.dropped), t, s, model)
        return _drop(state, 3), ()
    usable = channel.usable
    start = usable_from(last, t, 0.0, state.first, model.timeout, model.skew)
    if start > -inf:
        usable = start
    return _release(State(
        state.wrenches, state.newest, state.first, state.accelerometer, state.wash,
        Channel((*channel.samples, (t, usable, s)), t, usable), state.poses, state.motion,
        state.filter, state.dropped), model)


def on_pose(state: State, t: float, position: Vector, q: Quaternion, model: Model) -> Result:
    """
    Take in one measured pose of ft_sensor in base.

    Parameters
    ----------
    state : State
    t : float
        Stamp [s].
    position : tuple of 3 float
        [m]; not finite where only the orientation is known.
    q : tuple of 4 float
        Quaternion xyzw.
    model : Model

    Returns
    -------
    state : State
    samples : tuple of ContactSample
    """
    x, y, z, w = q
    n2 = x * x + y * y + z * z + w * w
    last = state.poses.last
    if not (last < t < inf and 0.25 < n2 < 4.0):
        if t < last - CLOCK_JUMP:
            return on_pose(State(dropped=state.dropped), t, position, q, model)
        return _drop(state, 2), ()
    n = 1 / sqrt(n2)
    poses = queued_pose(state.poses, t, (position, (x * n, y * n, z * n, w * n)), state.first,
                        model.pose_timeout, model.skew)
    return _release(state._replace(poses=poses), model)


def _release(state: State, model: Model) -> Result:
    """Answer the wrenches that have waited long enough."""
    wrenches = state.wrenches
    if not wrenches:
        return state, ()
    now, first, poses = state.newest, state.first, state.poses
    wait = model.timeout + model.skew
    out: list[ContactSample] = []
    accelerometer, displacement = state.accelerometer, state.displacement
    motion, filter_ = state.motion, state.filter
    while wrenches:
        t, wire = wrenches[0]
        if not ((not model.accelerometer or channel_ready(accelerometer, t, now, first, wait))
                and channel_ready(displacement, t, now, first, wait)
                and pose_ready(poses, t, now, first, model.pose_timeout, model.skew)):
            break
        wrenches = wrenches[1:]
        pending = poses.pending
        while pending and pending[0][1] <= t:
            motion = take_pose(motion, pending[0], accelerometer.samples,
                               displacement.samples, filter_.s, model)
            pending = pending[1:]
            poses = PoseQueue(pending, poses.last, poses.due)
        filter_, sample = observe(filter_, motion, t, wire, accelerometer.samples,
                                  displacement.samples, model)
        out.append(sample)
        accelerometer = Channel(pruned(accelerometer.samples, t - KEEP), accelerometer.last,
                                accelerometer.usable)
        displacement = Channel(pruned(displacement.samples, t - KEEP), displacement.last,
                               displacement.usable)
    if not out:
        return state, ()
    return State(wrenches, now, first, accelerometer, state.wash, displacement, poses, motion,
                 filter_, state.dropped), tuple(out)


def finish(state: State, model: Model) -> Result:
    """
    Answer the wrenches still waiting, as if every other stream had stopped.

    Parameters
    ----------
    state : State
    model : Model

    Returns
    -------
    state : State
    samples : tuple of ContactSample
    """
    released, samples = _release(state._replace(newest=inf), model)
    return released._replace(newest=state.newest), samples
