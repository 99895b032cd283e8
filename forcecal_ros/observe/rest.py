"""Whether a robot is at rest, by its poses: slow motion shakes nothing, and is motion still."""

from collections.abc import Sequence

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import matrix_from_quaternion, rotation_vector
import numpy as np

DISTANCE = 5e-4
"""A robot that stays within it over the window is at rest: 25 times the scatter of the nominal
rig's poses [m]."""

ANGLE = 1e-3
"""A robot that turns by less over the window is at rest: 50 times the scatter of the nominal
rig's poses [rad]."""


def refuse_motion(poses: Sequence[tuple[float, ...]]) -> None:
    """
    Refuse to tare a robot that is not at rest.

    Parameters
    ----------
    poses : sequence of tuple of 7 float
        Of the window: x y z [m] qx qy qz qw; NaN positions are not looked at.

    Raises
    ------
    DataError
        The robot moved in the window; with the number.
    """
    if len(poses) < 2:
        return
    table = np.array(poses)
    distance = float(np.linalg.norm(table[:, :3] - table[0, :3], axis=1).max())
    R = matrix_from_quaternion(table[:, 3:])
    angle = float(np.linalg.norm(rotation_vector(R[0].T @ R), axis=1).max())
    if distance > DISTANCE or angle > ANGLE:
        raise DataError(f'tare refused, the robot moves: {distance * 1e3:.2f} mm, '
                        f'{angle * 1e3:.2f} mrad within the window; stop the robot')
