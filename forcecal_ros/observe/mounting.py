"""Poses of another frame, a flange's or a TCP's, and the fixed transform from it to ft_sensor."""

from collections.abc import Sequence
from dataclasses import replace
from math import dist, hypot, isfinite

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.core.schema import Vector7
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.observe.frames import Placement, POSE_LENGTH
from forcecal_ros.observe.tracking import product, rotate
import numpy as np

ITSELF: Vector7 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""ft_sensor in its own frame."""

SAME = 1e-4
"""Two transforms are one where they differ by less: a distance [m], and half an angle [rad].
Quaternions written with four digits do; 100 N turned by twice that are off by 0.02 N."""


def mounting_of(numbers: Sequence[float], name: str) -> Placement | None:
    """
    Return where ft_sensor is in the frame whose pose is measured.

    Parameters
    ----------
    numbers : sequence of float
        x y z [m] qx qy qz qw of ft_sensor in that frame. One number or none: the pose is that of
        ft_sensor.
    name : str
        What they were given as, for messages.

    Raises
    ------
    ConfigError
        They are not seven finite numbers with a unit quaternion at the end.
    """
    if len(numbers) < 2:
        return None
    if len(numbers) != POSE_LENGTH or not all(map(isfinite, numbers)):
        raise ConfigError(f'{name} is {list(numbers)}, expected the {POSE_LENGTH} numbers x y z '
                          '[m] qx qy qz qw of ft_sensor in the frame whose pose is measured')
    x, y, z, a, b, c, d = map(float, numbers)
    n = hypot(a, b, c, d)
    if not abs(n - 1) < 1e-3:
        raise ConfigError(f'{name}: the quaternion qx qy qz qw has norm {n:.4g}, not 1')
    return Placement((x, y, z), (a / n, b / n, c / n, d / n))


def numbers_of(mounting: Placement | None) -> Vector7 | None:
    """Return x y z [m] qx qy qz qw."""
    return None if mounting is None else (*mounting.position, *mounting.q)


def at_the_sensor(mounting: Placement, pose: tuple[float, ...]) -> Vector7:
    """Return the pose of ft_sensor, x y z qx qy qz qw, where the frame it is fixed to has this."""
    x, y, z, a, b, c, d = pose
    q = (a, b, c, d)
    u, v, w = rotate(q, mounting.position)
    return (x + u, y + v, z + w, *product(q, mounting.q))


def from_the_sensor(mounting: Placement, pose: tuple[float, ...]) -> Vector7:
    """Return the pose of the frame that ft_sensor is fixed to, where ft_sensor has this one."""
    x, y, z, a, b, c, d = pose
    i, j, k, r = mounting.q
    q = product((a, b, c, d), (-i, -j, -k, r))
    u, v, w = rotate(q, mounting.position)
    return (x - u, y - v, z - w, *q)


def taken_to_sensor(recording: Recording, mounting: Placement | None) -> Recording:
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
        raise DataError(f'{recording.source}: the pose, from /tf, is that of the frame of the '
                        'wrench already; leave --sensor-from-pose out')
    return replace(recording, pose=_taken(recording.pose, mounting),
                   target=_taken(recording.target, mounting),
                   sensor_from_pose=numbers_of(mounting))


def taken_as_calibrated(recording: Recording, calibration: Calibration, name: str) -> Recording:
    """
    Return a recording with the poses that a calibration was made with: those of ft_sensor.

    Parameters
    ----------
    name : str
        Of the calibration, for messages.

    Raises
    ------
    ConfigError
        The poses were taken to ft_sensor by another transform than the calibration's.
    """
    if recording.sensor_from_pose is None and _is_of_sensor(recording):
        return recording
    given = recording.sensor_from_pose
    mounting = agreed(mounting_of(given or (), 'sensor.from_pose'), calibration, name)
    if given is not None or mounting is None:
        return recording
    noted = replace(recording, notes=(*recording.notes, (
        f'poses are taken to ft_sensor by sensor.from_pose of {name}')))
    return taken_to_sensor(noted, mounting)


def agreed(given: Placement | None, calibration: Calibration, name: str) -> Placement | None:
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
    if _apart(numbers_of(given) or ITSELF, numbers_of(own) or ITSELF) < SAME:
        return given
    made = f'sensor.from_pose {_shown(own)}' if own else 'poses of ft_sensor itself'
    raise ConfigError(f'{name} was made with {made}, and {_shown(given)} is given: leave that '
                      'out to take the poses as in the calibration, or calibrate with it')


def _is_of_sensor(recording: Recording) -> bool:
    pose, wrench = recording.pose, recording.wrench
    return bool(pose and wrench and pose.of and pose.of == wrench.frame)


def _taken(stream: PoseStream | None, mounting: Placement) -> PoseStream | None:
    if stream is None:
        return None
    R = stream.R_base_sensor
    return replace(stream, position=stream.position + R @ np.array(mounting.position),
                   R_base_sensor=R @ matrix_from_quaternion(mounting.q), of='')


def _apart(a: Vector7, b: Vector7) -> float:
    """Return the larger of distance [m] and chord between the quaternions [half a radian]."""
    turn = min(dist(a[3:], b[3:]), dist(a[3:], [-x for x in b[3:]]))
    return max(dist(a[:3], b[:3]), turn)


def _shown(mounting: Placement) -> str:
    return ' '.join(f'{x:.6g}' for x in numbers_of(mounting) or ())
