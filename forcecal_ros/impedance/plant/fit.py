"""The plant from a recording in free space."""

from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, rotation_vector
from forcecal_ros.impedance.plant.model import Plant
from forcecal_ros.impedance.plant.robot_fit import identify_robot, RobotFit
from forcecal_ros.impedance.plant.slide_fit import identify_slide, Signal, SlideFit
from forcecal_ros.recording.streams import PoseStream, Recording
import numpy as np

MOST_TURN = 0.01
"""Largest rotation of the sensor within a recording that a plant is identified from [rad]."""

_DIGITS = 9
"""Decimals of a period, the median of stamp differences, in seconds."""


class PlantFit(NamedTuple):
    """Robot and slide with the quality of their fits."""

    robot: RobotFit
    slide: SlideFit

    @property
    def plant(self) -> Plant:
        """The models."""
        return Plant(self.robot.robot, self.slide.slide)


def identify_plant(recording: Recording) -> PlantFit:
    """
    Identify robot and slide from commands that shake the tool along x of ft_sensor.

    Parameters
    ----------
    recording : Recording
        In free space, in one orientation, from rest, with commands, poses, wrench and
        displacement.

    Raises
    ------
    DataError
        A signal is missing, the sensor turns, or the motion does not tell the models.
    """
    target, pose = recording.target, recording.pose
    wrench, optidrive = recording.wrench, recording.optidrive
    if target is None or pose is None or wrench is None or optidrive is None:
        lacking = [name for name in ('target', 'pose', 'wrench', 'optidrive')
                   if getattr(recording, name) is None]
        raise DataError(f'{recording.source}: {", ".join(lacking)} is missing; record commands, '
                        'poses, wrench and displacement')
    axis = _axis(pose)
    period, command, position = _sampled(target, pose, axis)
    return PlantFit(
        identify_robot(command, position, period),
        identify_slide(Signal(wrench.t, wrench.values[:, 0]),
                       Signal(optidrive.t, optidrive.values[:, 0]),
                       Signal(pose.t, pose.position @ axis)))


def _axis(pose: PoseStream) -> Array:
    """Return x of ft_sensor in base, which must not turn."""
    start = pose.R_base_sensor[0]
    turn = max((float(np.linalg.norm(rotation_vector(start.T @ R)))
                for R in pose.R_base_sensor[::10]), default=0.0)
    if turn > MOST_TURN:
        raise DataError(f'the sensor turns by {turn:.3f} rad; move it along x of ft_sensor only '
                        f'({MOST_TURN} rad at most)')
    return np.array(start[:, 0])


def _sampled(target: PoseStream, pose: PoseStream, axis: Array) -> tuple[float, Array, Array]:
    """Return period, commands and positions, one a period, from the first command on."""
    if len(target) < 2:
        raise DataError(f'{len(target)} commands; record target_frame while the robot moves')
    period = round(float(np.median(np.diff(target.t))), _DIGITS)
    end = min(target.t[-1], pose.t[-1])
    t = np.arange(max(target.t[0], pose.t[0]), end + 0.5 * period, period)
    held = np.maximum(np.searchsorted(target.t, t + 0.5 * period, side='right') - 1, 0)
    start = target.position[0] @ axis
    position = np.interp(t, pose.t, pose.position @ axis)
    return period, target.position[held] @ axis - start, position - start
