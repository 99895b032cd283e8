"""Fixed transforms: poses of a flange or TCP taken to ft_sensor, the wrench in other frames."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from math import dist, hypot, isfinite
import re
from typing import NamedTuple

from forcecal_ros.core.axes import with_poses
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import (
    Array,
    invert,
    ITSELF,
    matrix_from_quaternion,
    POSE_LENGTH,
    rotate,
    skew,
)
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.streams import Recording
from forcecal_ros.observe.sample import Wrench
import numpy as np

NAME = re.compile(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', re.ASCII)
"""What a topic may be called by."""


Mounting = Vector7
"""Pose of ft_sensor, x y z [m] qx qy qz qw, in the frame whose pose is measured."""


def transported(wrench: Wrench, sensor: Vector7) -> Wrench:
    """Return a wrench of ft_sensor, about its origin, in the frame where ft_sensor has a pose."""
    fx, fy, fz = rotate(sensor[3:], wrench[:3])
    nx, ny, nz = rotate(sensor[3:], wrench[3:])
    x, y, z = sensor[:3]
    return fx, fy, fz, nx + y * fz - z * fy, ny + z * fx - x * fz, nz + x * fy - y * fx


class Frames:
    """
    Further frames for the contact wrench.

    Parameters
    ----------
    names : sequence of str
        Empty ones do not count.
    numbers : sequence of float
        Pose of each in ft_sensor, x y z [m] qx qy qz qw; of all, or of all but the last, which
        then is the frame of the measured poses. One number represents none, since an empty list
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
                f'publish.frame_poses has {len(numbers)} numbers; give {POSE_LENGTH} for each, '
                'or none for the last if it is the frame of current_pose; names must differ')
        for name in self.names:
            if not NAME.fullmatch(name):
                raise ConfigError(f'publish.frames: {name!r} cannot be part of a topic; names '
                                  'have letters, digits and underscores')
        self._fixed = {
            name: invert(checked_pose(numbers[POSE_LENGTH * i:POSE_LENGTH * (i + 1)],
                                      f'publish.frame_poses of {name}'))
            for i, name in enumerate(self.names[:rows])}
        self.base = self.names[-1] if len(self.names) > rows else ''
        self._poses: deque[tuple[float, Vector7]] = deque(maxlen=64)

    def note(self, t: float, pose: tuple[float, ...]) -> None:
        """Note a measured pose, x y z qx qy qz qw, with its stamp [s]."""
        x, y, z, a, b, c, d = pose
        n = hypot(a, b, c, d)
        if n > 0:
            self._poses.append((t, (x, y, z, a / n, b / n, c / n, d / n)))

    def forget(self) -> None:
        """Forget all poses."""
        self._poses.clear()

    def of(self, t: float, wrench: Wrench, timeout: float) -> dict[str, Wrench]:
        """Return a wrench by frame; without base where no pose is within ``timeout`` [s] of it."""
        found = {name: transported(wrench, sensor) for name, sensor in self._fixed.items()}
        if self.base and self._poses:
            stamp, sensor = min(self._poses, key=lambda pose: abs(pose[0] - t))
            if abs(stamp - t) <= timeout:
                found[self.base] = transported(wrench, sensor)
        return found


