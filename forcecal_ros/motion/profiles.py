"""
Motion from rest to rest: quintic profiles, and the stop that keeps to their path.

Position goes along a straight line, orientation along the geodesic, both with the same
minimum-jerk path parameter s(t). A stop scales the time of the path down to a standstill, so that
every pose commanded until then lies on the path that was checked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from forcecal_ros.core.errors import ConfigError, DataError, MotionError
from forcecal_ros.core.geometry import (
    Array,
    matrix_from_quaternion,
    POSE_LENGTH,
    quaternion_from_matrix,
    rotation_about,
    rotation_from_vector,
    rotation_vector,
)
from forcecal_ros.core.schema import Row
from forcecal_ros.core.streams import Recording
import numpy as np
from numpy.typing import ArrayLike

PEAK_SPEED = 15 / 8
"""Peak of ds/dt of the quintic, times its duration."""

PEAK_ACCELERATION = 10 / np.sqrt(3)
"""Peak of d2s/dt2 of the quintic, times its duration squared."""


PEAK_STOP = 1.5
"""Peak deceleration of a stop from unit speed, times its duration."""

PEAK_STOP_JERK = 6.0
"""Peak jerk of a stop from unit speed, times its duration squared."""

SHORTEST_MOVE = 0.1
"""Least duration of a move that is timed by its pace: 25 commands at 250 Hz [s]."""

LARGEST_ROTATION = np.radians(175.0)
"""Largest rotation of a move: nearer to half a turn noise would choose its direction [rad]."""


class Pose(NamedTuple):
    """Position [m] of ft_sensor in base, shape (3,), and ``R_base_sensor``, shape (3, 3)."""

    position: Array
    R_base_sensor: Array


class Setpoint(NamedTuple):
    """
    What is commanded at one instant.

    Attributes
    ----------
    velocity : ndarray, shape (3,)
        Of the origin of ft_sensor, in base [m/s].
    angular_velocity : ndarray, shape (3,)
        In base [rad/s].
    """

    pose: Pose
    velocity: Array
    angular_velocity: Array

    @property
    def moving(self) -> bool:
        """Whether any velocity is commanded."""
        return bool(self.velocity.any() or self.angular_velocity.any())


def quintic(tau: Array | float) -> tuple[Array, Array, Array]:
    """
    Return the minimum-jerk path parameter from rest to rest.

    Parameters
    ----------
    tau : array_like
        Time in units of the duration; held beyond 0 and 1.

    Returns
    -------
    tuple of ndarray
        s, ds/dtau, d2s/dtau2.
    """
    x = np.clip(np.asarray(tau, dtype=float), 0.0, 1.0)
    return (x**3 * (10 - 15 * x + 6 * x**2),
            30 * (x * (1 - x))**2,
            60 * x * (1 - x) * (1 - 2 * x))


def stop_time(tau: Array | float) -> tuple[Array, Array, Array]:
    """
    Return the time of the path during a stop, before which it runs and after which it stands.

    Parameters
    ----------
    tau : array_like
        Time since the stop began, in units of its duration; held beyond 0 and 1.

    Returns
    -------
    tuple of ndarray
        It since the stop began, in units of the duration, and its first two derivatives.
    """
    x = np.clip(np.asarray(tau, dtype=float), 0.0, 1.0)
    return x - x**3 + x**4 / 2, 1 - x**2 * (3 - 2 * x), -6 * x * (1 - x)


@dataclass(frozen=True)
class Move:
    """From one pose to another in a given time [s]."""

    start: Pose
    goal: Pose
    duration: float

    @cached_property
    def displacement(self) -> Array:
        """From start to goal in base, shape (3,) [m]."""
        return self.goal.position - self.start.position

    @cached_property
    def turn(self) -> Array:
        """
        Rotation vector from start to goal in the sensor's frame, shape (3,) [rad].

        Raises
        ------
        MotionError
            The rotation is so close to half a turn that noise would choose its direction.
        """
        turn = rotation_vector(self.start.R_base_sensor.T @ self.goal.R_base_sensor)
        angle = float(np.linalg.norm(turn))
        if angle > LARGEST_ROTATION:
            raise MotionError(f'a rotation by {np.degrees(angle):.1f} deg is too close to half a '
                              f'turn (at most {np.degrees(LARGEST_ROTATION):.0f} deg); add a pose '
                              'between the two')
        return turn

    @cached_property
    def distance(self) -> float:
        """Length of the displacement [m]."""
        return float(np.linalg.norm(self.displacement))

    @cached_property
    def angle(self) -> float:
        """Angle of the rotation [rad]."""
        return float(np.linalg.norm(self.turn))

    @property
    def peak_speeds(self) -> tuple[float, float]:
        """Largest speed [m/s] and angular speed [rad/s]."""
        return PEAK_SPEED * self.distance / self.duration, PEAK_SPEED * self.angle / self.duration

    def peak_acceleration_at(self, lever: float) -> float:
        """Return a bound on the acceleration of a point ``lever`` [m] from the origin [m/s^2]."""
        turning = np.hypot(PEAK_ACCELERATION, PEAK_SPEED**2 * self.angle) * self.angle
        return float((self.distance * PEAK_ACCELERATION + lever * turning) / self.duration**2)

    def at(self, t: float, time_scale: float = 1.0) -> Setpoint:
        """
        Return the setpoint at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        time_scale : float
            Rate of the path's time, below 1 while stopping.
        """
        s, ds, _ = (float(v) for v in quintic(t / self.duration))
        speed = ds / self.duration * time_scale
        start = self.start
        if s == 1.0:
            pose = self.goal
        else:
            pose = Pose(start.position + s * self.displacement,
                        start.R_base_sensor @ rotation_from_vector(s * self.turn))
        return Setpoint(pose, self.displacement * speed, start.R_base_sensor @ self.turn * speed)

    def poses(self, n: int = 101) -> tuple[Array, Array]:
        """Return ``n`` poses along the path, ends included: (n, 3) [m] and (n, 3, 3)."""
        s = np.linspace(0.0, 1.0, n)[:, None]
        return (self.start.position + s * self.displacement,
                self.start.R_base_sensor @ rotation_from_vector(s * self.turn))


def twist_towards(setpoint: Setpoint, measured: Pose, gain: float) -> tuple[Array, Array]:
    """
    Return the twist that follows a setpoint, for robots that are commanded by velocity.

    At rest it is exactly zero: a robot at rest must not follow noise.

    Parameters
    ----------
    gain : float
        Of the pose error [1/s].

    Returns
    -------
    tuple of ndarray, shapes (3,), (3,)
        Velocity of ft_sensor's origin [m/s] and angular velocity [rad/s], in base.
    """
    if not setpoint.moving:
        return np.zeros(3), np.zeros(3)
    rotation = rotation_vector(setpoint.pose.R_base_sensor @ measured.R_base_sensor.T)
    return (setpoint.velocity + gain * (setpoint.pose.position - measured.position),
            setpoint.angular_velocity + gain * rotation)


class Pace(NamedTuple):
    """Peaks that planned moves aim at, below the limits; the names are the parameters' keys."""

    speed: Annotated[float, Row('Peak speed of moves between poses', 'm/s', 0.001, 2.0)] = 0.2
    acceleration: Annotated[float, Row(
        'Peak acceleration of moves between poses', 'm/s^2', 0.01, 20.0)] = 2.0
    angular_speed: Annotated[float, Row(
        'Peak angular speed of moves between poses', 'rad/s', 0.01, 5.0)] = 1.45
    angular_acceleration: Annotated[float, Row(
        'Peak angular acceleration of moves between poses', 'rad/s^2', 0.1, 100.0)] = 8.0


