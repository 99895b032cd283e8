"""The chain over a whole recording at once: the functions of the step, compiled.

Only what decides which samples a wrench sees is written anew, for arrays: a recording holds all
of them, so nothing is waited for.
"""

from math import inf

from forcecal_ros.checks.signals import ABSURD
from forcecal_ros.core import jit
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.jit import compiled_with_all_it_calls
from forcecal_ros.core.sensor_matrix import all_corrected
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe.align import displacement_at, force_at, SAME, usable_from
from forcecal_ros.observe.contact import filtered
from forcecal_ros.observe.design import Model
from forcecal_ros.observe.filters.bias_filter import begin, learn
from forcecal_ros.observe.filters.bias_model import BiasModel
from forcecal_ros.observe.filters.memory import Memory
from forcecal_ros.observe.motion import MotionEstimate, next_sample, NOTHING_BEFORE, take_pose
from forcecal_ros.observe.sample import (
    ContactEstimate,
    ContactSample,
    Learned,
    Progress,
    silent,
    stacked,
)
from forcecal_ros.observe.tracking import ZERO
from forcecal_ros.observe.unload import Tool, unload, Unloaded
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


def in_order(recording: Recording) -> bool:
    """Whether the stamps of all streams increase, as the batch wants them."""
    streams = (recording.wrench, recording.accelerometer, recording.optidrive, recording.pose)
    return all(np.isfinite(one.t).all() and (np.diff(one.t) > SAME).all()
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
    _observe_all(wrench.t, np.ascontiguousarray(wires), force, slide, poses, _plain(model),
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


def waits_for_compiler() -> bool:
    """Whether the first recording has to wait until the observer is compiled."""
    return jit.waits_for_compiler(_integrate, _observe_all)


def _begins(t: Array, timeout: float) -> Mask:
    """Tell where a stream begins, and where it begins again."""
    return np.asarray(np.diff(t, prepend=-inf) > timeout)


def _usable(t: Array, begins: Mask, lead: float, first: float, timeout: float, skew: float
            ) -> Array:
    """Return for each sample when its run may be used; -inf where it only continues one."""
    usable = np.full(len(t), -inf)
    for i in np.flatnonzero(begins):
        last = float(t[i - 1]) if i else -inf
        usable[i] = usable_from(
            last, float(t[i]), lead, first if t[i] > first else inf, timeout, skew)
    return usable


def _of_run(values: Array, begins: Mask) -> Array:
    """Let every sample have the value of the one its run begins with."""
    return np.asarray(values[begins][np.cumsum(begins) - 1])


def _forces(stream: Stream | None, first: float, model: Model) -> tuple[Array, int]:
    """Return samples as rows, and how many readings were not used."""
    if stream is None or not model.accelerometer:
        return np.empty((0, 9)), 0 if stream is None else len(stream)
    with np.errstate(invalid='ignore'):
        good = np.abs(stream.values).sum(axis=1) < ABSURD
    t = stream.t[good]
    begins = _begins(t, model.timeout)
    usable = _usable(t, begins, model.delay, first, model.timeout, model.skew)
    samples = np.empty((len(t), 9))
    _integrate(t, stream.values[good], _of_run(usable, begins), begins, _plain(model), samples)
    return samples, int((~good).sum())


def _slides(stream: Stream | None, first: float, model: Model) -> tuple[Array, int]:
    if stream is None:
        return np.empty((0, 3)), 0
    good = np.abs(stream.values[:, 0]) < ABSURD
    t = stream.t[good]
    timeout = model.displacement_timeout
    begins = _begins(t, timeout)
    usable = _usable(t, begins, 0.0, first, timeout, model.skew)
    return (np.column_stack([t, _of_run(usable, begins), stream.values[good, 0]]),
            int((~good).sum()))


def _poses(stream: PoseStream | None, first: float, model: Model) -> tuple[Array, int]:
    """Return rows of stamp, stamp from which on it counts, position, quaternion."""
    if stream is None:
        return np.empty((0, 9)), 0
    q = quaternion_from_matrix(stream.R_base_sensor) if len(stream) else np.empty((0, 4))
    n2 = (q * q).sum(axis=1)
    good = (n2 > 0.25) & (n2 < 4.0)
    t, q, n2 = stream.t[good], q[good], n2[good]
    begins = _begins(t, model.pose_timeout)
    usable = _usable(t, begins, 0.0, first, model.pose_timeout, model.skew)
    due = np.where(begins, t, t + 0.9 * np.diff(t, prepend=t[:1]))
    effective = np.maximum(np.maximum(t, usable), np.concatenate([[-inf], due])[:len(t)])
    return (np.column_stack([t, effective, stream.position[good], q / np.sqrt(n2)[:, np.newaxis]]),
            int((~good).sum()))


@compiled_with_all_it_calls
def _integrate(t: Array, readings: Array, usable: Array, begins: Mask, model: Model,
               samples: Array) -> None:
    before, highpass = NOTHING_BEFORE, (0.0, 0.0, 0.0)
    for i in range(len(t)):
        reading = (readings[i, 0], readings[i, 1], readings[i, 2])
        before, highpass = next_sample(
            before, highpass, t[i], reading, usable[i], begins[i], model)
        (samples[i, 0], samples[i, 1], samples[i, 2], samples[i, 3], samples[i, 4],
         samples[i, 5], samples[i, 6], samples[i, 7], samples[i, 8]) = before


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
