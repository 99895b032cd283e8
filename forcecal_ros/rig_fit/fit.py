"""From recordings of a robot to a rig of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.axes import DOWN
from forcecal_ros.core.calibration import Accelerometer as CalibratedAccelerometer
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import above, DataError, UnobservableError
from forcecal_ros.core.geometry import Array, quaternion_of, rotation_vector
from forcecal_ros.core.noise.white import difference_gain
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.core.topics import require
from forcecal_ros.diagnose.recordings import even_stamps
from forcecal_ros.effects.nuisances import possible, rows_of
from forcecal_ros.effects.rig import (
    Accelerometer,
    AccelerometerModel,
    Axis,
    Optidrive,
    Rig,
    Unexplained,
)
from forcecal_ros.rig_fit.robot import (
    at_ends,
    AxisFit,
    centred,
    fit_and_judge,
    fit_rotation,
    fit_translation,
    Followed,
    RotationFit,
    turned_apart,
)
from forcecal_ros.sim.rigid_tool import GYRATION, known_std, tool_uncertainty, widened
import numpy as np
from scipy.signal import welch


def fit_tool(rig: Rig, recordings: Sequence[Recording], settings: IdentificationSettings
             ) -> tuple[Rig, list[str]]:
    """
    Give a rig the tool and the sensors of a robot.

    The first recording that can be calibrated gives them.

    Returns
    -------
    rig : Rig
    notes : list of str
        What was assumed.

    Raises
    ------
    DataError, UnobservableError
        No recording can be calibrated, or the accelerometer is rotated against the sensor.
    """
    refused: DataError | UnobservableError | None = None
    for one in recordings:
        try:
            return _calibrated(rig, one, identify(one, settings))
        except (DataError, UnobservableError) as error:
            refused = refused or error
    assert refused is not None
    raise refused


def _calibrated(rig: Rig, recording: Recording, c: Calibration) -> tuple[Rig, list[str]]:
    # relative tolerance of an inertia that is not identifiable
    unknown_inertia = 1.0
    mass, notes = float(c.mass), []
    inertia, relative = mass * GYRATION ** 2 * np.eye(3), unknown_inertia
    if c.inertia is None:
        notes.append('the inertia of the tool is not identifiable; that of a gripper of '
                     f'{mass:.3g} kg is used')
    else:
        inertia = possible(c.inertia.value)
        known = np.diag(known_std(c.inertia)) / np.maximum(np.diag(inertia), 1e-9)
        relative = min(unknown_inertia, float(known.max()))
    com = tuple(c.com.value.tolist())
    rig = replace(
        rig, tool=replace(rig.tool, mass=mass, com=com, inertia=rows_of(inertia), tip=com),
        wrench_sensor=replace(rig.wrench_sensor, bias=tuple(c.wrench_bias.value.tolist())),
        optidrive=_slide(rig, recording, c),
        spreads=widened(rig.spreads, **tool_uncertainty(c), inertia=relative))
    if c.tool is not None and rig.optidrive is None:
        notes.append('the tool is compliant, but its displacement was not recorded; it is '
                     'modelled as rigid')
    if c.accelerometer is None:
        return rig, [*notes, 'no accelerometer was recorded; the rig keeps the nominal one']
    if c.accelerometer.position is None:
        notes.append('the position of the accelerometer is not identifiable; the centre of mass '
                     'is used')
    return _with_accelerometer(rig, c.accelerometer), notes


def _slide(rig: Rig, recording: Recording, c: Calibration) -> Optidrive | None:
    stream, tool = recording.optidrive, c.tool
    if tool is None or stream is None or len(stream) < 2:
        return None
    return Optidrive(float(tool.stiffness), max(0.0, float(tool.damping)),
                     rate_beside(stream.t, rig.robot.period), noise_of(stream.values))


def _with_accelerometer(rig: Rig, a: CalibratedAccelerometer) -> Rig:
    """Mount it; one in m/s^2 keeps a gain of 1, and what it is off counts as tolerance."""
    # of an accelerometer against ft_sensor [rad]: that reads 2 % of gravity on another axis
    most_turned = 0.02
    turned = float(np.linalg.norm(rotation_vector(a.map.value)))
    if turned > most_turned:
        raise DataError(
            'accelerometer: its axes are rotated by '
            f'{above(np.degrees(turned), np.degrees(most_turned))} deg relative to ft_sensor, '
            f'expected at most {np.degrees(most_turned):.3g} deg, as in a rig they are parallel; '
            'record it in ft_sensor')
    position = rig.tool.com if a.position is None else tuple(a.position.value.tolist())
    gain, offset = a.gain.value, a.offset.value
    of_gain = float(np.max(known_std(a.gain) / np.abs(gain)))
    if a.unit != 'V':
        of_gain = float(np.hypot(of_gain, np.abs(gain - 1.0).max()))
        gain = np.ones(3)
    model = AccelerometerModel(tuple(gain.tolist()), tuple(offset.tolist()),
                               0.0 if a.cutoff is None else float(a.cutoff))
    mounted: Accelerometer = replace(rig.accelerometer, mounted='acc1', acc1=model,
                                     position=position)
    spreads = widened(rig.spreads, accelerometer_gain=of_gain,
                      accelerometer_offset=known_std(a.offset).max())
    return replace(rig, accelerometer=mounted, spreads=spreads)


FEWEST = 50
"""Samples from which rate and noise are estimated."""


def period_of(t: Array) -> float:
    """Return the mean interval between samples, those that got lost counted [s]."""
    steps = np.diff(t)
    middle = float(np.median(steps))
    return float((t[-1] - t[0]) / np.maximum(1.0, np.round(steps / middle)).sum())


def command_period(t: Array) -> float:
    """
    Return the period of commands, rounded to a whole rate, or to 0.1 ms [s].

    Raises
    ------
    DataError
        They come irregularly, or too few.
    """
    # periods that are no whole number of hertz are taken in these steps [s]
    tenth = 1e-4
    if len(t) < FEWEST:
        raise DataError(f'target_frame: {len(t)} commands are too few to identify the response of '
                        'the robot; record them for 10 s or more of motion')
    period = period_of(t)
    steps = np.diff(t) / period
    off = float(np.mean(np.abs(steps - np.maximum(1.0, np.round(steps))) > 0.5 - 1e-9)
                + np.mean(steps > 1.5))
    # share of intervals between commands that may be off by half a period: some get lost
    if off > 0.1:
        raise DataError(f'target_frame: {100.0 * off:.0f} % of the commands are irregular, '
                        f'expected one every {1e3 * period:.3g} ms; stream them at a fixed rate')
    rate = round(1.0 / period)
    # round: of a rate: as far from a whole number of hertz as computers' clocks are apart at most
    if rate and abs(rate * period - 1.0) < 1e-3:
        return 1.0 / rate
    return round(period / tenth) * tenth


def rate_beside(t: Array, period: float) -> float:
    """Return a stream's rate as a rig may have it: a whole multiple of the commands' [Hz]."""
    return max(1, round(period / period_of(t))) / period


def noise_of(values: Array) -> float:
    """Return the noise of one sample, white, by fourth differences of all columns together."""
    rows = np.reshape(values, (len(values), -1))
    if len(rows) < FEWEST:
        return 0.0
    # of a motion within 10 Hz at 250 Hz fourth differences leave less than a hundredth
    apart = np.median(np.abs(np.diff(rows, 4, axis=0)), axis=0)
    return float(np.sqrt(np.mean(apart ** 2) / difference_gain(4))) / 0.6745


def orientation_noise(pose: PoseStream) -> float:
    """Return the noise of an orientation, per axis [rad]."""
    turns = rotation_vector(np.swapaxes(pose.R_base_sensor[:-1], 1, 2) @ pose.R_base_sensor[1:])
    return noise_of(np.cumsum(turns, axis=0))


@dataclass(frozen=True)
class RigFit:
    """
    A rig of a user's robot.

    Attributes
    ----------
    axes : tuple of AxisFit
    rotation : RotationFit
    good_up_to : float
        Frequency from which the model leaves more than a tenth of the motion [Hz].
    moved_up_to : float
        Up to which the robot moved [Hz].
    """

    rig: Rig
    axes: tuple[AxisFit, ...]
    rotation: RotationFit
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
        raise DataError('target_frame: the recordings have command periods of '
                        f'{", ".join(f"{1e3 * p:.3g}" for p in periods)} ms, expected one; fit '
                        'recordings of the same rate')
    rig = _measured(base, first, periods[0], settings)
    ready = fit_and_judge(given, judge, periods[0])
    axes = fit_translation(rig, ready)
    x, y, z = (axis.model for axis in axes)
    rig = replace(rig, robot=replace(rig.robot, x=x, y=y, z=z))
    rotation = fit_rotation(rig, ready, float(np.mean([axis.lag for axis in axes])))
    rig = replace(rig, servo=rotation.servo)
    left, good, moved = _heldout_error(rig, ready)
    rig = replace(rig, robot=replace(rig.robot, unexplained=left))
    rig, assumed = fit_tool(rig, given, settings)
    notes = [f'axis {name} never moved; it is given the model of the axis that moved most'
             for name, axis in zip('xyz', axes) if not axis.order]
    if not rotation.identified:
        notes.append('the orientation never changed; it is given the lag of the position')
    return RigFit(rig, tuple(axes), rotation, good, moved, (*notes, *assumed))


def _required(recording: Recording) -> Recording:
    """Return a recording with even stamps, and refuse one that lacks something."""
    require(recording, ('target', 'pose', 'wrench'))
    for role in ('target', 'pose'):
        if not getattr(recording, role).has_position:
            raise DataError(f'{recording.source}: {role} has no position; record poses of '
                            'ft_sensor in the base')
    return even_stamps(recording).recording


def _measured(base: Rig, recording: Recording, period: float, settings: IdentificationSettings
              ) -> Rig:
    """Give a rig the rates, the noise, the place and the gravity of a recording."""
    wrench, pose, volts = recording.wrench, recording.pose, recording.accelerometer
    target = recording.target
    assert wrench is not None and pose is not None and target is not None
    force, torque = noise_of(wrench.values[:, :3]), noise_of(wrench.values[:, 3:])
    sensor = replace(base.wrench_sensor, rate=rate_beside(wrench.t, period), force_noise=force,
                     torque_noise=torque, gain=(1.0,) * 6)
    poses = replace(base.pose_sensor, rate=rate_beside(pose.t, period),
                    position_noise=noise_of(pose.position),
                    orientation_noise=orientation_noise(pose))
    rate = max(1, round(base.accelerometer.rate * period)) / period
    accelerometer = replace(base.accelerometer, rate=rate)
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


def _heldout_error(rig: Rig, ready: Sequence[Followed]) -> tuple[Unexplained, float, float]:
    """Return what the robot's model leaves on what was held out, and up to where it is good."""
    apart, turned, moved = [], [], []
    for one in ready:
        if not one.held.any():
            continue
        made = at_ends(rig, one).position
        apart.append((one.reached - made)[one.held])
        turned.append(turned_apart(rig, one)[one.held])
        moved.append(centred(one.reached[one.held]))
    position, orientation = (np.concatenate(rows) for rows in (apart, turned))
    good, up_to = _good_up_to(centred(position), np.concatenate(moved), rig.robot.period)
    return Unexplained(
        _beyond_noise(centred(position)), _beyond_noise(centred(orientation)),
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
    # part of the motion that the model may leave at a frequency, in amplitude
    bad = np.flatnonzero(rest[1:last + 1] > 0.1 ** 2 * motion[1:last + 1])
    return (float(f[1 + bad[0]]) if len(bad) else np.inf), float(f[max(1, last)])


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
