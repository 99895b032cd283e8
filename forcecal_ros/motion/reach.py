"""Where a robot has been: from a recording, the pose it began in and the box it stayed in."""

from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.recording.streams import Recording
import numpy as np


class Reach(NamedTuple):
    """First pose, and the corners in base, shape (3,) [m], of what sensor and tip went through."""

    home: Pose
    lower: Array
    upper: Array


def reach_of(recording: Recording, tip: Array) -> Reach:
    """
    Return where the robot of a recording has been.

    Parameters
    ----------
    tip : ndarray, shape (3,)
        The tool's foremost point in ft_sensor [m].

    Raises
    ------
    DataError
        It holds no poses with positions.
    """
    pose = recording.pose
    if pose is None or not len(pose) or not pose.has_position:
        raise DataError(f'{recording.source or "the recording"} holds no positions of the sensor, '
                        'from which home and box follow; state --home and '
                        '--set limits.workspace_min/max instead')
    points = np.concatenate([pose.position, pose.position + pose.R_base_sensor @ tip])
    return Reach(Pose(pose.position[0], pose.R_base_sensor[0]),
                 points.min(axis=0), points.max(axis=0))
