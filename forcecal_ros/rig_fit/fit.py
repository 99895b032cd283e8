"""From recordings of a robot to a rig of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.axes import DOWN
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_of
from forcecal_ros.core.streams import Recording
from forcecal_ros.core.topics import naming
from forcecal_ros.diagnose.recordings import even_stamps
from forcecal_ros.effects.rig import Axis, Rig, Unexplained
from forcecal_ros.rig_fit.robot import (
    at_ends,
    AxisFit,
    fit_and_judge,
    fit_rotation,
    fit_translation,
    Followed,
    RotationFit,
    turned_apart,
)
from forcecal_ros.rig_fit.tool import (
    command_period,
    fit_tool,
    noise_of,
    orientation_noise,
    rate_beside,
)
import numpy as np
from scipy.signal import welch


@dataclass(frozen=True)
class RigFit:
    """
    A rig of a user's robot.

    Attributes
    ----------
    axes : tuple of AxisFit
    rotation : RotationFit
    noise : tuple of float
        Of one pose, per axis [m], [rad].
    good_up_to : float
        Frequency from which the model leaves more than a tenth of the motion [Hz].
    moved_up_to : float
        Up to which the robot moved [Hz].
    """

    rig: Rig
    axes: tuple[AxisFit, ...]
    rotation: RotationFit
    noise: tuple[float, float]
    good_up_to: float
    moved_up_to: float
    notes: tuple[str, ...]

    @property
    def poor(self) -> bool:
        """Whether the model of the robot leaves more than the noise of the poses."""
        left = self.rig.robot.unexplained
        return left is not None and left.beyond(self.rig.pose_sensor)


def fit_rig(recordings: Sequence[Recording], heldout: Recording | None, base: Rig,
            settings: IdentificationSettings = IdentificationSettings()) -> RigFit:
    """
    Fit a rig to recordings of a robot.

    Parameters
    ----------
    recordings : sequence of Recording
        With commands, measured poses and wrench.
    heldout : Recording or None
        To choose the order by and to judge on; every third second where none is given.
    base : Rig
        Gives what recordings do not tell: tolerances, the accelerometer where none was recorded.
    settings : IdentificationSettings
        Of the calibration.

    Raises
    ------
    DataError
        A stream is missing, or the recordings cannot answer.
    """
    given = [_required(one) for one in recordings]
    judge = None if heldout is None else _required(heldout)
    first = given[0]
    assert first.target is not None
    periods = [command_period(one.target.t) for one in [*given, *filter(None, [judge])]
               if one.target is not None]
    if max(periods) > 1.001 * min(periods):
        raise DataError('target_frame: the commands of the recordings come every '
                        f'{", ".join(f"{1e3 * p:.3g}" for p in periods)} ms, expected one period; '
                        'fit recordings of one rate')
    rig = _measured(base, first, periods[0], settings)
    ready = fit_and_judge(given, judge, periods[0])
    axes = fit_translation(rig, ready)
    x, y, z = (axis.model for axis in axes)
    rig = replace(rig, robot=replace(rig.robot, x=x, y=y, z=z))
    rotation = fit_rotation(rig, ready, float(np.mean([axis.lag for axis in axes])))
    rig = replace(rig, servo=rotation.servo)
    left, good, moved = _heldout_error(rig, ready)
    rig = replace(rig, robot=replace(rig.robot, unexplained=left))
    found = fit_tool(rig, given, settings)
    notes = [f'axis {name} never moved, and follows like the one that moved most'
             for name, axis in zip('xyz', axes) if not axis.order]
    if not rotation.identified:
        notes.append('orientation never turned, and follows as late as the position')
    sensor = found.rig.pose_sensor
    return RigFit(found.rig, tuple(axes), rotation,
                  (sensor.position_noise, sensor.orientation_noise), good, moved,
                  (*notes, *found.notes))


def _required(recording: Recording) -> Recording:
    """Return a recording with even stamps, and refuse one that lacks something."""
    for role, topic in (('target', 'target_frame'), ('pose', 'current_pose'),
                        ('wrench', 'wrench')):
        stream = getattr(recording, role)
        if stream is None or not len(stream):
            raise DataError(f'{recording.source}: {role} is missing, expected a topic {topic}; '
                            f'{naming(recording, role)}')
        if role != 'wrench' and not stream.has_position:
            raise DataError(f'{recording.source}: {role} has no position; record poses of '
                            'ft_sensor in the base')
    return even_stamps(recording).recording


def _measured(base: Rig, recording: Recording, period: float, settings: IdentificationSettings
              ) -> Rig:
    """Give a rig the rates, the noise, the place and the gravity of a recording."""
    wrench, pose, volts = recording.wrench, recording.pose, recording.accelerometer
    target = recording.target
    assert wrench is not None
    assert pose is not None
    assert target is not None
    force, torque = noise_of(wrench.values[:, :3]), noise_of(wrench.values[:, 3:])
    sensor = replace(base.wrench_sensor, rate=rate_beside(wrench.t, period), force_noise=force,
                     torque_noise=torque, gain=(1.0,) * 6)
    poses = replace(base.pose_sensor, rate=rate_beside(pose.t, period),
                    position_noise=noise_of(pose.position),
                    orientation_noise=orientation_noise(pose))
    accelerometer = replace(base.accelerometer, rate=_multiple(base.accelerometer.rate, period))
    if volts is not None and len(volts) > 1:
        accelerometer = replace(accelerometer, rate=rate_beside(volts.t, period),
                                noise=noise_of(volts.values))
    down = np.array(DOWN if settings.gravity_direction is None else settings.gravity_direction)
    gravity = settings.gravity * down / np.linalg.norm(down)
    own = Axis(0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    robot = replace(base.robot, period=period, x=own, y=own, z=own)
    home = replace(base.home, position=tuple(target.position[0].tolist()),
                   orientation_xyzw=quaternion_of(target.R_base_sensor[0]))
    # servo: bandwidth of the position's servo times the period: that of the nominal rig
    # away: where the wall is put, beyond home [m]: a recording in free space does not tell it
    return replace(
        base, robot=robot, servo=replace(base.servo, position_bandwidth=1.2 / period),
        wrench_sensor=sensor, pose_sensor=poses, accelerometer=accelerometer, optidrive=None,
        gravity=tuple(gravity.tolist()), home=home, effects=(),
        wall=replace(base.wall, position=float(target.position[:, 0].max()) + 10.0))


def _multiple(rate: float, period: float) -> float:
    return max(1, round(rate * period)) / period


def _heldout_error(rig: Rig, ready: Sequence[Followed]) -> tuple[Unexplained, float, float]:
    """Return what the robot's model leaves on what was held out, and up to where it is good."""
    apart, turned, moved = [], [], []
    for one in ready:
        if not one.held.any():
            continue
        made = at_ends(rig, one).position
        apart.append((one.reached - made)[one.held])
        turned.append(turned_apart(rig, one)[one.held])
        moved.append(_centred(one.reached[one.held]))
    position, orientation = (np.concatenate(rows) for rows in (apart, turned))
    good, up_to = _good_up_to(_centred(position), np.concatenate(moved), rig.robot.period)
    return Unexplained(
        _beyond_noise(_centred(position)), _beyond_noise(_centred(orientation)),
        *(float(np.linalg.norm(rows.mean(axis=0))) for rows in (position, orientation))
    ), good, up_to


