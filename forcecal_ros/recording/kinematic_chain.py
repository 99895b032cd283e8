"""The pose of a frame in another, of transforms between frames and their parents."""

from collections.abc import Callable, Sequence

from forcecal_ros.geometry import Array
from forcecal_ros.recording.transforms import Route
import numpy as np
from scipy.spatial.transform import Rotation

Placement = tuple[Rotation, Array]
"""Rotations and places (n, 3) [m] of a frame in its parent."""


def pose_along(way: Route, placement: Callable[[str], Placement], n: int) -> Array:
    """
    Return the pose of a frame in a base.

    Parameters
    ----------
    way : Route
        From the frame and from the base up to where they meet.
    placement : callable
        Frame -> where it is in its parent, of ``n`` samples.

    Returns
    -------
    ndarray, shape (n, 7)
        x y z [m] qx qy qz qw.
    """
    R, p = _along(way.up, placement, n)
    S, q = _along(way.down, placement, n)
    return np.hstack([S.inv().apply(p - q), (S.inv() * R).as_quat()])


def _along(frames: Sequence[str], placement: Callable[[str], Placement], n: int) -> Placement:
    """Return where the first frame of a chain is in the parent of the last."""
    R, p = Rotation.identity(n), np.zeros((n, 3))
    for frame in frames:
        own, place = placement(frame)
        p = own.apply(p) + place
        R = own * R
    return R, p
