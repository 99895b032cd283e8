"""The chain over a recording, by the same step as in the node, sample by sample or at once."""

from collections.abc import Iterator
from dataclasses import replace
from heapq import merge
from operator import itemgetter
from typing import Any

from forcecal_ros.core.axes import in_axes_of_pose, levelled
from forcecal_ros.core.calibration import Accelerometer, Calibration
from forcecal_ros.core.errors import ConfigError, DataError, UnobservableError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.core.topics import naming, require
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.from_file import interpolated, is_slow, never_late, within_gaps
from forcecal_ros.observe.pose_free.model import Imu, pose_free_model
from forcecal_ros.observe.pose_free.step import pose_free_step, PoseFreeSample, PoseFreeState
from forcecal_ros.observe.sample import (
    ByImu,
    ContactEstimate,
    ContactSample,
    Progress,
    silent,
    stacked,
)
from forcecal_ros.observe.settings import ObserverSettings
from forcecal_ros.observe.step import (
    finish,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    Result,
    State,
)
import numpy as np

Event = tuple[float, str, Any]


def replay(recording: Recording, calibration: Calibration,
           settings: ObserverSettings = ObserverSettings(), imu: Imu | None = None,
           progress: Progress = silent) -> ContactEstimate:
    """
    Estimate the contact wrench over a recording, one row for each of its wrenches.

    All at once (:mod:`forcecal_ros.observe.batch`) where the stamps of each stream increase, else
    sample by sample. Time-outs are those of a file, see :mod:`forcecal_ros.observe.from_file`.

    Parameters
    ----------
    imu : Imu or None
        Where given, accelerometer and gyro tell where down is, and the pose is not looked at.
    progress : callable
        Told how many samples were done since it was told last.

    Raises
    ------
    DataError
        The recording holds no wrench, or its accelerometer speaks another unit than the
        calibration's.
    UnobservableError
        Neither a pose nor accelerometer and gyro tell where down is.
    ConfigError
        The calibration does not hold what the settings need.
    """
    recording, wrench = as_calibrated(recording, calibration)
    name = recording.source or 'the recording'
    if imu is not None:
        return _replay_pose_free(recording, wrench, calibration, settings, imu, progress)
    if settings.filter == 'static' and not recording.pose:
        raise UnobservableError(f'{name} holds no pose, which filter static takes the weight '
                                f'from; {naming(recording, "pose")}')
    # the node, which never replays, need not load the compiler
    from forcecal_ros.observe.batch import estimates, in_order

    model = never_late(design(calibration, settings), recording)
    if not in_order(recording):
        return collected(*run(recording, model))
    if recording.pose is not None and is_slow(recording.pose, model):
        recording = replace(recording, pose=interpolated(recording.pose, model.pose_timeout))
    return estimates(recording, model, progress)


def as_calibrated(recording: Recording, calibration: Calibration) -> tuple[Recording, Stream]:
    """
    Return the recording in the calibration's axes, and its wrench.

    Raises
    ------
    DataError
        See :func:`replay`.
    """
    recording = in_axes_of_pose(levelled(recording, calibration.gravity_direction),
                                calibration.sensor_rotation)
    wrench, wanted = recording.wrench, calibration.accelerometer
    require(recording, ['wrench'])
    assert wrench is not None
    if (wanted is not None and recording.accelerometer is not None
            and recording.accelerometer_unit != wanted.unit):
        raise DataError(
            f'the accelerometer is recorded in {recording.accelerometer_unit}, the calibration '
            f'is for {wanted.unit}; calibrate with the same sensor')
    return recording, wrench


