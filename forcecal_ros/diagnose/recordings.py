"""Recordings made comparable: one clock, bridged pauses, accelerometers, joints, commands."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

from forcecal_ros.checks.clocks import Clock, clocks, dropouts, skew_between
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge, Known
from forcecal_ros.checks.messages import Stated
from forcecal_ros.checks.signals import pauses, SENSORS
from forcecal_ros.core.calibration import Accelerometer
from forcecal_ros.core.errors import below, DataError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
from forcecal_ros.core.stamps import with_even_streams
from forcecal_ros.core.streams import JointStream, PoseStream, Recording
from forcecal_ros.core.topics import ROLES
from forcecal_ros.diagnose.dataset import MeasuredBlocks
from forcecal_ros.effects.rig import AccelerometerModel, Rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.rigid_tool import RigidTool
import numpy as np
from scipy.spatial.transform import Rotation, Slerp


class Corrected(NamedTuple):
    """
    A recording on one clock.

    Attributes
    ----------
    clocks : tuple of Clock
        As they were found.
    skew : dict of str to float
        Of the streams whose stamps were corrected.
    lost : dict of str to float
        Fraction of lost samples by stream.
    notes : tuple of str
        What had to be left out.
    stamped : Recording
        Before its clocks were corrected.
    """

    recording: Recording
    clocks: tuple[Clock, ...]
    skew: dict[str, float]
    lost: dict[str, float]
    notes: tuple[str, ...] = ()
    stamped: Recording = Recording()


def correct_clocks(recording: Recording, rig: Rig, shortest: float) -> Corrected:
    """
    Bring all streams to the clock of the commands.

    Parameters
    ----------
    shortest : float
        For how long commands and sensors have to be there together [s].

    Raises
    ------
    DataError
        Commands or sensors are missing, not finite, or do not overlap.
    """
    stamped, changed = _even_streams(recording)
    # what is no reading has a stamp all the same: it is not lost
    found = clocks(replace(recording, **changed), _rates(rig))
    require_commands(stamped)
    if not any(_has(stamped, name) for name in STAGES_OF_STREAM):
        raise DataError('the recording holds neither wrench nor accelerometer; record at least '
                        'one of them')
    require_overlap(stamped, 'target', shortest)
    whole = bridge_pauses(stamped)
    skew = skew_between(found)
    start = float(whole.target.t[0]) if whole.target is not None else 0.0
    aligned = {}
    for name, value in skew.items():
        stream = getattr(whole, name)
        aligned[name] = replace(stream, t=start + (stream.t - start) / (1.0 + value))
    return Corrected(replace(whole, **aligned), found, skew, dropouts(found),
                     stamped.notes[len(recording.notes):], whole)


def even_stamps(recording: Recording) -> Corrected:
    """
    Take all streams to be on one clock already, as where no commands were recorded.

    Raises
    ------
    DataError
        A stream cannot be used.
    """
    stamped, _ = _even_streams(recording)
    return Corrected(stamped, (), {}, {}, stamped.notes[len(recording.notes):], stamped)


def _even_streams(recording: Recording) -> tuple[Recording, dict[str, Any]]:
    """Check a recording and even sensors that jitter around instants; return these apart too."""
    recording = checked(recording)
    even = with_even_streams(recording, SENSORS)
    return even, {name: stream for name in SENSORS
                  if (stream := getattr(even, name)) is not getattr(recording, name)}


def _rates(rig: Rig) -> dict[str, float]:
    rates = {'wrench': rig.wrench_sensor.rate, 'accelerometer': rig.accelerometer.rate,
             'pose': rig.pose_sensor.rate, 'target': 1.0 / rig.robot.period}
    return rates | ({'optidrive': rig.optidrive.rate} if rig.optidrive else {})


def require_commands(recording: Recording) -> None:
    """Refuse a recording without commanded poses."""
    target = recording.target
    if target is None or not len(target) or not target.has_position:
        raise DataError('the recording holds no commands (target_frame), which the simulator '
                        'replays; record them')


MAX_PAUSE_S = 60.0
"""Pause of a recording, at most, that is bridged [s]."""

SETTLE_AFTER_PAUSE_S = 1.0
"""Time after a pause that is left out: the motion to there is not known [s]."""

STAGES_OF_STREAM = {'wrench': 'wrench_sensor and environment', 'accelerometer': 'accelerometer'}
"""Stages that only one stream shows, by that stream."""


def require_same_sensors(recordings: Sequence[Recording]) -> None:
    """
    Refuse a second recording that lacks a sensor of the first, or has one more.

    Raises
    ------
    DataError
        With the sensors.
    """
    there = [{name for name in SENSORS if _has(r, name)} for r in recordings]
    for other in there[1:]:
        if odd := there[0] ^ other:
            raise DataError(f'only one of the two recordings holds {", ".join(sorted(odd))}; '
                            'record the same topics in both')


def require_axes_of(rig: Rig, recording: Recording, by: str = 'rig',
                    other_tool: str | None = None) -> None:
    """
    Refuse a wrench whose frame, axes, sign or units are not those of a rig.

    Parameters
    ----------
    recording : Recording
        Checked.
    by : str
        ``rig`` or ``calibration``: where the model is.
    other_tool : str, optional
        What to do if another tool than the rig's hung on the robot; to calibrate it if None.

    Raises
    ------
    DataError
        Names cause and remedy.
    """
    gravity, known = np.array(rig.gravity), Known(rig.tool.mass, np.array(rig.tool.com))
    judge(recording, gravity, Stated(gravity / np.linalg.norm(gravity), recording.wrench_sign or 1,
                                     sensor_from_pose=recording.sensor_from_pose, by=by),
          known._replace(other_tool=other_tool) if other_tool else known)


def require_overlap(recording: Recording, reference: str, shortest: float) -> None:
    """
    Refuse sensors that were recorded for too short a time together with another stream.

    Parameters
    ----------
    reference : str
        That stream.
    shortest : float
        [s]

    Raises
    ------
    DataError
        With the sensors.
    """
    clock = getattr(recording, reference)
    if clock is None or not len(clock):
        return
    short = {}
    for name in SENSORS:
        if name != reference and _has(recording, name):
            t = getattr(recording, name).t
            common = float(min(t[-1], clock.t[-1]) - max(t[0], clock.t[0]))
            if common < shortest:
                short[name] = max(0.0, common)
    if short:
        listed = ', '.join(f'{name} {below(common, shortest)} s' for name, common in short.items())
        raise DataError(f'the overlap with {ROLES[reference].topic} is too short: {listed}, '
                        f'{shortest:g} s are needed; record all topics throughout')


def _has(recording: Recording, name: str) -> bool:
    stream = getattr(recording, name)
    return stream is not None and len(stream) > 0


def bridge_pauses(recording: Recording) -> Recording:
    """
    Go over pauses of the whole recording, in which it is not known what was commanded.

    The robot is taken from the last command to the next one, and what sensors say until it has
    settled there is left out.

    Parameters
    ----------
    recording : Recording
        With commands.

    Raises
    ------
    DataError
        A pause is too long.
    """
    changed: dict[str, Any] = {n: getattr(recording, n) for n in SENSORS if _has(recording, n)}
    target = recording.target
    assert target is not None
    for start, end in pauses(recording):
        if end - start > MAX_PAUSE_S:
            raise DataError(f'nothing was recorded for {end - start:.0f} s from {start:.1f} s on; '
                            'cut the recording there, and give one part as --heldout')
        target = _fill_commands(target, start, end)
        changed = {name: s.rows((s.t <= start) | (s.t >= end + SETTLE_AFTER_PAUSE_S))
                   for name, s in changed.items()}
    return replace(recording, target=target, **changed)


def _fill_commands(target: PoseStream, start: float, end: float) -> PoseStream:
    """Fill a pause with commands, in step with those before it, that lead to the next one."""
    i = int(np.searchsorted(target.t, start, side='right')) - 1
    if i < 0 or i + 1 >= len(target):
        return target
    period = float(np.median(np.diff(target.t)))
    t = float(target.t[i]) + period * np.arange(1, np.ceil((end - target.t[i]) / period - 0.5))
    t = t[t > start]
    u = (t - start) / (end - start)
    share = u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2)
    way = target.position[i + 1] - target.position[i]
    turned = Slerp([0.0, 1.0], Rotation.from_matrix(target.R_base_sensor[i:i + 2]))(share)
    return replace(
        target, t=np.insert(target.t, i + 1, t),
        position=np.insert(target.position, i + 1,
                           target.position[i] + share[:, np.newaxis] * way, axis=0),
        R_base_sensor=np.insert(target.R_base_sensor, i + 1, turned.as_matrix(), axis=0))


def apply_accelerometer_calibration(recording: Recording,
                                    accelerometer: Accelerometer | None) -> Recording:
    """
    Bring an accelerometer's readings to m/s^2 along the axes of ft_sensor.

    Parameters
    ----------
    accelerometer : Accelerometer or None
        As calibrated; without, its readings are left out.

    Raises
    ------
    DataError
        It was calibrated in another unit.
    """
    stream = recording.accelerometer
    if stream is None or accelerometer is None:
        return replace(recording, accelerometer=None)
    if recording.accelerometer_unit != accelerometer.unit:
        raise DataError(f'the accelerometer is recorded in {recording.accelerometer_unit}, the '
                        f'calibration is for {accelerometer.unit}; calibrate with the same sensor')
    f = np.linalg.solve(accelerometer.matrix,
                        (stream.values - accelerometer.offset.value).T).T
    return replace(recording, accelerometer=replace(stream, values=f),
                   accelerometer_unit='m/s^2')


def recognise_accelerometer(recording: Recording, rig: Rig) -> str:
    """Return which accelerometer was mounted: the one whose volts at the start fit better."""
    name, (first, up) = rig.accelerometer.mounted, _at_start(recording, rig)
    if not len(first) or recording.accelerometer_unit != 'V':
        return name

    def miss(candidate: str) -> float:
        model = rig.accelerometer.model(candidate)
        return float(np.linalg.norm(
            first - model.offset - np.array(model.gain) * up * (model.highpass == 0.0)))

    best = min(('acc1', 'acc2'), key=miss)
    return best if miss(best) < 0.5 * miss(name) else name


def convert_to_volts(recording: Recording, rig: Rig, name: str) -> Recording:
    """
    Bring an accelerometer that speaks m/s^2 to volts.

    A driver that converts volts takes the rig's offset off; a sensor that speaks m/s^2 by itself
    does not know of it, and its readings hold it. Its value at the start shows which it is.
    """
    model, (first, up) = rig.accelerometer.model(name), _at_start(recording, rig)
    gain, offset = np.array(model.gain), np.array(model.offset)
    if len(first) and not model.highpass:
        rest = (first - up) * gain
        if np.linalg.norm(rest - offset) < 0.5 * np.linalg.norm(rest):
            offset = np.zeros(3)
    return scale_to_volts(recording, gain, offset)


def _at_start(recording: Recording, rig: Rig) -> tuple[Array, Array]:
    """Return an accelerometer's first readings, empty without, and the specific force by pose."""
    stream, pose = recording.accelerometer, recording.pose or recording.target
    if stream is None or not len(stream) or pose is None or not len(pose):
        return np.zeros(0), np.zeros(3)
    first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
    return first, -pose.R_base_sensor[0].T @ np.array(rig.gravity)


