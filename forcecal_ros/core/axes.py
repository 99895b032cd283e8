"""A base that is not level, a sensor turned on its flange: poses and wrenches in right axes."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from forcecal_ros.core.geometry import Array, rotation_about, rotation_from_vector
from forcecal_ros.core.schema import Vector3
from forcecal_ros.core.streams import PoseStream, Recording
import numpy as np

DOWN = np.array([0.0, 0.0, -1.0])


def level_from_base(direction: Sequence[float] | None) -> Array | None:
    """
    Return the least rotation that turns a direction of gravity to -z, shape (3, 3).

    Parameters
    ----------
    direction : sequence of 3 float, or None
        Of gravity in base, of any length; None: along -z.

    Returns
    -------
    ndarray or None
        None where nothing has to be turned.
    """
    if direction is None:
        return None
    down = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    if (down == DOWN).all():
        return None
    cross = np.cross(down, DOWN)
    if np.linalg.norm(cross) < 1e-12:
        return np.eye(3) if down[2] < 0.0 else rotation_about('x', np.pi)
    angle = np.arctan2(np.linalg.norm(cross), down @ DOWN)
    return rotation_from_vector(angle * cross / np.linalg.norm(cross))


def unit_direction(direction: Sequence[float] | None) -> Vector3 | None:
    """Return the unit vector of a direction of gravity that is not plainly down."""
    if direction is None or level_from_base(direction) is None:
        return None
    x, y, z = np.asarray(direction) / np.linalg.norm(direction)
    return float(x), float(y), float(z)


def levelled(recording: Recording, direction: Sequence[float] | None) -> Recording:
    """Return a recording whose poses, measured and commanded, are in a base that is level."""
    R = level_from_base(direction)
    if R is None:
        return recording
    return with_poses(recording, lambda stream: replace(
        stream, position=stream.position @ R.T, R_base_sensor=R @ stream.R_base_sensor))


def with_poses(recording: Recording, change: Callable[[PoseStream], PoseStream]) -> Recording:
    """Return a recording whose poses, measured and commanded, are changed."""
    return replace(recording, pose=recording.pose and change(recording.pose),
                   target=recording.target and change(recording.target))


def pose_from_wire(rotation: Sequence[float] | None) -> Array | None:
    """
    Return the matrix from the axes of the wire to those of the pose, shape (3, 3).

    Parameters
    ----------
    rotation : sequence of 3 float, or None
        Rotation vector of the wire's axes, seen from the frame of the pose [rad].

    Returns
    -------
    ndarray or None
        None where nothing has to be turned.
    """
    if rotation is None or not any(rotation):
        return None
    return rotation_from_vector(rotation)


def in_axes_of_pose(recording: Recording, rotation: Sequence[float] | None) -> Recording:
    """Return a recording whose wrench is in the axes of its pose, about the same origin."""
    R, wrench = pose_from_wire(rotation), recording.wrench
    if R is None or wrench is None:
        return recording
    turned = wrench.values @ np.kron(np.eye(2), R).T
    return replace(recording, wrench=replace(wrench, values=turned))