def _replay_pose_free(recording: Recording, wrench: Stream, calibration: Calibration,
                      settings: ObserverSettings, imu: Imu, progress: Progress) -> ContactEstimate:
    model = pose_free_model(calibration, settings, imu)
    force, omega = recording.accelerometer, recording.angular_velocity
    accelerometer = calibration.accelerometer
    if accelerometer is None or force is None or omega is None or not len(force) * len(omega):
        raise UnobservableError(
            f'{recording.source or "the recording"} tells gravity neither by a pose nor by '
            'accelerometer and angular velocity (sensor_msgs/Imu); record one of the two')
    delay = float(accelerometer.delay)
    f = (within_gaps(force, wrench.t + delay) - accelerometer.offset.value) @ np.linalg.inv(
        accelerometer.matrix).T
    turning = within_gaps(omega, wrench.t + delay) @ axes_of(accelerometer)
    state = PoseFreeState()
    samples: list[PoseFreeSample] = []
    for t, y, specific_force, rate in zip(wrench.t.tolist(), wrench.values, f, turning):
        state, sample = pose_free_step(state, t, y, specific_force, rate, model)
        samples.append(sample)
        progress(1)
    by_imu = ByImu(*(np.array([getattr(sample, field) for sample in samples])
                     for field in ByImu._fields))
    dropped = (0, 0, 0 if recording.pose is None else len(recording.pose), 0)
    return replace(collected(None, [sample.contact for sample in samples]),
                   dropped=dropped, by_imu=by_imu)


def axes_of(accelerometer: Accelerometer) -> Array:
    """
    Return the rotation closest to the accelerometer's map, (3, 3), from ft_sensor to the IMU.

    Raises
    ------
    ConfigError
        The map is left-handed, as no gyro's axes are.
    """
    u, _, v = np.linalg.svd(accelerometer.map.value)
    if np.linalg.det(u @ v) < 0:
        raise ConfigError('the accelerometer map is left-handed, so the axes of its gyro are not '
                          'known; use an IMU whose axes are right-handed (REP-145)')
    return np.asarray(u @ v)


def run(recording: Recording, model: Model) -> tuple[State, list[ContactSample]]:
    """Feed a recording to the step, in the order of its stamps; return the last state as well."""
    state = State()
    samples: list[ContactSample] = []
    for state, out in answers(recording, model):
        samples.extend(out)
    return state, samples


def answers(recording: Recording, model: Model) -> Iterator[Result]:
    """Feed a recording to the step and return what it says to every event, and at the end."""
    state = State()
    for event in events(recording):
        state, out = on_event(state, event, model)
        yield state, out
    yield finish(state, model)


def on_event(state: State, event: Event, model: Model) -> Result:
    """Feed one of :func:`events` to the step."""
    t, kind, row = event
    if kind == 'wrench':
        return on_wrench(state, t, row, model)
    if kind == 'accelerometer':
        return on_accelerometer(state, t, row, model)
    if kind == 'displacement':
        return on_displacement(state, t, row[0], model)
    return on_pose(state, t, row[:3], row[3:], model)


def events(recording: Recording) -> Iterator[Event]:
    """
    Return what a recording holds for the chain, in the order of its stamps.

    Each is ``(stamp, kind, values)``; kinds are ``pose`` (position, quaternion xyzw),
    ``displacement``, ``accelerometer`` and ``wrench``.
    """
    streams = [(kind, stream.t, stream.values) for kind, stream in (
        ('displacement', recording.optidrive), ('accelerometer', recording.accelerometer),
        ('wrench', recording.wrench)) if stream is not None]
    if recording.pose is not None:
        pose = recording.pose
        streams.insert(0, ('pose', pose.t, np.hstack(
            [pose.position, quaternion_from_matrix(pose.R_base_sensor)])))
    return merge(*(
        [(t, kind, tuple(row)) for t, row in zip(times.tolist(), values.tolist())]
        for kind, times, values in streams), key=itemgetter(0))


def collected(state: State | None, samples: list[ContactSample]) -> ContactEstimate:
    """Put samples together, ``state`` the chain's last one."""
    *columns, learned = zip(*samples)
    t, contact, status, measured, innovation, inertial = (np.array(column) for column in columns)
    return ContactEstimate(
        t, contact, measured, innovation, inertial, status,
        state.refusals.counts if state is not None else (0,) * 4,
        None if learned[0] is None else stacked(list(learned)))
