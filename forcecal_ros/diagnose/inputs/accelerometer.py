"""The accelerometer: which one was mounted, its unit, and an Imu beside that of a simulator."""

from dataclasses import replace
from typing import TypeVar

from forcecal_ros.core.calibration import Accelerometer
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.effects.rig import AccelerometerModel, Rig
from forcecal_ros.sim.rigid_tool import RigidTool
import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def as_specific_force(recording: Recording, accelerometer: Accelerometer | None) -> Recording:
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
        raise DataError(f'the accelerometer speaks {recording.accelerometer_unit}, it was '
                        f'calibrated in {accelerometer.unit}; calibrate with this one')
    f = np.linalg.solve(accelerometer.matrix,
                        (stream.values - accelerometer.offset.value).T).T
    return replace(recording, accelerometer=replace(stream, values=f),
                   accelerometer_unit='m/s^2')


def mounted(recording: Recording, rig: Rig) -> str:
    """Say which accelerometer was mounted: the one whose volts at the start fit better."""
    stream, name = recording.accelerometer, rig.accelerometer.mounted
    pose = recording.pose or recording.target
    if stream is None or recording.accelerometer_unit != 'V' or pose is None or not len(stream):
        return name
    first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
    up = -pose.R_base_sensor[0].T @ np.array(rig.gravity)

    def miss(candidate: str) -> float:
        model = rig.accelerometer.model(candidate)
        f = up if model.highpass == 0.0 else np.zeros(3)
        volts = np.array(model.gain) * f + model.offset
        return float(np.linalg.norm(first - volts))

    best = min(('acc1', 'acc2'), key=miss)
    return best if miss(best) < 0.5 * miss(name) else name


def in_volts(recording: Recording, rig: Rig, name: str) -> Recording:
    """
    Bring an accelerometer that speaks m/s^2 to volts.

    A driver that converts volts takes the rig's offset off; a sensor that speaks m/s^2 by itself
    does not know of it, and its readings hold it. What it says at the start tells which it is.
    """
    model, stream = rig.accelerometer.model(name), recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V' or not len(stream):
        return recording
    offset = np.array(model.offset)
    pose = recording.pose or recording.target
    if pose is not None and len(pose) and not model.highpass:
        first = stream.values[:max(1, int(0.3 * stream.rate))].mean(axis=0)
        rest = (first + pose.R_base_sensor[0].T @ np.array(rig.gravity)) * np.array(model.gain)
        if np.linalg.norm(rest - offset) < 0.5 * np.linalg.norm(rest):
            offset = np.zeros(3)
    return with_volts(recording, np.array(model.gain), offset)


def with_volts(recording: Recording, gain: Array, offset: Array) -> Recording:
    """Return volts where an accelerometer speaks m/s^2, by a gain and an offset."""
    stream = recording.accelerometer
    if stream is None or recording.accelerometer_unit == 'V':
        return recording
    return replace(recording, accelerometer=replace(stream, values=stream.values * gain + offset),
                   accelerometer_unit='V')


OFFSET, GAIN = 0.03, 0.005
"""Of an Imu, 1 sigma [m/s^2] and relative: 3 mg and half a percent, as data sheets of MEMS say."""

NOISE = 0.05
"""Of an Imu [m/s^2], where it does not matter how much it is."""

TURNED = 0.2
"""Angle between gravity as felt and as the pose says it from which axes are others [rad]."""

SomeTool = TypeVar('SomeTool', bound=RigidTool)


def with_imu(tool: SomeTool) -> SomeTool:
    """Give a tool an accelerometer in its origin that speaks m/s^2."""
    plain = AccelerometerModel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)
    return replace(
        tool,
        accelerometer=replace(tool.accelerometer, mounted='acc1', acc1=plain, noise=NOISE,
                              position=(0.0, 0.0, 0.0)),
        spreads=replace(tool.spreads, accelerometer_offset=OFFSET, accelerometer_gain=GAIN))


def imus_compared(real: Recording, simulated: Recording) -> tuple[Recording, Recording, str]:
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
        found = ((_unusable(one), whose) for one, whose in (
            (real, "the robot's"), (simulated, "the simulator's")))
        note = next((f'accelerometer not compared: {whose} {why}' for why, whose in found if why),
                    '')
        if not note:
            return real, simulated, ''
    return replace(real, accelerometer=None), replace(simulated, accelerometer=None), note


def as_compared(recording: Recording, streams: tuple[str, ...]) -> Recording:
    """Leave an accelerometer out of what was recorded where it is none of the streams compared."""
    if 'accelerometer' in streams:
        return recording
    return replace(recording, accelerometer=None)


def _unusable(recording: Recording) -> str:
    stream, pose = recording.accelerometer, recording.pose
    assert stream is not None
    assert pose is not None
    if recording.accelerometer_unit != 'm/s^2':
        return 'speaks volts; record an Imu'
    angle = from_gravity(stream, pose)
    if angle > TURNED:
        return (f'feels gravity {np.degrees(angle):.0f} deg from where the pose has it; publish '
                'it along the axes of the frame of the wrench')
    return ''


def from_gravity(stream: Stream, pose: PoseStream) -> float:
    """Return the median angle between what is felt and up by the pose [rad]."""
    inside = (stream.t >= pose.t[0]) & (stream.t <= pose.t[-1])
    felt: Array = stream.values[inside]
    up = Slerp(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))(
        stream.t[inside]).inv().apply([0.0, 0.0, 1.0])
    cosine = np.sum(felt * up, axis=1) / np.maximum(np.linalg.norm(felt, axis=1), 1e-9)
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0)))) if len(felt) else np.pi
