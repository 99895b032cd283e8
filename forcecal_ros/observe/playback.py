"""
The chain over a recording, by the same step as in the node, sample by sample or at once.

Live, a stream that pauses for longer than its time-out counts as missing, and one that begins
again is waited for. A recording holds all that will ever come, so nothing is waited for, and what
a pause is follows from the stream itself: a log at 10 Hz pauses no more than one at 1 kHz. A
recording also shows how noisy its poses are.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from heapq import merge
from math import inf
from operator import itemgetter
from typing import Any, NamedTuple

from forcecal_ros.core.axes import in_axes_of_pose, levelled
from forcecal_ros.core.calibration import Accelerometer, Calibration, Estimate, Noise
from forcecal_ros.core.errors import ConfigError, DataError, UnobservableError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix, rotation_vector
from forcecal_ros.core.noise.white import white_covariance
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.topics import naming, require
from forcecal_ros.observe import step
from forcecal_ros.observe.bandwidth import ROTATION_CORNERS
from forcecal_ros.observe.design import design, Model, with_reach
from forcecal_ros.observe.live import LiveObserver
from forcecal_ros.observe.payload import Change, payload_model, PayloadSettings, ToolEstimate
from forcecal_ros.observe.pose_free import (
    Imu,
    pose_free_model,
    pose_free_step,
    PoseFreeSample,
    PoseFreeState,
)
from forcecal_ros.observe.sample import (
    ContactEstimate,
    ContactSample,
    Progress,
    silent,
    stacked,
)
from forcecal_ros.observe.settings import ObserverSettings, POSE_RATE_HZ
from forcecal_ros.observe.step import Result, State
from forcecal_ros.observe.tracker import Tracker
import numpy as np

Event = tuple[float, str, Any]

GAP_PERIODS = 4.0
"""Gaps are bridged up to this many median periods of their stream: two messages lost in a row,
and stamps that jitter by half a period at either end."""

MAX_STEP = 2.0
"""Periods of the pose above this over the corner of the pose filter leave it deadbeat, at the
mercy of each pose: with the corner of 150 rad/s that quiet sensors allow, below 75 Hz [1]."""

MIN_NOISE_SAMPLES = 100
"""Samples that a covariance is taken from: it is then known to 14 % in each direction."""


def replay(recording: Recording, calibration: Calibration,
           settings: ObserverSettings = ObserverSettings(), imu: Imu | None = None,
           progress: Progress = silent) -> ContactEstimate:
    """
    Estimate the contact wrench over a recording, one row for each of its wrenches.

    All at once (:mod:`forcecal_ros.observe.batch`) where the stamps of each stream increase, else
    sample by sample. Time-outs are those of a file.

    Parameters
    ----------
    imu : Imu or None
        Where given, accelerometer and gyro tell where down is, and the pose is not looked at.
    progress : callable
        Called with the number of samples done since its last call.

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
        raise UnobservableError(f'{name} holds no pose, which filter static requires; '
                                f'{naming(recording, "pose")}')
    # the node, which never replays, need not load the compiler
    from forcecal_ros.observe.batch import estimates, in_order

    model = recorded_model(recording, calibration, settings)
    if not in_order(recording):
        return collected(*run(events(recording), model))
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
    wrench, sensor = recording.wrench, calibration.accelerometer
    require(recording, ['wrench'])
    assert wrench is not None
    if (sensor is not None and recording.accelerometer is not None
            and recording.accelerometer_unit != sensor.unit):
        raise DataError(
            f'the accelerometer is recorded in {recording.accelerometer_unit}, the calibration '
            f'is for {sensor.unit}; calibrate with the same sensor')
    return recording, wrench


def _replay_pose_free(recording: Recording, wrench: Stream, calibration: Calibration,
                      settings: ObserverSettings, imu: Imu, progress: Progress) -> ContactEstimate:
    model = pose_free_model(calibration, settings, imu)
    force, omega = recording.accelerometer, recording.angular_velocity
    accelerometer = calibration.accelerometer
    if accelerometer is None or force is None or omega is None or not len(force) * len(omega):
        raise UnobservableError(
            f'{recording.source or "the recording"} has neither a pose nor accelerometer and '
            'angular velocity (sensor_msgs/Imu) to measure gravity; record one of the two')
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
    contacts, by_imu = map(list, zip(*samples))
    dropped = (0, 0, 0 if recording.pose is None else len(recording.pose), 0)
    return replace(collected(None, contacts), dropped=dropped, by_imu=stacked(by_imu))


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


def run(sequence: Iterable[Event], model: Model) -> tuple[State, list[ContactSample]]:
    """Feed :func:`events` to the step, in any order; return the last state as well."""
    state = State()
    samples: list[ContactSample] = []
    for event in sequence:
        state, out = on_event(state, event, model)
        samples.extend(out)
    state, out = step.finish(state, model)
    return state, [*samples, *out]


