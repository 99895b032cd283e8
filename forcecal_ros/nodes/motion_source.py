"""What makes the commands of a node that moves a robot, as such a node sees it."""

from typing import Protocol

from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings


class MotionSettings(Protocol):
    """What one start runs with; each node adds its own."""

    @property
    def limits(self) -> Limits:
        """What is measured may not exceed them."""

    @property
    def watch(self) -> WatchSettings:
        """When a sensor counts as lost."""


class MotionStatus(Protocol):
    """Where a motion is."""

    @property
    def phase(self) -> str:
        """A phase word: ``idle``, ``done``, ``aborted``, or of the motion's own."""

    @property
    def reason(self) -> str:
        """Why it was aborted."""


class MotionSource(Protocol):
    """What makes the commands, one a period, from a start to done or aborted."""

    @property
    def status(self) -> MotionStatus:
        """Where it is."""

    @property
    def running(self) -> bool:
        """Whether a motion is under way, until its result is there."""

    @property
    def streaming(self) -> bool:
        """Whether there are commands to send."""

    @property
    def guarded(self) -> bool:
        """Whether a fault ends it."""

    @property
    def moving(self) -> bool:
        """Whether the last command moves."""

    def abort(self, reason: str, *, at_once: bool = False) -> bool:
        """Begin to come to rest; ``at_once``: the robot stands already. False: nothing to end."""

    def pause(self, paused: bool) -> None:
        """Stand for a while, or go on."""

    def restart(self) -> None:
        """Take up speed from rest, after a silence in which the robot came to stand."""
