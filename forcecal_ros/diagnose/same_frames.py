"""Frames in which the robot and its simulation say their poses: the same, or named."""

from dataclasses import replace

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import PoseStream
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

APART = 0.1
"""Angle beyond which frames are others [rad]: no arm is always that far from its simulation."""

UPRIGHT = 0.05
"""How far the axis of a turn of the base may lean for gravity to stay where it is [rad]."""

SAMPLES = 500
"""At so many instants is compared."""


def in_base_of(measured: PoseStream, simulated: PoseStream) -> PoseStream:
    """
    Bring simulated poses into the robot's base, which may be turned about the vertical.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock.

    Returns
    -------
    PoseStream

    Raises
    ------
    DataError
        The sensor's frames are turned to each other, or a base is not upright.
    """
    start, end = (f(measured.t[i], simulated.t[i]) for f, i in ((max, 0), (min, -1)))
    t = np.linspace(start, end, SAMPLES)
    R, S = (Slerp(p.t, Rotation.from_matrix(np.array(p.R_base_sensor)))(t)
            for p in (measured, simulated))
    sensor, in_sensor = _constant(S.inv() * R)
    base, in_base = _constant(R * S.inv())
    if min(sensor.magnitude(), base.magnitude()) < APART:
        return simulated
    if in_sensor < in_base:
        raise DataError('the poses are of frames that are turned by '
                        f'{np.degrees(sensor.magnitude()):.0f} deg to each other in the robot and '
                        'in the simulator; record the pose of the frame of the wrench in both')
    axis = base.as_rotvec() / base.magnitude()
    if np.hypot(axis[0], axis[1]) > UPRIGHT:
        raise DataError(f'the bases are turned by {np.degrees(base.magnitude()):.0f} deg to each '
                        'other, and not about the vertical; gravity is along -Z of both')
    turn = base.as_matrix()
    return replace(simulated, position=simulated.position @ turn.T,
                   R_base_sensor=turn @ simulated.R_base_sensor)


def _constant(turns: Rotation) -> tuple[Rotation, float]:
    """Return the mean of rotations, and how far they are from it, RMS [rad]."""
    mean = turns.mean()
    apart: Array = (turns * mean.inv()).magnitude()
    return mean, float(np.sqrt(np.mean(apart ** 2)))