def on_event(state: State, event: Event, model: Model) -> Result:
    """Feed one of :func:`events` to the step."""
    t, kind, row = event
    if kind == 'wrench':
        return step.on_wrench(state, t, row, model)
    if kind == 'accelerometer':
        return step.on_accelerometer(state, t, row, model)
    if kind == 'displacement':
        return step.on_displacement(state, t, row[0], model)
    return step.on_pose(state, t, row[:3], row[3:], model)


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


def gap_limit(stream: Stream | PoseStream | None, least: float) -> float:
    """Return the longest gap of a stream that is bridged, no shorter than ``least`` [s]."""
    if stream is None or len(stream) < 3:
        return least
    with np.errstate(invalid='ignore'):
        period = float(np.median(np.diff(stream.t)))
    return max(least, GAP_PERIODS * period) if period < np.inf else least


def never_late(model: Model, recording: Recording) -> Model:
    """Return the model with the time-outs of a recording, which are no shorter than live ones."""
    return with_reach(model._replace(
        pause=gap_limit(recording.wrench, model.pause),
        timeout=gap_limit(recording.accelerometer, model.timeout),
        displacement_timeout=gap_limit(recording.optidrive, model.displacement_timeout),
        pose_timeout=gap_limit(recording.pose, model.pose_timeout),
        keep=gap_limit(recording.wrench, model.keep), skew=0.0))


def recorded_model(recording: Recording, calibration: Calibration, settings: ObserverSettings
                   ) -> Model:
    """Design the model of a recording, by the noise of its poses and with its time-outs."""
    if recording.pose and not recording.pose.has_position and settings.offset == 'auto':
        settings = replace(settings, position=False)
    model = design(calibration, with_pose_noise(settings, recording.pose),
                   recording.accelerometer is not None)
    return never_late(model, recording)


def with_pose_noise(settings: ObserverSettings, pose: PoseStream | None) -> ObserverSettings:
    """
    Return the settings with the noise that poses show, where it is more than they expect.

    Each pose is compared with a cubic through its four neighbours, at their own stamps. A motion
    adds to the difference, so the quieter blocks of the recording count. Slow poses do not
    separate noise from motion: the settings stay.
    """
    if pose is None or len(pose) < MIN_NOISE_SAMPLES:
        return settings
    period = float(np.median(np.diff(pose.t)))
    if not 0 < period * ROTATION_CORNERS[1] <= MAX_STEP:
        return settings
    around, R, n = (-2, -1, 1, 2), pose.R_base_sensor, len(pose)
    t = np.stack([pose.t[2 + k:n - 2 + k] - pose.t[2:-2] for k in around])
    with np.errstate(divide='ignore', invalid='ignore'):
        weights = np.stack([np.prod([t[j] / (t[j] - t[i]) for j in range(4) if j != i], axis=0)
                            for i in range(4)])
    position, rotation = np.zeros((2, n - 4, 3))
    for k, w in zip(around, weights[:, :, np.newaxis]):
        position += w * (pose.position[2 + k:n - 2 + k] - pose.position[2:-2])
        rotation += w * rotation_vector(np.swapaxes(R[2:-2], 1, 2) @ R[2 + k:n - 2 + k])
    # the settings state a deviation at their own rate: the same density
    scale = period * POSE_RATE_HZ / 3 / (1 + (weights ** 2).sum(axis=0))
    found = [_quiet(scale * (one * one).sum(axis=1)) for one in (position, rotation)]
    return replace(settings,
                   pose_position_std=max(settings.pose_position_std, found[0]),
                   pose_rotation_std=max(settings.pose_rotation_std, found[1]))


def _quiet(squares: Array) -> float:
    """Return the deviation of the blocks that are quieter than three quarters; 0 where unknown."""
    # poses of a block that noise is measured in: known to 12 % there
    poses_per_block = 50
    squares = squares[np.isfinite(squares)]
    whole = len(squares) // poses_per_block * poses_per_block
    blocks = squares[:whole].reshape(-1, poses_per_block)
    return float(np.sqrt(np.quantile(blocks.mean(axis=1), 0.25))) if len(blocks) else 0.0


def is_slow(pose: PoseStream, model: Model) -> bool:
    """Whether poses come too slowly for the filter that follows them."""
    return gap_limit(pose, 0.0) * model.rotation_poles.real > GAP_PERIODS * MAX_STEP


def interpolated(pose: PoseStream, gap: float) -> PoseStream:
    """
    Put poses between those of a slow stream, by a spline that keeps its accelerations smooth.

    A filter that follows poses as they come lags behind slow ones by a period or more. Gaps
    longer than ``gap`` [s] stay gaps.
    """
    runs = [_between(run) for run in _runs(pose, gap)]
    return PoseStream(np.concatenate([run.t for run in runs]),
                      np.concatenate([run.position for run in runs]),
                      np.concatenate([run.R_base_sensor for run in runs]), pose.frame)


def _runs(pose: PoseStream, gap: float) -> Iterator[PoseStream]:
    """Cut a stream at its gaps, and where its positions begin or cease to be known."""
    known = np.isfinite(pose.position).all(axis=1)
    cuts = np.flatnonzero((np.diff(pose.t) > gap) | (np.diff(known.astype(int)) != 0)) + 1
    for i, j in zip([0, *cuts.tolist()], [*cuts.tolist(), len(pose)]):
        yield pose.rows(slice(i, j))