def shortest_duration(start: Pose | Array, goal: Pose | Array, pace: Pace) -> float:
    """
    Return the time of the quintic that keeps to the pace, at least ``SHORTEST_MOVE`` [s].

    Every joint of joint vectors keeps to the angular pace.
    """
    if isinstance(start, Pose) and isinstance(goal, Pose):
        move = Move(start, goal, 1.0)
        distance, angle = move.distance, move.angle
    else:
        distance, angle = 0.0, float(np.abs(np.subtract(goal, start)).max())
    return max(SHORTEST_MOVE,
               PEAK_SPEED * distance / pace.speed,
               PEAK_SPEED * angle / pace.angular_speed,
               float(np.sqrt(PEAK_ACCELERATION * distance / pace.acceleration)),
               float(np.sqrt(PEAK_ACCELERATION * angle / pace.angular_acceleration)))


def peak_rates(duration: float, stop_duration: float) -> tuple[float, float, float]:
    """
    Return the peak rates of a quintic of some duration [s], with a stop at any instant.

    Returns
    -------
    tuple of float
        Peaks of |ds/dt| [1/s], |d2s/dt2| [1/s^2] and |d3s/dt3| [1/s^3] of the path parameter.
    """
    begin = np.linspace(0.0, duration, 81)[:, None]
    stopped = np.linspace(0.0, 1.0, 41)
    u, du, ddu = stop_time(stopped)
    tau = np.minimum((begin + u * stop_duration) / duration, 1.0)
    _, ds, dds = quintic(tau)
    rate, change, ddds = ds / duration, dds / duration**2, 60 * (1 - 6 * tau * (1 - tau))
    acceleration = change * du**2 + rate * ddu / stop_duration
    jerk = (ddds / duration**3 * du**3 + 3 * change * du * ddu / stop_duration
            + rate * (12 * stopped - 6) / stop_duration**2)
    return (float(rate.max()),
            max(float(np.abs(acceleration).max()), float(PEAK_ACCELERATION) / duration**2),
            max(float(np.abs(jerk).max()), 60.0 / duration**3))


