"""Motion from rest to rest: quintic profiles, and the stop that keeps to their path.

Position goes along a straight line, orientation along the geodesic, both with the same
minimum-jerk fraction s(t). A stop slows the time that the path is followed in, so every pose
commanded on the way to rest lies on the path that was checked.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from forcecal_ros.errors import MotionError
from forcecal_ros.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.schema import Row
import numpy as np

PEAK_SPEED = 15 / 8
"""Peak of ds/dt of the quintic, times its duration."""

PEAK_ACCELERATION = 10 / np.sqrt(3)
"""Peak of d2s/dt2 of the quintic, times its duration squared."""

PEAK_JERK = 60.0
"""Peak of d3s/dt3 of the quintic, times its duration cubed."""

PEAK_STOP = 1.5
"""Peak deceleration of a stop, times its duration, of unit speed."""

PEAK_STOP_JERK = 6.0
"""Peak jerk of a stop, times its duration squared, of unit speed."""

SHORTEST_MOVE = 0.1
"""A move lasts at least that long [s]."""

LARGEST_ROTATION = np.radians(175.0)
"""Above it noise would choose the way round [rad]."""


class Pose(NamedTuple):
    """Position [m] of ft_sensor in base, shape (3,), and ``R_base_sensor``, shape (3, 3)."""

    position: Array
    R_base_sensor: Array


class Setpoint(NamedTuple):
    """
    What is commanded at one instant.

    Attributes
    ----------
    pose : Pose
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


def hold(pose: Pose) -> Setpoint:
    """Return the setpoint that stays where it is."""
    return Setpoint(pose, np.zeros(3), np.zeros(3))


def quintic(tau: Array | float) -> tuple[Array, Array, Array]:
    """
    Minimum-jerk fraction from rest to rest.

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
    Path time while a stop is under way: it runs at unit rate before and rests after.

    Parameters
    ----------
    tau : array_like
        Time since the stop began, in units of its duration; held beyond 0 and 1.

    Returns
    -------
    tuple of ndarray
        Path time since the stop began, in units of the duration; its first and second derivative.
    """
    x = np.clip(np.asarray(tau, dtype=float), 0.0, 1.0)
    return x - x**3 + x**4 / 2, 1 - x**2 * (3 - 2 * x), -6 * x * (1 - x)


@dataclass(frozen=True)
class Move:
    """
    From one pose to another in a given time.

    Attributes
    ----------
    start, goal : Pose
    duration : float
        [s]
    """

    start: Pose
    goal: Pose
    duration: float

    @cached_property
    def line(self) -> Array:
        """From start to goal in base, shape (3,) [m]."""
        return self.goal.position - self.start.position

    @cached_property
    def turn(self) -> Array:
        """
        Rotation vector from start to goal in the sensor's frame, shape (3,) [rad].

        Raises
        ------
        MotionError
            The rotation is so close to half a turn that noise would choose the way round.
        """
        turn = rotation_vector(self.start.R_base_sensor.T @ self.goal.R_base_sensor)
        angle = float(np.linalg.norm(turn))
        if angle > LARGEST_ROTATION:
            raise MotionError(f'a rotation by {np.degrees(angle):.1f} deg has no clear way round '
                              f'(at most {np.degrees(LARGEST_ROTATION):.0f} deg); put a pose '
                              'between the two')
        return turn

    @cached_property
    def distance(self) -> float:
        """Length of the line [m]."""
        return float(np.linalg.norm(self.line))

    @cached_property
    def angle(self) -> float:
        """Angle of the rotation [rad]."""
        return float(np.linalg.norm(self.turn))

    def peak_acceleration_at(self, lever: float) -> float:
        """Most that a point ``lever`` [m] away from ft_sensor's origin accelerates [m/s^2]."""
        turning = np.hypot(PEAK_ACCELERATION, PEAK_SPEED**2 * self.angle) * self.angle
        return float((self.distance * PEAK_ACCELERATION + lever * turning) / self.duration**2)

    def at(self, t: float, rate: float = 1.0) -> Setpoint:
        """
        Setpoint at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        rate : float
            Of the path's time, below 1 while stopping.

        Returns
        -------
        Setpoint
        """
        s, ds, _ = (float(v) for v in quintic(t / self.duration))
        speed = ds / self.duration * rate
        start = self.start
        if s == 1.0:
            pose = self.goal
        else:
            pose = Pose(start.position + s * self.line,
                        start.R_base_sensor @ rotation_from_vector(s * self.turn))
        return Setpoint(pose, self.line * speed, start.R_base_sensor @ self.turn * speed)

    def poses(self, n: int = 101) -> tuple[Array, Array]:
        """Return ``n`` poses along the path, ends included: (n, 3) [m] and (n, 3, 3)."""
        s = np.linspace(0.0, 1.0, n)[:, None]
        return (self.start.position + s * self.line,
                self.start.R_base_sensor @ rotation_from_vector(s * self.turn))


