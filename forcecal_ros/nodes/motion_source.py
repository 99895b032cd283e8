"""The interface of what makes the commands of a node that moves a robot."""

from typing import Protocol

from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import WatchSettings


class MotionSettings(Protocol):
    """Settings of one motion; each node adds its own."""

    @property
    def limits(self) -> Limits:
        """Limits of the measured motion."""

    @property
    def watch(self) -> WatchSettings:
        """When a sensor counts as silent, late or frozen."""


class MotionStatus(Protocol):
    """State of a motion."""

    @property
    def phase(self) -> str:
        """A phase word: ``idle``, ``done``, ``aborted``, or of the motion's own."""

    @property
    def reason(self) -> str:
        """Why it was aborted."""


class MotionSource(Protocol):
    """Maker of commands, one a period, from a start to done or aborted."""

    @property
    def status(self) -> MotionStatus:
        """State of the motion."""

    @property
    def running(self) -> bool:
        """Whether a motion is under way, until its result is there."""

    @property
    def streaming(self) -> bool:
        """Whether there are commands to send."""

    @property
    def guarded(self) -> bool:
        """Whether a fault aborts it."""

    @property
    def moving(self) -> bool:
        """Whether the last command moves."""

    def abort(self, reason: str, *, at_once: bool = False) -> bool:
        """Begin to come to rest; ``at_once``: the robot rests already. False: nothing moves."""

    def pause(self, paused: bool) -> None:
        """Pause, or go on."""

    def restart(self) -> None:
        """Start again from rest, after a silence in which the robot came to a stop."""
