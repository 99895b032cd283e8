"""What neither a plan nor a measured motion may exceed, and the plan's part of checking it."""

from dataclasses import dataclass

from forcecal_ros.errors import ConfigError, MotionError
from forcecal_ros.geometry import Array
from forcecal_ros.motion.joints import JointMove
from forcecal_ros.motion.profiles import Move, peak_rates, PEAK_STOP, PEAK_STOP_JERK
import numpy as np


@dataclass(frozen=True)
class Limits:
    """
    What neither a plan nor a measured motion may exceed; the names are the parameters' keys.

    Attributes
    ----------
    speed, acceleration, jerk : float
        Of the origin of ft_sensor [m/s], [m/s^2], [m/s^3].
    angular_speed, angular_acceleration, angular_jerk : float
        [rad/s], [rad/s^2], [rad/s^3]
    joint_speed, joint_acceleration, joint_jerk : float
        Of each joint, where joints are commanded [rad/s], [rad/s^2], [rad/s^3].
    workspace_min, workspace_max : ndarray, shape (3,)
        Box in base that the origin of ft_sensor and the tool's tip stay in [m].
    tip : ndarray, shape (3,)
        The tool's foremost point in ft_sensor [m].
    force, torque : float
        Norms of the wrench as it is read, weight and bias included [N], [N m].
    tracking_error, tracking_angle : float
        Measured against commanded pose [m], [rad].
    overspeed : float
        What is measured may exceed speeds, acceleration and jerk by this factor.
    stop_duration : float
        From a stop's first command to rest [s].
    """

    speed: float = 0.25
    acceleration: float = 8.0
    jerk: float = 1500.0
    angular_speed: float = 1.5
    angular_acceleration: float = 60.0
    angular_jerk: float = 6000.0
    joint_speed: float = 1.5
    joint_acceleration: float = 60.0
    joint_jerk: float = 6000.0
    workspace_min: Array = (0.6, -0.4, 0.6)  # type: ignore[assignment]
    workspace_max: Array = (1.25, 0.4, 1.4)  # type: ignore[assignment]
    tip: Array = (0.2, 0.0, 0.1)  # type: ignore[assignment]
    force: float = 250.0
    torque: float = 60.0
    tracking_error: float = 0.02
    tracking_angle: float = 0.2
    overspeed: float = 1.5
    stop_duration: float = 0.045

    def __post_init__(self) -> None:
        for name in ('workspace_min', 'workspace_max', 'tip'):
            value = np.array(getattr(self, name), dtype=float)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise ConfigError(f'limits.{name} wants three finite numbers, got {value}')
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if (self.workspace_min >= self.workspace_max).any():
            raise ConfigError(
                f'limits.workspace_min {self.workspace_min.tolist()} m is not below '
                f'limits.workspace_max {self.workspace_max.tolist()} m on every axis')
        for name in ('speed', 'angular_speed', 'joint_speed'):
            self._check_can_stop(name, name.replace('speed', 'acceleration'),
                                 PEAK_STOP / self.stop_duration)
            self._check_can_stop(name, name.replace('speed', 'jerk'),
                                 PEAK_STOP_JERK / self.stop_duration**2)

    def _check_can_stop(self, speed: str, limit: str, peak: float) -> None:
        needed = peak * getattr(self, speed)
        if needed > getattr(self, limit) * 1.05:
            raise ConfigError(
                f'limits.{speed} {getattr(self, speed):g} stops within limits.stop_duration '
                f'{self.stop_duration:g} s at {needed:.3g}, above limits.{limit} '
                f'{getattr(self, limit):g}; lower the one or raise the other')


def check_move(move: Move, limits: Limits, name: str = 'the move') -> None:
    """
    Refuse a move that would pass a limit, a stop at any instant of it included.

    Parameters
    ----------
    move : Move
    limits : Limits
    name : str
        What to call it in the message.

    Raises
    ------
    MotionError
        With the number, the limit and its key.
    """
    peak = peak_rates(move.duration, limits.stop_duration)
    for key, planned, limit, unit in (
            ('speed', move.distance * peak.speed, limits.speed, 'm/s'),
            ('acceleration', move.distance * peak.acceleration, limits.acceleration, 'm/s^2'),
            ('jerk', move.distance * peak.jerk, limits.jerk, 'm/s^3'),
            ('angular_speed', move.angle * peak.speed, limits.angular_speed, 'rad/s'),
            ('angular_acceleration', move.angle * peak.acceleration,
             limits.angular_acceleration, 'rad/s^2'),
            ('angular_jerk', move.angle * peak.jerk, limits.angular_jerk, 'rad/s^3')):
        if not planned <= limit:
            raise MotionError(f'{name} needs {planned:.4g} {unit}, limits.{key} is {limit:g} '
                              f'{unit}; give it more time or a shorter way')
    positions, rotations = move.poses()
    check_workspace(positions, limits, f'{name}: the sensor')
    check_workspace(positions + rotations @ limits.tip, limits, f'{name}: the tip')


def check_workspace(points: Array, limits: Limits, name: str) -> None:
    """
    Refuse points outside the box.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In base [m].
    limits : Limits
    name : str
        What to call them in the message.

    Raises
    ------
    MotionError
        With the farthest point, the face and its key.
    """
    for key, bound, beyond in (
            ('workspace_min', limits.workspace_min, limits.workspace_min - points),
            ('workspace_max', limits.workspace_max, points - limits.workspace_max)):
        i, axis = np.unravel_index(np.argmax(beyond), beyond.shape)
        if not beyond[i, axis] <= 0:
            raise MotionError(
                f'{name} would reach {"xyz"[axis]} = {points[i, axis]:.4f} m, '
                f'limits.{key} is {bound[axis]:g} m there; move the pose or widen the box')


def check_joint_move(move: JointMove, limits: Limits, name: str) -> None:
    """
    Refuse a move that would pass a joint's limit, a stop at any instant of it included.

    Parameters
    ----------
    move : JointMove
    limits : Limits
    name : str
        What to call it in the message.

    Raises
    ------
    MotionError
        With the joint, the number, the limit and its key.
    """
    peak = peak_rates(move.duration, limits.stop_duration)
    joint = int(np.argmax(np.abs(move.way)))
    way = float(np.abs(move.way[joint]))
    for key, planned, limit, unit in (
            ('joint_speed', way * peak.speed, limits.joint_speed, 'rad/s'),
            ('joint_acceleration', way * peak.acceleration, limits.joint_acceleration,
             'rad/s^2'),
            ('joint_jerk', way * peak.jerk, limits.joint_jerk, 'rad/s^3')):
        if not planned <= limit:
            raise MotionError(f'{name} needs {planned:.4g} {unit} of joint {joint + 1}, '
                              f'limits.{key} is {limit:g} {unit}; give it more time or a '
                              'shorter way')
