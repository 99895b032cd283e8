"""A sensor that sits turned on its flange: its wrench in the axes of the pose."""

from collections.abc import Sequence
from dataclasses import replace

from forcecal_ros.geometry import Array, rotation_from_vector
from forcecal_ros.recording.streams import Recording
import numpy as np


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