def _between(run: PoseStream) -> PoseStream:
    # a spline needs as many; shorter runs are left as they are
    if len(run) < 4:
        return run
    parts = np.ceil(np.diff(run.t) * POSE_RATE_HZ - 1e-6).astype(int)
    return run.at(np.append(np.concatenate([
        start + (end - start) * np.arange(n) / n
        for start, end, n in zip(run.t[:-1], run.t[1:], parts)]), run.t[-1]))


def within_gaps(stream: Stream, t: Array) -> Array:
    """
    Interpolate a stream at times (n,) [s]; NaN in its gaps, and that far beyond its ends.

    Up to the longest gap that is bridged the last value is held beyond an end.
    """
    values, i = stream.at(t), np.searchsorted(stream.t, t)
    before, after = (stream.t[j.clip(0, len(stream) - 1)] for j in (i - 1, i))
    gap = np.where(before < after, after - before, np.abs(t - after))
    values[(gap > gap_limit(stream, 0.0)) & (t != after)] = np.nan
    return values


def white_noise(stream: Stream) -> Array:
    """
    Covariance (k, k) of the white part of a signal (n, k), motion or not.

    Raises
    ------
    DataError
        Fewer than 100 samples.
    """
    if len(stream) < MIN_NOISE_SAMPLES:
        raise DataError(f'{len(stream)} samples are too few to estimate the noise; record '
                        f'{MIN_NOISE_SAMPLES} or more')
    return white_covariance(stream.values)


def with_noise(calibration: Calibration, recording: Recording) -> Calibration:
    """
    Return the calibration with the noise of wrench and accelerometer as this recording shows it.

    Q and R of [Gamez2005] stay unknown.

    Raises
    ------
    DataError
        The recording holds no wrench, or is too short.
    """
    wrench, force, sensor = recording.wrench, recording.accelerometer, calibration.accelerometer
    require(recording, ['wrench'])
    assert wrench is not None
    specific_force = None
    if force is not None and sensor is not None:
        inverse = np.linalg.inv(sensor.matrix)
        specific_force = Estimate(inverse @ white_noise(force) @ inverse.T, np.nan, '(m/s^2)^2')
    unknown = np.full((3, 3), np.nan)
    return replace(calibration, noise=Noise(
        Q=Estimate(unknown[:2, :2], np.nan, '(m, m/s)^2 s'),
        R=Estimate(unknown, np.nan, '(m, m/s, m/s^2)^2 s'),
        wrench=Estimate(white_noise(wrench), np.nan, '(N, N m)^2'),
        specific_force=specific_force, wrench_rate=wrench.rate,
        accelerometer_rate=force.rate if force is not None else float('nan')))


class Followed(NamedTuple):
    """
    What hung on the sensor over a recording.

    Attributes
    ----------
    contact : ContactEstimate
        Of the tool as it was known by then.
    tools : tuple of ToolEstimate
        One for every block of some 50 ms.
    announced : tuple of ToolEstimate
        Those that the contact wrench was taken from then on, the calibration's first.
    changes : tuple of Change
    """

    contact: ContactEstimate
    tools: tuple[ToolEstimate, ...]
    announced: tuple[ToolEstimate, ...]
    changes: tuple[Change, ...]


def follow(recording: Recording, calibration: Calibration,
           settings: ObserverSettings = ObserverSettings(),
           payload: PayloadSettings = PayloadSettings(),
           ) -> Followed:
    """
    Estimate the contact wrench over a recording, and what hangs on the sensor along.

    As the node does with ``payload.track`` and ``tool: tracked``. Raises as
    :func:`~forcecal_ros.observe.playback.replay`.

    Raises
    ------
    UnobservableError
        There is no pose.
    """
    # over which another tool is faded in, as ``takeover.duration`` of the node [s]
    fade = 0.5
    recording, _ = as_calibrated(recording, calibration)
    if not recording.pose:
        raise UnobservableError(f'{recording.source or "the recording"} holds no pose to separate '
                                f'a payload from a push; {naming(recording, "pose")}')
    live = LiveObserver(fade, fade)
    live.take_over(recorded_model(recording, calibration, settings))
    tracker = live.tracker = Tracker(payload_model(calibration, payload))
    live.takes_tracked = True
    takes = {'wrench': live.on_wrench, 'accelerometer': live.on_accelerometer,
             'pose': live.on_pose, 'displacement': live.on_displacement}
    samples: list[ContactSample] = []
    tools: list[ToolEstimate] = []
    announced = [tracker.announced._replace(t=float(recording.pose.t[0]))]
    for t, kind, values in events(recording):
        samples.extend(takes[kind](t, values))
        if tracker.latest.t > (tools[-1].t if tools else -inf):
            tools.append(tracker.latest)
        if tracker.announced.t > announced[-1].t:
            announced.append(tracker.announced)
    samples.extend(live.finish())
    return Followed(collected(live.state, samples), tuple(tools), tuple(announced),
                    tracker.changes)
