"""The chain's one step: an event goes in, a new state and the samples it completes come out.

The way of a wrench:

    sensor matrix     raw channels to a wrench in ft_sensor        core.sensor_matrix
    align             what each stream says at its stamp           align, specific_force
    motion            orientation, place, offset by the poses      motion, tracking
    weight, inertia   bias and load of the tool off                unload, inertial
    filter            kalman, newton, ukf, ekf or none             contact, filters

Node and replay both call the ``on_...`` functions below and nothing else. They are pure, never
raise on a bad sample, and what they return depends on the stamps alone, not on the order in which
the topics arrived (see :mod:`forcecal_ros.observe.align`). Events are stamped in seconds since
any fixed instant; the wrench is as on the wire, environment on tool.

Latency: a wrench is answered by whichever event completes it. Accelerometer stamped alike and not
late: at once, with the later of the two messages. Else: ``delay`` (where positive) plus at most
one period of the accelerometer.
"""

from math import inf, sqrt
from typing import NamedTuple

from forcecal_ros.checks.signals import ABSURD
from forcecal_ros.core.sensor_matrix import corrected
from forcecal_ros.observe.align import (
    bounded,
    Channel,
    channel_ready,
    displacement_at,
    Entry,
    force_at,
    pose_ready,
    PoseQueue,
    pruned,
    pruned_channel,
    queued_pose,
    SAME,
    usable_from,
)
from forcecal_ros.observe.contact import filtered
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.bias_filter import Belief, learn
from forcecal_ros.observe.filters.memory import Memory
from forcecal_ros.observe.motion import MotionEstimate, next_sample, NOTHING_BEFORE, take_pose
from forcecal_ros.observe.sample import ContactSample, Wrench
from forcecal_ros.observe.tracking import Quaternion, Vector
from forcecal_ros.observe.unload import Tool, unload

CLOCK_JUMP = 1.0
"""Stamps that go back by more than this, twice, are a new clock; one is a bad stamp. Longer than
any message is late, shorter than any clock is set back [s]."""


class Refusals(NamedTuple):
    """
    Messages that were not used: wrench, accelerometer, pose, displacement.

    Attributes
    ----------
    counts : tuple of int
    stamps : tuple of float
        Of the last one each [s].
    """

    counts: tuple[int, ...] = (0, 0, 0, 0)
    stamps: tuple[float, ...] = (-inf, -inf, -inf, -inf)


class State(NamedTuple):
    """
    Everything the chain remembers.

    Attributes
    ----------
    wrenches : tuple
        Those still waiting, each (stamp, wrench).
    newest, first : float
        Stamps of the newest and the first wrench [s].
    accelerometer, displacement, poses
        What may still be needed of these streams.
    motion : MotionEstimate
    tool : Tool
    filter : Memory or Belief
        Of the compiled filters, or of ``ukf`` and ``ekf``.
    refusals : Refusals
    """

    wrenches: tuple[tuple[float, Wrench], ...] = ()
    newest: float = -inf
    first: float = inf
    accelerometer: Channel = Channel()
    displacement: Channel = Channel()
    poses: PoseQueue = PoseQueue()
    motion: MotionEstimate = MotionEstimate()
    tool: Tool = Tool()
    filter: Memory | Belief = Memory()
    refusals: Refusals = Refusals()


Result = tuple[State, tuple[ContactSample, ...]]
"""The new state, and samples in order of time: none while a slower stream is waited for."""


def _refuse(state: State, which: int, t: float, last: float) -> tuple[State, bool]:
    """Count a message that is not used; the second that agrees on an earlier clock starts anew."""
    counts, stamps = list(state.refusals.counts), list(state.refusals.stamps)
    again = t < last - CLOCK_JUMP and 0 < t - stamps[which] < CLOCK_JUMP
    counts[which] += not again
    stamps[which] = t
    return state._replace(refusals=Refusals(tuple(counts), tuple(stamps))), again


def on_wrench(state: State, t: float, wrench: Wrench, model: Model) -> Result:
    """
    Take in one reading of the force sensor.

    Parameters
    ----------
    t : float
        Stamp [s].
    wrench : tuple of 6 float
        Force [N] and torque [N m], environment on tool, bias included; raw channels where the
        calibration holds a six-axis matrix.
    """
    if not (t - state.newest > SAME and t < inf):
        state, again = _refuse(state, 0, t, state.newest)
        if again:
            return on_wrench(State(refusals=state.refusals), t, wrench, model)
        return state, ()
    if model.sensor_matrix is not None:
        wrench = corrected(wrench, model.sensor_matrix)
    return _release(State(
        (*state.wrenches, (t, wrench)), t, min(state.first, t), state.accelerometer,
        state.displacement, state.poses, state.motion, state.tool, state.filter,
        state.refusals), model)


