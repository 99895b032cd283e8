"""
What only a file tells: time-outs from its own streams, poses between its poses, noise.

Live, a stream that pauses for longer than its time-out counts as missing, and one that begins
again is waited for. A recording holds all that will ever come, so nothing is waited for, and what
a pause is follows from the stream itself: a log at 10 Hz pauses no more than one at 1 kHz.
"""

from collections.abc import Iterator
from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate, Noise
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.white import white_covariance
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.core.topics import require
from forcecal_ros.observe.design import Model, with_reach
import numpy as np

GAP_PERIODS = 4.0
"""Gaps are bridged up to this many median periods of their stream: two messages lost in a row,
and stamps that jitter by half a period at either end."""

LONGEST_STEP = 2.0
"""Periods of the pose above this over the corner of the pose filter leave it deadbeat, at the
mercy of each pose: with the corner of 150 rad/s that quiet sensors allow, below 75 Hz [1]."""

POSE_STEP = 1 / 250
"""Slow poses are interpolated to this period at most, the one that the pose filters are designed
for [s]."""

FEWEST_POSES = 4
"""A spline wants as many; shorter runs are left as they are."""


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


def is_slow(pose: PoseStream, model: Model) -> bool:
    """Whether poses come too slowly for the filter that follows them."""
    return gap_limit(pose, 0.0) * model.rotation_poles.real > GAP_PERIODS * LONGEST_STEP


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
        yield PoseStream(pose.t[i:j], pose.position[i:j], pose.R_base_sensor[i:j], pose.frame)


def _between(run: PoseStream) -> PoseStream:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation, RotationSpline

    if len(run) < FEWEST_POSES:
        return run
    parts = np.ceil(np.diff(run.t) / POSE_STEP - 1e-6).astype(int)
    t = np.append(np.concatenate([
        start + (end - start) * np.arange(n) / n
        for start, end, n in zip(run.t[:-1], run.t[1:], parts)]), run.t[-1])
    position = np.full((len(t), 3), np.nan)
    if np.isfinite(run.position).all():
        position = CubicSpline(run.t, run.position)(t)
    spline = RotationSpline(run.t, Rotation.from_matrix(run.R_base_sensor))
    return PoseStream(t, position, spline(t).as_matrix(), run.frame)


def within_gaps(stream: Stream, t: Array) -> Array:
    """
    Interpolate a stream at times (n,) [s]; NaN in its gaps, and that far beyond its ends.

    Up to the longest gap that is bridged the last value is held beyond an end.
    """
    limit = gap_limit(stream, 0.0)
    values = stream.at(t)
    after = np.searchsorted(stream.t, t)
    before = np.clip(after - 1, 0, None)
    i, j = before, np.clip(after, None, len(stream) - 1)
    inside = (after > 0) & (after < len(stream))
    far = np.where(inside, stream.t[j] - stream.t[i] > limit,
                   np.maximum(stream.t[0] - t, t - stream.t[-1]) > limit)
    on_sample = np.isin(t, stream.t)
    values[far & ~on_sample] = np.nan
    return values


FEWEST = 100
"""Samples that a covariance is taken from: it is then known to 14 % in each direction."""


def white_noise(stream: Stream) -> Array:
    """
    Covariance (k, k) of the white part of a signal (n, k), motion or not.

    Raises
    ------
    DataError
        Fewer than 100 samples.
    """
    if len(stream) < FEWEST:
        raise DataError(f'{len(stream)} samples do not tell the noise; record {FEWEST} or more')
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