class ContactPoint(NamedTuple):
    """
    Where a force acts, as far as one wrench shows.

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
    # a force acts somewhere from so many of its standard deviations on; below,
    # its line of action is noise
    if not squared > 3.0 ** 2 * float(np.trace(covariance[:3, :3])):
        return None
    p = np.cross(F, T) / squared
    J = np.hstack([-skew(T) / squared - 2 * np.outer(p, F) / squared, skew(F) / squared])
    return ContactPoint(p, J @ covariance @ J.T)


def mounting_of(numbers: Sequence[float], name: str) -> Mounting | None:
    """
    Return the pose of ft_sensor in the frame whose pose is measured.

    Parameters
    ----------
    numbers : sequence of float
        As of :func:`checked_pose`. One number or none: the pose is that of ft_sensor.
    name : str
        What they were given as, for messages.
    """
    return checked_pose(numbers, name) if len(numbers) > 1 else None


def checked_pose(numbers: Sequence[float], name: str) -> Vector7:
    """
    Return a pose, x y z [m] qx qy qz qw, of unit norm.

    Raises
    ------
    ConfigError
        They are not seven finite numbers with a unit quaternion at the end.
    """
    if len(numbers) != POSE_LENGTH or not all(map(isfinite, numbers)):
        raise ConfigError(f'{name} is {list(numbers)}, expected the {POSE_LENGTH} numbers x y z '
                          '[m] qx qy qz qw')
    x, y, z, a, b, c, d = map(float, numbers)
    n = hypot(a, b, c, d)
    if not abs(n - 1) < 1e-3:
        raise ConfigError(f'{name}: the quaternion qx qy qz qw has norm {n:.4g}, not 1')
    return x, y, z, a / n, b / n, c / n, d / n


def taken_to_sensor(recording: Recording, mounting: Mounting | None) -> Recording:
    """
    Return a recording whose poses, measured and commanded, are those of ft_sensor.

    Raises
    ------
    DataError
        Its pose is known to be that of ft_sensor already.
    """
    if mounting is None:
        return recording
    if _is_of_sensor(recording):
        raise DataError(f'{recording.source}: the pose from /tf already is that of the frame of '
                        'the wrench; leave --sensor-from-pose out')
    place, turn = np.array(mounting[:3]), matrix_from_quaternion(mounting[3:])
    return replace(with_poses(recording, lambda stream: replace(
        stream, position=stream.position + stream.R_base_sensor @ place,
        R_base_sensor=stream.R_base_sensor @ turn, of='')), sensor_from_pose=mounting)


def taken_as_calibrated(recording: Recording, calibration: Calibration, name: str) -> Recording:
    """
    Return a recording in the sign that a calibration was made in, with poses of ft_sensor.

    A sign that was stated when the recording was read stays.

    Parameters
    ----------
    name : str
        Of the calibration, for messages.

    Raises
    ------
    ConfigError
        The poses were taken to ft_sensor by another transform than the calibration's.
    """
    recording = _in_sign_of(calibration, recording)
    if recording.sensor_from_pose is None and _is_of_sensor(recording):
        return recording
    given = recording.sensor_from_pose
    mounting = agreed(given, calibration, name)
    if given is not None or mounting is None:
        return recording
    noted = replace(recording, notes=(*recording.notes, (
        f'poses are converted to ft_sensor with sensor.from_pose of {name}')))
    return taken_to_sensor(noted, mounting)


def _in_sign_of(calibration: Calibration, recording: Recording) -> Recording:
    wrench, sign = recording.wrench, calibration.wrench_sign
    if recording.wrench_sign is not None or wrench is None or sign > 0:
        return recording
    return replace(recording, wrench=replace(wrench, values=-wrench.values), wrench_sign=sign)


def agreed(given: Mounting | None, calibration: Calibration, name: str) -> Mounting | None:
    """
    Return the transform to run a calibration with: its own, which one that is given has to equal.

    Parameters
    ----------
    name : str
        Of the calibration, for messages.

    Raises
    ------
    ConfigError
        They differ: weight and inertia would be computed for another sensor.
    """
    own = mounting_of(calibration.sensor_from_pose or (), f'{name}: sensor.from_pose')
    if given is None or (own is None and 'of' in calibration.source):
        return given or own  # files of other packages do not say whose pose they were made with
    # two transforms are one where they differ by less: a distance [m], and half an angle [rad].
    # Quaternions written with four digits do; 100 N turned by twice that are off by 0.02 N
    if _apart(given or ITSELF, own or ITSELF) < 1e-4:
        return given
    made = f'sensor.from_pose {_shown(own)}' if own else 'poses of ft_sensor itself'
    raise ConfigError(f'{name} was made with {made}, but sensor.from_pose {_shown(given)} is '
                      'given; leave it out to use that of the calibration, or calibrate with it')


def _is_of_sensor(recording: Recording) -> bool:
    pose, wrench = recording.pose, recording.wrench
    return bool(pose and wrench and pose.of and pose.of == wrench.frame)


def _apart(a: Vector7, b: Vector7) -> float:
    """Return the larger of distance [m] and chord between the quaternions [half a radian]."""
    turn = min(dist(a[3:], b[3:]), dist(a[3:], [-x for x in b[3:]]))
    return max(dist(a[:3], b[:3]), turn)


def _shown(mounting: Mounting) -> str:
    return ' '.join(f'{x:.6g}' for x in mounting)