def on_accelerometer(state: State, t: float, reading: Vector, model: Model) -> Result:
    """
    Take in one reading of the accelerometer.

    Parameters
    ----------
    t : float
        Stamp as sent [s].
    reading : tuple of 3 float
        In the unit of the calibration: volts, or m/s^2.
    """
    channel = state.accelerometer
    last = channel.last
    v0, v1, v2 = reading
    if not (t - last > SAME and t < inf and model.accelerometer
            and abs(v0) + abs(v1) + abs(v2) < ABSURD):
        state, again = _refuse(state, 1, t, last)
        if again:
            return on_accelerometer(
                state._replace(accelerometer=Channel()), t, reading, model)
        return state, ()
    samples = channel.samples
    begins = t - last > model.timeout
    if begins:
        usable = usable_from(last, t, model.delay, state.first, model.timeout, model.skew)
        before = NOTHING_BEFORE
    else:
        before = samples[-1]
        usable = before[1]
    sample, highpass = next_sample(before, channel.highpass, t, reading, usable, begins, model)
    samples = bounded((*samples, sample), model.memory)
    return _release(State(
        state.wrenches, state.newest, state.first, Channel(samples, t, highpass),
        state.displacement, state.poses, state.motion, state.tool, state.filter,
        state.refusals), model)


def on_displacement(state: State, t: float, s: float, model: Model) -> Result:
    """
    Take in one reading of the compliant tool's displacement.

    Parameters
    ----------
    t : float
        Stamp [s].
    s : float
        Along x of ft_sensor [m].
    """
    channel = state.displacement
    last = channel.last
    if not (t - last > SAME and t < inf and abs(s) < ABSURD):
        state, again = _refuse(state, 3, t, last)
        if again:
            return on_displacement(state._replace(displacement=Channel()), t, s, model)
        return state, ()
    samples = channel.samples
    timeout = model.displacement_timeout
    if t - last > timeout:
        usable = usable_from(last, t, 0.0, state.first, timeout, model.skew)
    else:
        usable = samples[-1][1]
    samples = bounded((*samples, (t, usable, s)), model.memory)
    return _release(State(
        state.wrenches, state.newest, state.first, state.accelerometer, Channel(samples, t),
        state.poses, state.motion, state.tool, state.filter, state.refusals), model)


def on_pose(state: State, t: float, position: Vector, q: Quaternion, model: Model) -> Result:
    """
    Take in one measured pose of ft_sensor in base.

    Parameters
    ----------
    t : float
        Stamp [s].
    position : tuple of 3 float
        [m]; not finite where only the orientation is known.
    q : tuple of 4 float
        Quaternion xyzw.
    """
    x, y, z, w = q
    n2 = x * x + y * y + z * z + w * w
    last = state.poses.last
    if not (t - last > SAME and t < inf and 0.25 < n2 < 4.0):
        state, again = _refuse(state, 2, t, last)
        if again:
            return on_pose(state._replace(poses=PoseQueue()), t, position, q, model)
        return state, ()
    n = 1 / sqrt(n2)
    poses = queued_pose(state.poses, t, (position, (x * n, y * n, z * n, w * n)), state.first,
                        model.pose_timeout, model.skew, model.memory)
    return _release(State(
        state.wrenches, state.newest, state.first, state.accelerometer, state.displacement,
        poses, state.motion, state.tool, state.filter, state.refusals), model)


def _release(state: State, model: Model) -> Result:
    """Answer the wrenches that have waited long enough."""
    if not state.wrenches:
        return state, ()
    (wrenches, now, first, accelerometer, displacement, poses, motion, tool, memory,
     refusals) = state
    wait, displacement_wait = model.timeout + model.skew, model.displacement_timeout + model.skew
    out: list[ContactSample] = []
    while wrenches:
        t, wire = wrenches[0]
        if not ((not model.accelerometer or channel_ready(accelerometer, t, now, first, wait))
                and channel_ready(displacement, t, now, first, displacement_wait)
                and pose_ready(poses, t, now, first, model.pose_timeout, model.skew)):
            break
        wrenches = wrenches[1:]
        if poses.pending and poses.pending[0][1] <= t:
            poses, motion = _take_poses(poses, motion, t, accelerometer.samples,
                                        displacement.samples, tool.s, model)
        tool, reading = unload(
            tool, motion, t, wire, force_at(accelerometer.samples, t, model.timeout, False),
            displacement_at(displacement.samples, t, model.displacement_timeout), model)
        if model.bias_filter is None:
            memory, sample = filtered(
                memory if isinstance(memory, Memory) else Memory(), reading, motion, model)
        else:
            memory, sample = learn(memory, reading, model.bias_filter)
        out.append(sample)
        accelerometer = pruned_channel(accelerometer, t - model.keep)
        displacement = pruned_channel(displacement, t - model.keep)
    if not out:
        return state, ()
    return State(wrenches, now, first, accelerometer, displacement, poses, motion, tool, memory,
                 refusals), tuple(out)


def _take_poses(poses: PoseQueue, motion: MotionEstimate, t: float,
                accelerometer: tuple[Entry, ...], displacement: tuple[Entry, ...], s: float,
                model: Model) -> tuple[PoseQueue, MotionEstimate]:
    """Take in the poses that count for a wrench at ``t``."""
    pending = pruned(poses.pending, t - model.reach)
    while pending and pending[0][1] <= t:
        stamp, _, position, q = pending[0]
        slid = displacement_at(displacement, stamp, model.displacement_timeout)
        motion = take_pose(
            motion, stamp, position, q, stamp < t - model.keep,
            force_at(accelerometer, stamp, model.timeout, True), slid if slid == slid else s,
            model)
        pending = pending[1:]
    return PoseQueue(pending, poses.last, poses.due), motion


def finish(state: State, model: Model) -> Result:
    """Answer the wrenches still waiting, as if every other stream had stopped."""
    released, samples = _release(state._replace(newest=inf), model)
    return released._replace(newest=state.newest), samples
