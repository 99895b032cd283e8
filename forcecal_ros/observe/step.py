"""The chain's one step: an event goes in, a new state and the samples it completes come out.

The path of a wrench:

    sensor matrix     raw channels to a wrench in ft_sensor        core.sensor_matrix
    align             each stream at its stamp                     align
    motion            orientation, place, offset by the poses      motion
    weight, inertia   bias and load of the tool removed            contact
    filter            kalman, newton, ukf, ekf or none             contact, bias_filter

Node and replay both call the ``on_...`` functions below and nothing else. They never raise on a
bad sample, and what they return depends on the stamps alone, not on the order in which
the topics arrived (see :mod:`forcecal_ros.observe.align`). Events are stamped in seconds since
any fixed instant; the wrench is as on the wire, environment on tool.

Latency: a wrench is answered by whichever event completes it. Accelerometer stamped alike and not
late: at once, with the later of the two messages. Else: ``delay`` (where positive) plus at most
one period of the accelerometer.
"""

from dataclasses import dataclass, field
from math import inf, sqrt
from typing import NamedTuple

from forcecal_ros.core.geometry import Quaternion, Vector
from forcecal_ros.core.sensor_matrix import corrected
from forcecal_ros.core.streams import CLOCK_JUMP_S
from forcecal_ros.observe.align import (
    bounded,
    Channel,
    channel_ready,
    displacement_at,
    force_at,
    pose_ready,
    PoseQueue,
    pruned,
    pruned_channel,
    queued_pose,
    run_of,
    SAME_STAMP_S,
)
from forcecal_ros.observe.bias_filter import Belief, learn
from forcecal_ros.observe.contact import filtered, Memory, Tool, unload
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.motion import MotionEstimate, next_sample, NOTHING_BEFORE, take_pose
from forcecal_ros.observe.sample import ContactSample, MAX_READING, Wrench


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


@dataclass(slots=True, eq=False)
class State:
    """
    Everything the chain remembers; the functions below update it in place and return it.

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
    accelerometer: Channel = field(default_factory=Channel)
    displacement: Channel = field(default_factory=Channel)
    poses: PoseQueue = field(default_factory=PoseQueue)
    motion: MotionEstimate = field(default_factory=MotionEstimate)
    tool: Tool = field(default_factory=Tool)
    filter: Memory | Belief = field(default_factory=Memory)
    refusals: Refusals = field(default_factory=Refusals)


Result = tuple[State, tuple[ContactSample, ...]]
"""The new state, and samples in order of time: none while a slower stream is waited for."""


def _refuse(state: State, which: int, t: float, last: float) -> bool:
    """Count a message that is not used; the second that agrees on an earlier clock starts anew."""
    counts, stamps = list(state.refusals.counts), list(state.refusals.stamps)
    again = t < last - CLOCK_JUMP_S and 0 < t - stamps[which] < CLOCK_JUMP_S
    counts[which] += not again
    stamps[which] = t
    state.refusals = Refusals(tuple(counts), tuple(stamps))
    return again


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
    if not (t - state.newest > SAME_STAMP_S and t < inf):
        if not _refuse(state, 0, t, state.newest):
            return state, ()
        return on_wrench(State(refusals=state.refusals), t, wrench, model)
    if model.sensor_matrix is not None:
        wrench = corrected(wrench, model.sensor_matrix)
    state.wrenches, state.newest = (*state.wrenches, (t, wrench)), t
    state.first = min(state.first, t)
    return _release(state, model)


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
    if not (t - last > SAME_STAMP_S and t < inf and model.accelerometer
            and abs(v0) + abs(v1) + abs(v2) < MAX_READING):
        if not _refuse(state, 1, t, last):
            return state, ()
        state.accelerometer = Channel()
        return on_accelerometer(state, t, reading, model)
    samples = channel.samples
    before = samples[-1] if samples else NOTHING_BEFORE
    begins, usable = run_of(before[1], last, t, model.delay, state.first, model.timeout,
                            model.skew)
    sample, highpass = next_sample(before, channel.highpass, t, reading, usable, begins, model)
    samples = bounded((*samples, sample), model.memory)
    state.accelerometer = Channel(samples, t, highpass)
    return _release(state, model)


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
    if not (t - last > SAME_STAMP_S and t < inf and abs(s) < MAX_READING):
        if not _refuse(state, 3, t, last):
            return state, ()
        state.displacement = Channel()
        return on_displacement(state, t, s, model)
    samples = channel.samples
    _, usable = run_of(samples[-1][1] if samples else -inf, last, t, 0.0, state.first,
                       model.displacement_timeout, model.skew)
    samples = bounded((*samples, (t, usable, s)), model.memory)
    state.displacement = Channel(samples, t)
    return _release(state, model)


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
    if not (t - last > SAME_STAMP_S and t < inf and 0.25 < n2 < 4.0):
        if not _refuse(state, 2, t, last):
            return state, ()
        state.poses = PoseQueue()
        return on_pose(state, t, position, q, model)
    n = 1 / sqrt(n2)
    state.poses = queued_pose(
        state.poses, t, (position, (x * n, y * n, z * n, w * n)), state.first,
        model.pose_timeout, model.skew, model.memory)
    return _release(state, model)


def _release(state: State, model: Model) -> Result:
    """Answer the wrenches that have waited long enough."""
    out: list[ContactSample] = []
    wait, displacement_wait = model.timeout + model.skew, model.displacement_timeout + model.skew
    now, first = state.newest, state.first
    while state.wrenches:
        t, wire = state.wrenches[0]
        accelerometer, displacement, poses = state.accelerometer, state.displacement, state.poses
        if not ((not model.accelerometer or channel_ready(accelerometer, t, now, first, wait))
                and channel_ready(displacement, t, now, first, displacement_wait)
                and pose_ready(poses, t, now, first, model.pose_timeout, model.skew)):
            break
        state.wrenches = state.wrenches[1:]
        if poses.pending and poses.pending[0][1] <= t:
            _take_poses(state, t, model)
        state.tool, reading = unload(
            state.tool, state.motion, t, wire,
            force_at(accelerometer.samples, t, model.timeout, False),
            displacement_at(displacement.samples, t, model.displacement_timeout), model)
        if model.bias_filter is None:
            memory = state.filter if isinstance(state.filter, Memory) else Memory()
            state.filter, sample = filtered(memory, reading, state.motion, model)
        else:
            state.filter, sample = learn(state.filter, reading, model.bias_filter)
        out.append(sample)
        state.accelerometer = pruned_channel(accelerometer, t - model.keep)
        state.displacement = pruned_channel(displacement, t - model.keep)
    return state, tuple(out)


def _take_poses(state: State, t: float, model: Model) -> None:
    """Take in the poses that count for a wrench at ``t``."""
    poses = state.poses
    pending = pruned(poses.pending, t - model.reach)
    while pending and pending[0][1] <= t:
        stamp, _, position, q = pending[0]
        slid = displacement_at(state.displacement.samples, stamp, model.displacement_timeout)
        state.motion = take_pose(
            state.motion, stamp, position, q, stamp < t - model.keep,
            force_at(state.accelerometer.samples, stamp, model.timeout, True),
            slid if slid == slid else state.tool.s, model)
        pending = pending[1:]
    state.poses = PoseQueue(pending, poses.last, poses.due)


def finish(state: State, model: Model) -> Result:
    """Answer the wrenches still waiting, as if every other stream had stopped."""
    newest, state.newest = state.newest, inf
    _, samples = _release(state, model)
    state.newest = newest
    return state, samples