class JointSetpoint(NamedTuple):
    """Joint positions [rad] or [m] and their rates [1/s], shape (n,), commanded at one instant."""

    positions: Array
    velocities: Array

    @property
    def moving(self) -> bool:
        """Whether any velocity is commanded."""
        return bool(self.velocities.any())


def hold(goal: Pose | Array) -> Setpoint | JointSetpoint:
    """Return the setpoint at rest at a pose, or at joint positions (n,)."""
    if isinstance(goal, Pose):
        return Setpoint(goal, np.zeros(3), np.zeros(3))
    return JointSetpoint(goal, np.zeros(len(goal)))


@dataclass(frozen=True)
class JointMove:
    """From one joint vector, shape (n,) [rad] or [m], to another in a given time [s]."""

    start: Array
    goal: Array
    duration: float

    @cached_property
    def displacement(self) -> Array:
        """From start to goal, shape (n,) [rad] or [m]."""
        return self.goal - self.start

    def at(self, t: float, time_scale: float = 1.0) -> JointSetpoint:
        """
        Return the setpoint at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        time_scale : float
            Rate of the path's time, below 1 while stopping.
        """
        s, ds, _ = (float(v) for v in quintic(t / self.duration))
        speed = ds / self.duration * time_scale
        return JointSetpoint(self.start + s * self.displacement, self.displacement * speed)


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
            f'{len(names)} poses ({", ".join(names)}) require different names and '
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


def reach_of(recording: Recording, tip: Array) -> tuple[Pose, Array, Array]:
    """
    Return where the robot of a recording has been.

    Parameters
    ----------
    tip : ndarray, shape (3,)
        The tool's foremost point in ft_sensor [m].

    Returns
    -------
    Pose and two ndarray, shape (3,)
        First pose, and lower and upper corner in base of what sensor and tip went through [m].

    Raises
    ------
    DataError
        It holds no poses with positions.
    """
    pose = recording.pose
    if pose is None or not len(pose) or not pose.has_position:
        raise DataError(f'{recording.source or "the recording"} holds no positions of the sensor, '
                        'which give home and box; give --home and '
                        '--set limits.workspace_min/max instead')
    points = np.concatenate([pose.position, pose.position + pose.R_base_sensor @ tip])
    return (Pose(pose.position[0], pose.R_base_sensor[0]),
            points.min(axis=0), points.max(axis=0))