def _beyond_noise(rows: Array) -> float:
    """Return the RMS of vectors, what is white among it removed."""
    noise = noise_of(rows)
    return float(np.sqrt(max(0.0, float(np.mean(np.sum(rows ** 2, axis=1))) - 3.0 * noise ** 2)))


def _good_up_to(left: Array, moved: Array, period: float) -> tuple[float, float]:
    size = min(len(left), round(4.0 / period))
    f, of_left = welch(left, 1.0 / period, nperseg=size, axis=0)
    _, of_motion = welch(moved, 1.0 / period, nperseg=size, axis=0)
    rest, motion = of_left.sum(axis=1), of_motion.sum(axis=1)
    # strong: power of the motion over that of the noise, from which a frequency counts as moved
    strong = motion > 100.0 * np.median(motion[len(f) // 2:])
    weak = np.flatnonzero(~strong[1:])
    last = int(weak[0]) if len(weak) else len(f) - 1
    # small: part of the motion that the model may leave at a frequency, in amplitude
    bad = np.flatnonzero(rest[1:last + 1] > 0.1 ** 2 * motion[1:last + 1])
    return (float(f[1 + bad[0]]) if len(bad) else np.inf), float(f[max(1, last)])


def _centred(rows: Array) -> Array:
    return np.asarray(rows - rows.mean(axis=0))


def document(fit: RigFit, path: str) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    left = fit.rig.robot.unexplained
    assert left is not None
    return {
        'rig': path, 'period': fit.rig.robot.period,
        'axes': {name: {'order': a.order, 'lag': a.lag, 'lag_std': a.lag_std}
                 for name, a in zip('xyz', fit.axes)},
        'orientation': {'identified': fit.rotation.identified, 'lag': fit.rotation.lag},
        'unexplained': {'position': left.position, 'orientation': left.orientation,
                        'position_offset': left.position_offset,
                        'orientation_offset': left.orientation_offset,
                        'from_hz': fit.good_up_to if np.isfinite(fit.good_up_to) else None},
        'poor': fit.poor, 'notes': list(fit.notes)}