def scale_to_volts(recording: Recording, gain: Array, offset: Array) -> Recording:
    """Return volts where an accelerometer speaks m/s^2, by a gain and an offset."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V':
        return recording
    return replace(recording, accelerometer=replace(stream, values=stream.values * gain + offset),
                   accelerometer_unit='V')


IMU_OFFSET, IMU_GAIN = 0.03, 0.005
"""Of an Imu, 1 sigma [m/s^2] and relative: 3 mg and half a percent, as data sheets of MEMS say."""

SomeTool = TypeVar('SomeTool', bound=RigidTool)


def add_imu(tool: SomeTool) -> SomeTool:
    """Give a tool an accelerometer in its origin that speaks m/s^2."""
    plain = AccelerometerModel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    return replace(
        tool,
        accelerometer=replace(tool.accelerometer, mounted='acc1', acc1=plain,
                              position=(0.0, 0.0, 0.0)),
        spreads=replace(tool.spreads, accelerometer_offset=IMU_OFFSET,
                        accelerometer_gain=IMU_GAIN))


def keep_comparable_imus(real: Recording, simulated: Recording
                         ) -> tuple[Recording, Recording, str]:
    """
    Keep the accelerometers of two recordings where they can be compared.

    Parameters
    ----------
    real, simulated : Recording
        With measured pose.

    Returns
    -------
    real, simulated : Recording
    note : str
        Why they are left out; empty where they are not, or one of them is not there.
    """
    note = ''
    if real.accelerometer is not None and simulated.accelerometer is not None:
        note = next((f'accelerometer not compared: {whose} {why}' for one, whose in (
            (real, "the robot's"), (simulated, "the simulator's"))
            if (why := _reason_not_comparable(one))), '')
        if not note:
            return real, simulated, ''
    return replace(real, accelerometer=None), replace(simulated, accelerometer=None), note


def keep_compared_streams(recording: Recording, streams: tuple[str, ...]) -> Recording:
    """Leave an accelerometer out of what was recorded where it is none of the streams compared."""
    if 'accelerometer' in streams:
        return recording
    return replace(recording, accelerometer=None)


def _reason_not_comparable(recording: Recording) -> str:
    stream, pose = recording.accelerometer, recording.pose
    assert stream is not None and pose is not None
    if recording.accelerometer_unit != 'm/s^2':
        return 'is recorded in volts; record sensor_msgs/Imu'
    size = np.linalg.norm(stream.values, axis=1)
    shown = float(np.median(size))
    if shown < 0.5 * STANDARD_GRAVITY:  # arms do not fall half of the time
        return (f'measures {shown:.2g} m/s^2, not gravity; publish specific force, which at '
                'rest is gravity (REP-145)')
    up = pose.R_base_sensor[np.searchsorted(pose.t, stream.t).clip(max=len(pose) - 1), 2]
    cosine = np.sum(stream.values * up, axis=1) / np.maximum(size, 1e-9)
    angle = np.degrees(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
    if angle > 11.5:
        return (f'measures gravity {angle:.0f} deg away from that of the pose; publish it along '
                'the axes of the frame of the wrench')
    return ''


MIN_POSES = 50
"""Measured poses from which they show which commands the robot followed, and when."""


def estimate_start(recording: Recording, rig: Rig, accelerometer: str) -> float:
    """
    Find when the robot's period 0 began.

    Stamps of the measured pose lie on the grid of the robot's periods, or on a finer one where
    there are several in each. Commands on the same grid hold from their stamp on; others from one
    of the grid's next points, chosen by the pose.

    Parameters
    ----------
    recording : Recording
        With commands.

    Returns
    -------
    float
        [s]
    """
    target, pose, period = recording.target, recording.pose, rig.robot.period
    assert target is not None
    first = float(target.t[0])
    if pose is None or len(pose) < MIN_POSES or not pose.has_position:
        return first
    grid = min(period, float(np.median(np.diff(pose.t))))
    shift = grid_shift(target.t, pose.t, period)
    if not shift:
        return first
    starts = [first + shift + k * grid for k in range(-1, 1 + round(period / grid))]
    speed = np.linalg.norm(np.diff(target.position, axis=0), axis=1)
    begin = target.t[1:][speed > 0.1 * speed.max()][0] if speed.max() > 0.0 else first
    cut = pose.between(-np.inf, float(begin) + 20.0)  # enough to choose among whole periods
    misfits = [_pose_misfit(cut, target, rig, accelerometer, start) for start in starts]
    return first if np.isnan(misfits).any() else starts[int(np.argmin(misfits))]


def grid_shift(commands: Array, poses: Array, period: float) -> float:
    """
    Return how long after a command's stamp the grid of the poses has a point [s].

    0 where both are on one grid, or where one has none.
    """
    grid = min(period, float(np.median(np.diff(poses))))
    (held, even), (seen, kept) = (_phase(t, grid) for t in (commands, poses))
    shift = (seen - held) % grid
    # even stamps give 1, or 0; within 20 us of the grid of the poses commands are on it
    return shift if min(even, kept) > 0.3 and min(shift, grid - shift) > 2e-5 else 0.0


def _phase(t: Array, period: float) -> tuple[float, float]:
    """Return the mean phase of stamps on a grid [s], and how closely they keep to it, 0 to 1."""
    mean = np.mean(np.exp(2j * np.pi * (t - t[0]) / period))
    return float((t[0] + np.angle(mean) * period / (2.0 * np.pi)) % period), float(np.abs(mean))


def _pose_misfit(pose: PoseStream, target: PoseStream, rig: Rig, accelerometer: str, start: float
                 ) -> float:
    """RMS of measured less replayed poses, in their noise; NaN where there are too few."""
    replay = Replay(rig, target, start, min(float(pose.t[-1]), float(target.t[-1])), accelerometer)
    measured = MeasuredBlocks(Recording(pose=pose), start, replay.n_blocks)
    if 'pose' not in measured.streams or len(measured.times('pose')) < MIN_POSES:
        return np.nan
    sensor = rig.pose_sensor
    noise = np.repeat([sensor.position_noise, sensor.orientation_noise], 3)
    # an encoder of 22 bits shows 1e-6, and no robot's pose is finer
    rows = measured.samples('pose', replay.signals(rig)) / np.maximum(noise, 1e-6)
    return float(np.sqrt(np.mean(rows ** 2)))


INTERPOLATED_RATIO = 0.5
"""
Misfit of the poses with commands interpolated, in that with commands held, from which they were
not held: of poses at 20 Hz 0.006 where 250 Hz were thinned to that, 200 where 20 Hz were held.
"""


def refuse_sparse_commands(recording: Recording, rig: Rig, accelerometer: str) -> None:
    """
    Refuse commands of which most are missing, as the measured poses show.

    A robot that was commanded only now and then holds that, as the rig does. One that went
    smoothly from one recorded command to the next was commanded more than was recorded: its known
    way shows that, but is not good enough for the forces along it.

    Parameters
    ----------
    recording : Recording
        With commands.

    Raises
    ------
    DataError
        With how far commands and periods are apart.
    """
    target, pose, period = recording.target, recording.pose, rig.robot.period
    assert target is not None
    if pose is None or not pose.has_position or min(len(target), len(pose)) < MIN_POSES:
        return
    apart = float(np.median(np.diff(target.t)))
    if apart < 1.5 * period:  # else periods without a command are the rule
        return
    held, led = (_pose_misfit(pose, one, rig, accelerometer, estimate_start(
        replace(recording, target=one), rig, accelerometer))
        for one in (target, _interpolated(target, period)))
    if led < INTERPOLATED_RATIO * held:
        raise DataError(
            f'commands were recorded every {1e3 * apart:.3g} ms, the rig takes one every '
            f'{1e3 * period:.3g} ms, and the robot received more: the measured poses differ by '
            f'{held:.0f} times their noise with commands held, and {led:.2g} with commands '
            'interpolated; record every command, or give --calibration to compare the wrench '
            'with the measured motion')


def _interpolated(target: PoseStream, period: float) -> PoseStream:
    """Return commands in each period, on a smooth way through those there are."""
    return target.at(np.arange(target.t[0], target.t[-1], period))


def joint_names(joints: JointStream | None) -> tuple[str, ...]:
    """Return the names of the joints that a simulator may be compared with."""
    return () if joints is None or not len(joints) else joints.names


def keep_common_joints(recordings: Sequence[Recording]) -> list[Recording]:
    """Leave joints out of recordings that do not all hold the same, in one order."""
    if len({joint_names(one.joints) for one in recordings}) == 1:
        return list(recordings)
    return [replace(one, joints=None) for one in recordings]


def select_joints(joints: JointStream | None, names: Sequence[str]) -> JointStream | None:
    """
    Keep the joints that a simulator has, and samples of which each is a number.

    Parameters
    ----------
    joints : JointStream or None
        Measured.
    names : sequence of str
        The simulator's, some of the measured.

    Returns
    -------
    JointStream or None
        None where there is nothing to compare.
    """
    if joints is None or not len(joints) or not names:
        return None
    rows = joints.values[:, [joints.names.index(name) for name in names]]
    good = np.isfinite(rows).all(axis=1)
    if not good.any():
        return None
    return replace(joints, t=joints.t[good], values=rows[good], names=tuple(names))


def missing_joint_notes(measured: Sequence[str], names: Sequence[str]) -> Iterator[str]:
    """Say which measured joints a simulator lacks."""
    if measured and not names:
        yield (f'it simulates none of the joints in joint_states ({", ".join(measured)}), so '
               'friction and gains of joints show in the pose only; return joints with the same '
               'names')
    elif missing := [name for name in measured if name not in names]:
        yield f'joints not compared, as they are not simulated: {", ".join(missing)}'
