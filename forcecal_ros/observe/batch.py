"""
The chain over a whole recording at once: the functions of the step, compiled.

A recording holds all samples, so nothing is waited for. The rules of :mod:`~forcecal_ros.observe.
align` decide here as there which samples a wrench uses; only the storage differs.
"""

from math import inf, sqrt

from forcecal_ros.core import jit
from forcecal_ros.core.geometry import Array, quaternion_from_matrix, ZERO
from forcecal_ros.core.jit import compiled_with_all_it_calls
from forcecal_ros.core.sensor_matrix import all_corrected
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe.align import displacement_at, force_at, run_of, SAME_STAMP_S, turn_of
from forcecal_ros.observe.bias_filter import begin, BiasModel, learn
from forcecal_ros.observe.contact import filtered, Memory, Tool, unload
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.motion import MotionEstimate, next_sample, NOTHING_BEFORE, take_pose
from forcecal_ros.observe.sample import (
    ContactEstimate,
    ContactSample,
    Learned,
    MAX_READING,
    Progress,
    silent,
    stacked,
    Unloaded,
)
import numpy as np
from numpy.typing import NDArray


def in_order(recording: Recording) -> bool:
    """Whether the stamps of all streams increase, as the batch needs them."""
    streams = (recording.wrench, recording.accelerometer, recording.optidrive, recording.pose)
    return all(np.isfinite(one.t).all() and (np.diff(one.t) > SAME_STAMP_S).all()
               for one in streams if one is not None)


def estimates(recording: Recording, model: Model, progress: Progress = silent) -> ContactEstimate:
    """Answer every wrench of a recording whose streams are :func:`in_order`."""
    wrench = recording.wrench
    assert wrench is not None
    wires = wrench.values
    if model.sensor_matrix is not None:
        wires = all_corrected(wires, model.sensor_matrix)
    first = float(wrench.t[0])
    force, no_force = _forces(recording.accelerometer, first, model)
    slide, no_slide = _slides(recording.optidrive, first, model)
    poses, no_pose = _poses(recording.pose, first, model)
    wrenches, status = np.empty((4, len(wrench), 6)), np.empty(len(wrench), np.int64)
    _observe_all(wrench.t, _one_layout(wires), force, slide, poses, _plain(model),
                 MotionEstimate(), Tool(), Memory(), wrenches, status)
    learned = None
    if model.bias_filter is not None:
        learned = _learn_all(wrench.t, wrenches, status, model.bias_filter, progress)
    contact, measured, innovation, inertial = wrenches
    return ContactEstimate(wrench.t, contact, measured, innovation, inertial, status,
                           (0, no_force, no_pose, no_slide), learned)


def _plain(model: Model) -> Model:
    """Leave out what is done before and after, which compiled code does not know."""
    return model._replace(sensor_matrix=None, bias_filter=None)


def _learn_all(t: Array, wrenches: Array, status: NDArray[np.int64], model: BiasModel,
               progress: Progress) -> Learned:
    """Put what the filter makes of each wrench in the place of the unfiltered one."""
    contact, measured, innovation, inertial = wrenches
    belief, rows = begin(model), []
    for k, (one, bits, m, i) in enumerate(zip(
            t.tolist(), status.tolist(), measured.tolist(), inertial.tolist())):
        belief, sample = learn(belief, Unloaded(one, bits, tuple(m), tuple(i), ZERO), model)
        contact[k], innovation[k], status[k] = sample.contact, sample.innovation, sample.status
        assert sample.learned is not None
        rows.append(sample.learned)
        progress(1)
    return stacked(rows)


def _one_layout(values: Array) -> Array:
    """Return contiguous read-only rows, so that one compilation serves all callers."""
    return np.broadcast_to(np.ascontiguousarray(values), values.shape)


def waits_for_compiler() -> bool:
    """Whether the first recording has to wait until the observer is compiled."""
    return jit.waits_for_compiler(_take_forces, _take_slides, _take_poses, _observe_all)


def _forces(stream: Stream | None, first: float, model: Model) -> tuple[Array, int]:
    """Return samples as rows, and how many readings were not used."""
    if stream is None or not model.accelerometer:
        return np.empty((0, 9)), 0 if stream is None else len(stream)
    samples = np.empty((len(stream), 9))
    n = _take_forces(stream.t, _one_layout(stream.values), first, _plain(model), samples)
    return samples[:n], len(stream) - n


def _slides(stream: Stream | None, first: float, model: Model) -> tuple[Array, int]:
    if stream is None:
        return np.empty((0, 3)), 0
    samples = np.empty((len(stream), 3))
    n = _take_slides(stream.t, _one_layout(stream.values), first, model.displacement_timeout,
                     model.skew, samples)
    return samples[:n], len(stream) - n


