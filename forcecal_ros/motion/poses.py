"""Poses of a sequence: the paper's, the user's from a flat list, and where a robot has been."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import (
    Array,
    matrix_from_quaternion,
    POSE_LENGTH,
    quaternion_from_matrix,
    rotation_about,
    rotation_from_vector,
)
from forcecal_ros.core.streams import Recording
from forcecal_ros.motion.profiles import Pose
import numpy as np
from numpy.typing import ArrayLike


def orientation(alpha: float, delta: float, theta: float = 0.0) -> Array:
    """
    Return R_base_sensor by [Gamez2005] Eq. 9 and, for alpha = 0, Eq. 12.

    Parameters
    ----------
    alpha, delta, theta : float
        About Y, X and Z [rad].
    """
    return rotation_about('y', alpha) @ rotation_about('x', delta) @ rotation_about('z', theta)


def nominal_poses() -> dict[str, Pose]:
    """
    Return the paper's two poses and two that are an optimal design beside them.

    All at one position of the nominal rig: ``v`` (x horizontal, home), ``h`` (x up), ``side``
    (45 deg about x) and ``down`` (x down). The last two were chosen by the Fisher information of
    :mod:`forcecal_ros.motion.optimal_design` for the least standard error of the accelerometer's
    offset within 16 s and 100 deg from home, with nothing else worse than by three poses of 1 s
    in 14 s: 0.16 mV, against 0.28 mV.
    """
    position, home = np.array([1.0, 0.0, 1.0]), orientation(0.0, np.pi)
    turns = {'side': (45.0, 0.0, 0.0), 'down': (-10.0, 95.0, 0.0)}
    return {'v': Pose(position, home),
            'h': Pose(position, orientation(np.pi / 2, np.pi)),
            **{name: Pose(position, home @ rotation_from_vector(np.radians(turn)))
               for name, turn in turns.items()}}


def flatten_poses(poses: Mapping[str, Pose]) -> list[float]:
    """Return poses as one flat list, x y z qx qy qz qw of each."""
    return [float(x) for pose in poses.values()
            for x in (*pose.position, *quaternion_from_matrix(pose.R_base_sensor))]


def read_poses(names: Sequence[str], numbers: ArrayLike) -> dict[str, Pose]:
    """
    Read poses from a flat list, as ROS parameters hold them.

    Parameters
    ----------
    numbers : array_like, shape (7 n,)
        x y z qx qy qz qw of each pose [m]; a position may be NaN, see :func:`anchor`.

    Raises
    ------
    ConfigError
        Names and numbers do not match, a name comes twice, or a quaternion is not of unit norm.
    """
    flat = np.asarray(numbers, dtype=float).reshape(-1)
    if len(flat) != POSE_LENGTH * len(names) or len(set(names)) != len(names) or not len(names):
        raise ConfigError(
            f'{len(names)} pose names ({", ".join(names)}) require as many different ones and '
            f'{POSE_LENGTH} numbers each (x y z qx qy qz qw), got {len(flat)} numbers')
    poses = {}
    for name, row in zip(names, flat.reshape(-1, POSE_LENGTH)):
        norm = float(np.linalg.norm(row[3:]))
        if not abs(norm - 1) < 1e-3:
            raise ConfigError(f'pose {name}: its quaternion has norm {norm:.4g}, not 1')
        poses[name] = Pose(row[:3].copy(), matrix_from_quaternion(row[3:]))
    return poses


def anchor(poses: Mapping[str, Pose], position: Array) -> dict[str, Pose]:
    """Return the poses with ``position`` (3,) [m] where their own is NaN."""
    return {name: Pose(np.where(np.isfinite(pose.position), pose.position, position),
                       pose.R_base_sensor) for name, pose in poses.items()}


def step_goal(home: Pose, distance: float) -> Pose:
    """Return the pose ``distance`` [m] along x of ft_sensor from ``home``."""
    return Pose(home.position + distance * home.R_base_sensor[:, 0], home.R_base_sensor)


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