def twist_towards(setpoint: Setpoint, measured: Pose, gain: float) -> tuple[Array, Array]:
    """
    Velocities that follow a setpoint, for robots that are told velocities.

    At rest they are exactly zero: a robot that was told to stand shall not follow noise.

    Parameters
    ----------
    setpoint : Setpoint
    measured : Pose
    gain : float
        Of what is missing of the way [1/s].

    Returns
    -------
    tuple of ndarray, shapes (3,), (3,)
        Velocity of ft_sensor's origin [m/s] and angular velocity [rad/s], in base.
    """
    if not setpoint.moving:
        return np.zeros(3), np.zeros(3)
    missing = rotation_vector(setpoint.pose.R_base_sensor @ measured.R_base_sensor.T)
    return (setpoint.velocity + gain * (setpoint.pose.position - measured.position),
            setpoint.angular_velocity + gain * missing)


class Pace(NamedTuple):
    """Peaks a planned move makes use of, below the limits: SI units as in :class:`Limits`."""

    speed: Annotated[float, Row('Peak speed of moves between poses', 'm/s', 0.001, 2.0)] = 0.2
    acceleration: Annotated[float, Row('Peak acceleration of those', 'm/s^2', 0.01, 20.0)] = 2.0
    angular_speed: Annotated[float, Row('Peak angular speed of those', 'rad/s', 0.01, 5.0)] = 1.45
    angular_acceleration: Annotated[float, Row(
        'Peak angular acceleration of those', 'rad/s^2', 0.1, 100.0)] = 8.0


def shortest_duration(start: Pose, goal: Pose, pace: Pace) -> float:
    """
    Time of the quintic that keeps to the pace.

    Parameters
    ----------
    start, goal : Pose
    pace : Pace

    Returns
    -------
    float
        [s], at least ``SHORTEST_MOVE``.
    """
    move = Move(start, goal, 1.0)
    return max(SHORTEST_MOVE,
               PEAK_SPEED * move.distance / pace.speed,
               PEAK_SPEED * move.angle / pace.angular_speed,
               float(np.sqrt(PEAK_ACCELERATION * move.distance / pace.acceleration)),
               float(np.sqrt(PEAK_ACCELERATION * move.angle / pace.angular_acceleration)))


class PeakRates(NamedTuple):
    """Peaks of |ds/dt| [1/s], |d2s/dt2| [1/s^2] and |d3s/dt3| [1/s^3] of a quintic's fraction."""

    speed: float
    acceleration: float
    jerk: float


def peak_rates(duration: float, stop_duration: float) -> PeakRates:
    """
    Worst rates of a quintic's fraction, a stop at any instant of it included.

    Parameters
    ----------
    duration, stop_duration : float
        [s]

    Returns
    -------
    PeakRates
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
    return PeakRates(float(rate.max()),
                     max(float(np.abs(acceleration).max()),
                         float(PEAK_ACCELERATION) / duration**2),
                     max(float(np.abs(jerk).max()), PEAK_JERK / duration**3))
