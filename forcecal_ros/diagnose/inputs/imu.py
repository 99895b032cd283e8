"""An Imu beside that of a simulator: both in m/s^2 along ft_sensor, or left out with a reason."""

from dataclasses import replace
from typing import TypeVar

from forcecal_ros.effects.rig import AccelerometerModel
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import PoseStream, Recording, Stream
from forcecal_ros.simulators.rigid_tool import RigidTool
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

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
        return 'speaks volts; record an Imu or AccelStamped'
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
