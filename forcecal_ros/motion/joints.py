"""Motion of joint vectors, for robots that are told joints: the same quintic and the same stop."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.motion.profiles import (
    Pace,
    PEAK_ACCELERATION,
    PEAK_SPEED,
    quintic,
    SHORTEST_MOVE,
)
import numpy as np


class JointSetpoint(NamedTuple):
    """Joint positions [rad] or [m] and their rates [1/s], shape (n,), commanded at one instant."""

    positions: Array
    velocities: Array

    @property
    def moving(self) -> bool:
        """Whether any velocity is commanded."""
        return bool(self.velocities.any())


def hold_joints(positions: Array) -> JointSetpoint:
    """Return the setpoint that stays where it is."""
    return JointSetpoint(positions, np.zeros(len(positions)))


@dataclass(frozen=True)
class JointMove:
    """
    From one joint vector to another in a given time.

    Attributes
    ----------
    start, goal : ndarray, shape (n,)
        [rad] or [m]
    duration : float
        [s]
    """

    start: Array
    goal: Array
    duration: float

    @cached_property
    def way(self) -> Array:
        """From start to goal, shape (n,)."""
        return self.goal - self.start

    def at(self, t: float, rate: float = 1.0) -> JointSetpoint:
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
        JointSetpoint
        """
        s, ds, _ = (float(v) for v in quintic(t / self.duration))
        return JointSetpoint(self.start + s * self.way, self.way * (ds / self.duration * rate))


def shortest_joint_duration(start: Array, goal: Array, pace: Pace) -> float:
    """Return the time of the quintic that keeps to the angular pace on every joint [s]."""
    way = float(np.abs(goal - start).max())
    return max(SHORTEST_MOVE, PEAK_SPEED * way / pace.angular_speed,
               float(np.sqrt(PEAK_ACCELERATION * way / pace.angular_acceleration)))
