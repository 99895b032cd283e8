"""The contact wrench in other frames, and the point at which a contact force acts."""

from collections import deque
from collections.abc import Sequence
from math import hypot
import re
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.observe.sample import Wrench
from forcecal_ros.observe.tracking import Quaternion, rotate, rotate_back, Vector
import numpy as np

POSE_LENGTH = 7
"""A pose is so many numbers in a flat list: x y z [m], qx qy qz qw."""

NEWEST_POSES = 64
"""Poses among which that of a wrench is looked for: a wrench waits 0.05 s at most, 50 poses at
1 kHz."""

NAME = re.compile(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)
"""What a topic may be called by."""


class Placement(NamedTuple):
    """Where ft_sensor is in a frame: its origin [m], and the rotation to the frame's axes."""

    position: Vector
    q: Quaternion


def transported(wrench: Wrench, place: Placement) -> Wrench:
    """Return a wrench that is given in ft_sensor, about its origin, in another frame."""
    fx, fy, fz = rotate(place.q, wrench[:3])
    nx, ny, nz = rotate(place.q, wrench[3:])
    x, y, z = place.position
    return fx, fy, fz, nx + y * fz - z * fy, ny + z * fx - x * fz, nz + x * fy - y * fx


class Frames:
    """
    The frames in which the contact wrench is wanted besides.

    Parameters
    ----------
    names : sequence of str
        Empty ones do not count.
    numbers : sequence of float
        Pose of each in ft_sensor, x y z [m] qx qy qz qw; of all, or of all but the last, which
        then is the frame of the measured poses. One number stands for none, since an empty list
        has no type in ROS.

    Attributes
    ----------
    names : tuple of str
    base : str
        The frame of the measured poses, where it is among them; else empty.

    Raises
    ------
    ConfigError
        Names and numbers do not match, or a name cannot be part of a topic.
    """

    def __init__(self, names: Sequence[str], numbers: Sequence[float]) -> None:
        self.names = tuple(filter(None, names))
        numbers = numbers if len(numbers) > 1 else ()
        rows, left = divmod(len(numbers), POSE_LENGTH)
        if (len(set(self.names)) != len(self.names) or left
                or not 0 <= len(self.names) - rows <= 1):
            raise ConfigError(
                f'publish.frames names {len(self.names)} frames ({", ".join(self.names)}), '
                f'publish.frame_poses has {len(numbers)} numbers; give {POSE_LENGTH} for each of '
                'as many different frames, and none for the last if it is that of current_pose')
        for name in self.names:
            if not NAME.fullmatch(name):
                raise ConfigError(f'publish.frames: {name!r} cannot be part of a topic; names '
                                  'have letters, digits and underscores')
        self._fixed = {name: _placed(name, numbers[POSE_LENGTH * i:POSE_LENGTH * (i + 1)])
                       for i, name in enumerate(self.names[:rows])}
        self.base = self.names[-1] if len(self.names) > rows else ''
        self._poses: deque[tuple[float, Placement]] = deque(maxlen=NEWEST_POSES)

    def note(self, t: float, pose: tuple[float, ...]) -> None:
        """Note a measured pose, x y z qx qy qz qw, with its stamp [s]."""
        x, y, z, a, b, c, d = pose
        n = hypot(a, b, c, d)
        if n > 0:
            self._poses.append((t, Placement((x, y, z), (a / n, b / n, c / n, d / n))))

    def forget(self) -> None:
        """Forget all poses."""
        self._poses.clear()

    def of(self, t: float, wrench: Wrench, timeout: float) -> dict[str, Wrench]:
        """Return a wrench by frame; without base where no pose is within ``timeout`` [s] of it."""
        found = {name: transported(wrench, place) for name, place in self._fixed.items()}
        if self.base and self._poses:
            stamp, place = min(self._poses, key=lambda pose: abs(pose[0] - t))
            if abs(stamp - t) <= timeout:
                found[self.base] = transported(wrench, place)
        return found


def _placed(name: str, numbers: Sequence[float]) -> Placement:
    """Turn the pose of a frame in ft_sensor into that of ft_sensor in the frame."""
    x, y, z, a, b, c, d = numbers
    if not abs(hypot(a, b, c, d) - 1) < 1e-3:
        raise ConfigError(f'publish.frame_poses: the quaternion of {name} has norm '
                          f'{hypot(a, b, c, d):.4g}, not 1')
    back = rotate_back((a, b, c, d), (x, y, z))
    return Placement((-back[0], -back[1], -back[2]), (-a, -b, -c, d))


PLAIN = 3.0
"""A force acts somewhere from so many of its standard deviations on; below, its line of action is
noise [1]."""


class ContactPoint(NamedTuple):
    """
    Where a force acts, as far as one wrench tells.

    Attributes
    ----------
    position : ndarray, shape (3,)
        In ft_sensor [m]. The force may act anywhere along its line through this point.
    covariance : ndarray, shape (3, 3)
        [m^2]
    """

    position: Array
    covariance: Array


def contact_point(wrench: Array, covariance: Array) -> ContactPoint | None:
    """
    Find the point from a wrench (6,) about the origin, and the covariance (6, 6) of its error.

    p = F x T / |F|^2, its covariance to first order; exact for a force without a couple. None
    where the force is not plain against its error.
    """
    F, T = wrench[:3], wrench[3:]
    squared = float(F @ F)
    if not squared > PLAIN ** 2 * float(np.trace(covariance[:3, :3])):
        return None
    p = np.cross(F, T) / squared
    J = np.hstack([-skew(T) / squared - 2 * np.outer(p, F) / squared, skew(F) / squared])
    return ContactPoint(p, J @ covariance @ J.T)