def _poses(stream: PoseStream | None, first: float, model: Model) -> tuple[Array, int]:
    """Return rows of stamp, stamp from which on it counts, position, quaternion."""
    if stream is None or not len(stream):
        return np.empty((0, 9)), 0
    q = quaternion_from_matrix(stream.R_base_sensor)
    rows = np.column_stack([stream.t, stream.t, stream.position, q])
    n = _take_poses(rows, first, model.pose_timeout, model.skew)
    return rows[:n], len(stream) - n


@compiled_with_all_it_calls
def _take_forces(t: Array, readings: Array, first: float, model: Model, samples: Array) -> int:
    n, last, before, highpass = 0, -inf, NOTHING_BEFORE, (0.0, 0.0, 0.0)
    for i in range(len(t)):
        v0, v1, v2 = reading = (readings[i, 0], readings[i, 1], readings[i, 2])
        if abs(v0) + abs(v1) + abs(v2) < MAX_READING:
            begins, usable = run_of(before[1], last, t[i], model.delay,
                                    first if t[i] > first else inf, model.timeout, model.skew)
            before, highpass = next_sample(before, highpass, t[i], reading, usable, begins, model)
            (samples[n, 0], samples[n, 1], samples[n, 2], samples[n, 3], samples[n, 4],
             samples[n, 5], samples[n, 6], samples[n, 7], samples[n, 8]) = before
            n, last = n + 1, t[i]
    return n


@compiled_with_all_it_calls
def _take_slides(t: Array, readings: Array, first: float, timeout: float, skew: float,
                 samples: Array) -> int:
    n, last, usable = 0, -inf, -inf
    for i in range(len(t)):
        if abs(readings[i, 0]) < MAX_READING:
            _, usable = run_of(usable, last, t[i], 0.0, first if t[i] > first else inf, timeout,
                               skew)
            samples[n, 0], samples[n, 1], samples[n, 2] = t[i], usable, readings[i, 0]
            n, last = n + 1, t[i]
    return n


@compiled_with_all_it_calls
def _take_poses(rows: Array, first: float, timeout: float, skew: float) -> int:
    n, last, due = 0, -inf, -inf
    for i in range(len(rows)):
        t = rows[i, 0]
        n2 = rows[i, 5] ** 2 + rows[i, 6] ** 2 + rows[i, 7] ** 2 + rows[i, 8] ** 2
        if 0.25 < n2 < 4.0:
            effective, due = turn_of(last, due, t, first if t > first else inf, timeout, skew)
            for k in range(9):
                rows[n, k] = rows[i, k] / sqrt(n2) if k > 4 else rows[i, k]
            rows[n, 1] = effective
            n, last = n + 1, t
    return n


def _last_before(table: Array, i: int, t: float) -> int:
    """Go on from row i to the last one not after t."""
    while i + 1 < len(table) and table[i + 1, 0] <= t:
        i += 1
    return i


def _write(sample: ContactSample, out: Array) -> None:
    for i in range(6):
        out[0, i] = sample.contact[i]
        out[1, i] = sample.measured[i]
        out[2, i] = sample.innovation[i]
        out[3, i] = sample.inertial[i]


@compiled_with_all_it_calls
def _observe_all(times: Array, wires: Array, force: Array, slide: Array, poses: Array,
                 model: Model, motion: MotionEstimate, tool: Tool, memory: Memory, wrenches: Array,
                 status: NDArray[np.int64]) -> None:
    f = s = p = pose_f = pose_s = 0
    for k in range(len(times)):
        t = times[k]
        if p < len(poses) and poses[p, 1] <= t:
            while p + 1 < len(poses) and poses[p + 1, 0] <= t - model.reach:
                p += 1
            while p < len(poses) and poses[p, 1] <= t:
                stamp, row = poses[p, 0], poses[p]
                pose_f = _last_before(force, pose_f, stamp)
                pose_s = _last_before(slide, pose_s, stamp)
                slid = displacement_at(slide[pose_s:pose_s + 2], stamp,
                                       model.displacement_timeout)
                motion = take_pose(
                    motion, stamp, (row[2], row[3], row[4]), (row[5], row[6], row[7], row[8]),
                    stamp < t - model.keep,
                    force_at(force[pose_f:pose_f + 2], stamp, model.timeout, True),
                    slid if slid == slid else tool.s, model)
                p += 1
        f, s = _last_before(force, f, t), _last_before(slide, s, t)
        wire = (wires[k, 0], wires[k, 1], wires[k, 2], wires[k, 3], wires[k, 4], wires[k, 5])
        tool, reading = unload(
            tool, motion, t, wire, force_at(force[f:f + 2], t, model.timeout, False),
            displacement_at(slide[s:s + 2], t, model.displacement_timeout), model)
        memory, sample = filtered(memory, reading, motion, model)
        status[k] = sample.status
        _write(sample, wrenches[:, k])
