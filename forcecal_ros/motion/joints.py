"""Motion of joint vectors, for robots that are commanded by joint: the same quintic and stop."""

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
    """Return the setpoint at rest at some joint positions."""
    return JointSetpoint(positions, np.zeros(len(positions)))


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


def shortest_joint_duration(start: Array, goal: Array, pace: Pace) -> float:
    """Return the time of the quintic that keeps to the angular pace on every joint [s]."""
    farthest = float(np.abs(goal - start).max())
    return max(SHORTEST_MOVE, PEAK_SPEED * farthest / pace.angular_speed,
               float(np.sqrt(PEAK_ACCELERATION * farthest / pace.angular_acceleration)))
