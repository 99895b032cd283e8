"""Limits of planned and measured motion, and the checks of a plan against them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from forcecal_ros.core.errors import above, below, ConfigError, MotionError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import Row, Section
from forcecal_ros.motion.profiles import (
    JointMove,
    Move,
    Pace,
    peak_rates,
    PEAK_STOP,
    PEAK_STOP_JERK,
)
import numpy as np

MARGIN = 0.967
"""Share of a limit that planned motion aims at, as the default pace does of the default speeds."""


@dataclass(frozen=True)
class Limits(Section):
    """Limits of planned and of measured motion; the names are the parameters' keys."""

    speed: Annotated[float, Row(
        'Largest speed of a plan; the motion stops above limits.overspeed times this',
        'm/s', 0.001, 2.0)] = 0.25
    acceleration: Annotated[float, Row(
        'Largest acceleration of a plan, stops included', 'm/s^2', 0.01, 50.0)] = 8.0
    jerk: Annotated[float, Row(
        'Largest jerk of a plan, stops included', 'm/s^3', 1.0, 1e5)] = 1500.0
    angular_speed: Annotated[float, Row(
        'Largest angular speed of a plan', 'rad/s', 0.01, 5.0)] = 1.5
    angular_acceleration: Annotated[float, Row(
        'Largest angular acceleration of a plan, stops included', 'rad/s^2', 0.1, 300.0)] = 60.0
    angular_jerk: Annotated[float, Row(
        'Largest angular jerk of a plan, stops included', 'rad/s^3', 1.0, 1e6)] = 6000.0
    joint_speed: Annotated[float, Row(
        'Largest speed of each joint, with joint_trajectory', 'rad/s', 0.01, 10.0)] = 1.5
    joint_acceleration: Annotated[float, Row(
        'Largest acceleration of each joint, with joint_trajectory', 'rad/s^2', 0.1, 300.0)] = 60.0
    joint_jerk: Annotated[float, Row(
        'Largest jerk of each joint, with joint_trajectory', 'rad/s^3', 1.0, 1e6)] = 6000.0
    workspace_min: Annotated[Array, Row(
        'Lower corner, in base, of the box that ft_sensor and the tip stay in; with '
        'joint_trajectory checked in motion only', 'm', shape=(3,))
        ] = (0.6, -0.4, 0.6)  # type: ignore[assignment]
    workspace_max: Annotated[Array, Row(
        'Upper corner of that box', 'm', shape=(3,))
        ] = (1.3, 0.4, 1.4)  # type: ignore[assignment]
    tip: Annotated[Array, Row(
        "The tool's foremost point in ft_sensor", 'm', shape=(3,))
        ] = (0.2, 0.0, 0.1)  # type: ignore[assignment]
    force: Annotated[float, Row(
        'Norm of the force, weight included, above which no motion starts or continues',
        'N', 1.0, 1e5)] = 250.0
    torque: Annotated[float, Row(
        'Norm of the torque above which no motion starts or continues', 'N m', 0.1, 1e4)] = 60.0
    tracking_error: Annotated[float, Row(
        'Error of the position above which the motion stops',
        'm', 0.0005, 1.0)] = 0.02
    tracking_angle: Annotated[float, Row(
        'Error of the orientation above which the motion stops; with joint_trajectory, of each '
        'joint',
        'rad', 0.005, 3.0)] = 0.2
    overspeed: Annotated[float, Row(
        'Factor by which measured speed, acceleration and jerk may exceed the limits',
        low=1.0, high=10.0)] = 1.5
    stop_duration: Annotated[float, Row(
        'Duration from the first command of a stop to rest', 's', 0.01, 0.5)] = 0.045

    def __post_init__(self) -> None:
        super().__post_init__()
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
                f'{self.stop_duration:g} s at {above(needed, getattr(self, limit))}, above '
                f'limits.{limit} {getattr(self, limit):g}; lower limits.{speed}')


def check_move(move: Move | JointMove, limits: Limits, name: str = 'the move') -> None:
    """
    Refuse a move that would exceed a limit, a stop at any instant of it included.

    Parameters
    ----------
    name : str
        What to call it in the message.

    Raises
    ------
    MotionError
        With the number, the limit and its key, and the joint.
    """
    if isinstance(move, JointMove):
        joint = int(np.argmax(np.abs(move.displacement)))
        distance = float(np.abs(move.displacement[joint]))
        peaks = [distance * one for one in peak_rates(move.duration, limits.stop_duration)]
        check_rates(peaks, limits, name, JOINT_RATES, f' of joint {joint + 1}')
        return
    check_rates(_peaks(move, limits), limits, name)
    positions, rotations = move.poses()
    check_workspace(positions, limits, f'{name}: the sensor')
    check_workspace(positions + rotations @ limits.tip, limits, f'{name}: the tip')


RATES = (('speed', 'm/s'), ('acceleration', 'm/s^2'), ('jerk', 'm/s^3'),
         ('angular_speed', 'rad/s'), ('angular_acceleration', 'rad/s^2'),
         ('angular_jerk', 'rad/s^3'))
"""Keys of the limits of rates, and their units."""


JOINT_RATES = (('joint_speed', 'rad/s'), ('joint_acceleration', 'rad/s^2'),
               ('joint_jerk', 'rad/s^3'))
"""The same of a joint."""


def rate_limits(limits: Limits) -> tuple[float, ...]:
    """Return the limits of all ``RATES``."""
    return tuple(getattr(limits, key) for key, _ in RATES)


def check_rates(peaks: Sequence[float], limits: Limits, name: str,
                rates: Sequence[tuple[str, str]] = RATES, of: str = '') -> None:
    """
    Refuse peaks of these rates above the limits; ``of`` is whose they are.

    Raises
    ------
    MotionError
        With the number, the limit and its key.
    """
    for (key, unit), planned in zip(rates, peaks):
        limit = getattr(limits, key)
        if not planned <= limit:
            raise MotionError(f'{name} needs {above(planned, limit, 4)} {unit}{of}, limits.{key} '
                              f'is {limit:g} {unit}; give it more time')


def _peaks(move: Move, limits: Limits) -> tuple[float, ...]:
    """Return the planned peaks of all ``RATES``, a stop at any instant included."""
    peak = peak_rates(move.duration, limits.stop_duration)
    return tuple(size * rate for size in (move.distance, move.angle) for rate in peak)


def share_allowed(move: Move, limits: Limits) -> float:
    """Return the share of a move's distance and angle, at most 1, that its duration allows."""
    return min([1.0, *(MARGIN * limit / planned for planned, limit in zip(
        _peaks(move, limits), rate_limits(limits)) if planned > limit)])


def pace_within(limits: Limits, pace: Pace = Pace()) -> Pace:
    """Return a pace that keeps the limits."""
    return Pace(*(min(one, MARGIN * getattr(limits, name))
                  for name, one in zip(Pace._fields, pace)))


def check_workspace(points: Array, limits: Limits, name: str) -> None:
    """
    Refuse points outside the box.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In base [m].
    name : str
        What to call them in the message.

    Raises
    ------
    MotionError
        With the farthest point, the face and its key.
    """
    for key, side, bound, beyond in (
            ('workspace_min', below, limits.workspace_min, limits.workspace_min - points),
            ('workspace_max', above, limits.workspace_max, points - limits.workspace_max)):
        i, axis = np.unravel_index(np.argmax(beyond), beyond.shape)
        if not beyond[i, axis] <= 0:
            raise MotionError(
                f'{name} would reach {"xyz"[axis]} = {side(points[i, axis], bound[axis], 4)} m, '
                f'limits.{key} is {bound[axis]:g} m there; move the pose')
