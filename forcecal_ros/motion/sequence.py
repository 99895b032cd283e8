"""The sequencer's state machine: periods of the command stream in, commands and phase out.

It knows neither clocks nor messages. Whoever owns the stream calls :meth:`Sequence.step` once a
period and sends what comes back; a call that comes late stretches the motion and never makes the
robot jump.
"""

from collections.abc import Sequence as Parts
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.errors import MotionError
from forcecal_ros.motion.joints import hold_joints, JointSetpoint
from forcecal_ros.motion.monitor import Stillness
from forcecal_ros.motion.plan import expected_duration, Goal, Part
from forcecal_ros.motion.profiles import hold, Pose, Setpoint, stop_time

Command = Setpoint | JointSetpoint


@dataclass(frozen=True)
class StreamSettings:
    """
    How the command stream runs.

    Attributes
    ----------
    rate : float
        Commands a second [Hz].
    stop_duration : float
        From a stop's first command to rest [s].
    closing : float
        A stream ends with commands at rest for that long [s].
    settle_minimum : float
        Settling takes at least that long [s]: the stillness window and the sensors' latency.
    settle_timeout : float
        The sequence is aborted where the tool is not still by then [s].
    """

    rate: float = 250.0
    stop_duration: float = 0.045
    closing: float = 0.1
    settle_minimum: float = 0.3
    settle_timeout: float = 6.0


class Status(NamedTuple):
    """Where a sequence is: phase word, what for, why it was aborted, how far it got (0 to 1)."""

    phase: str = 'idle'
    label: str = ''
    reason: str = ''
    progress: float = 0.0


class PathRate(NamedTuple):
    """
    How fast the time of the path runs: 1 in motion, 0 at rest, and smoothly in between.

    Attributes
    ----------
    periods : float
        From one to the other, in periods of the stream.
    start, target : float
        Between which it changes.
    elapsed : int
        Periods since it began to.
    """

    periods: float
    start: float = 1.0
    target: float = 1.0
    elapsed: int = 0

    @property
    def value(self) -> float:
        """The rate."""
        _, remaining, _ = stop_time(self.elapsed / self.periods)
        return self.target + (self.start - self.target) * float(remaining)

    def towards(self, target: float) -> 'PathRate':
        """Begin to change to ``target``, unless that is under way."""
        if target == self.target:
            return self
        return PathRate(self.periods, self.value, target)

    def stepped(self) -> 'PathRate':
        """Return the rate one period later."""
        return self._replace(elapsed=self.elapsed + 1) if self.start != self.target else self


class Sequence:
    """
    One robot's sequence, from ``idle`` to ``done`` or ``aborted`` and again.

    Parameters
    ----------
    settings : StreamSettings
    """

    def __init__(self, settings: StreamSettings) -> None:
        self.settings = settings
        self._period = 1.0 / settings.rate
        self._parts: tuple[Part, ...] = ()
        self._rest: Goal | None = None
        self._last: Command | None = None
        self._index = 0
        self._time = 0.0
        self._rate = PathRate(settings.stop_duration * settings.rate)
        self._closing = 0
        self._ending = ''
        self._streaming = False
        self._ended = 0.0
        self._expected = 1.0
        self.status = Status()

    @property
    def running(self) -> bool:
        """Whether a sequence is under way, its identification included."""
        return self.status.phase not in ('idle', 'done', 'aborted')

    @property
    def streaming(self) -> bool:
        """Whether :meth:`step` has commands to give."""
        return self._streaming

    @property
    def guarded(self) -> bool:
        """Whether a fault ends it: from the start to the end of the motion."""
        return self.running and not self.moved

    @property
    def moving(self) -> bool:
        """Whether the last command moves."""
        return self._last is not None and self._last.moving

    @property
    def moved(self) -> bool:
        """Whether the motion is over and waits for its result."""
        return self.running and self._index == len(self._parts)

    @property
    def settling(self) -> bool:
        """Whether the tool has to become still before it goes on."""
        return self.running and not self.moved and self._parts[self._index].duration is None

    def start(self, parts: Parts[Part], start: Goal, ending: str = 'identification') -> None:
        """
        Begin a plan that :func:`forcecal_ros.motion.plan.prepare` has checked.

        Parameters
        ----------
        parts : sequence of Part
        start : Pose or ndarray
            Where the robot stands: the first command.
        ending : str
            What for it waits after the motion, until :meth:`finish`.

        Raises
        ------
        MotionError
            One is under way already.
        """
        if self.running or self._streaming:
            raise MotionError(f'a sequence is under way already ({self.status.phase} '
                              f'{self.status.label}); abort it first')
        self._parts, self._rest, self._ending = tuple(parts), start, ending
        self._streaming, self._closing, self._ended, self._last = True, 0, 0.0, None
        self._period = 1.0 / self.settings.rate
        self._rate = PathRate(self.settings.stop_duration * self.settings.rate)
        self._expected = expected_duration(parts, self.settings.settle_minimum)
        self._enter(0)

    def abort(self, reason: str, *, at_once: bool = False) -> bool:
        """
        Stop: from the next step on the commands come to rest along the path they are on.

        Parameters
        ----------
        reason : str
            One line for the user.
        at_once : bool
            Hold the last command instead, for a stream that was silent so long that the robot
            stands at it.

        Returns
        -------
        bool
            False where nothing was under way.
        """
        if not self.running:
            return False
        self._rate = self._rate.towards(0.0)
        if at_once and self._closing == 0 and self._last is not None:
            self._hold_at(self._last)
        self.status = self.status._replace(phase='aborted', reason=reason)
        return True

    def pause(self, paused: bool) -> None:
        """Come to rest on the path and wait there, or go on; smoothly, within a stop's time."""
        if self.running:
            self._rate = self._rate.towards(0.0 if paused else 1.0)

    def restart(self) -> None:
        """Take up speed from rest, after a silence in which the robot came to stand."""
        if self._streaming and self._closing == 0:
            self._rate = PathRate(self._rate.periods, 0.0, self._rate.target)

    def finish(self) -> None:
        """Say that the result of a finished motion is there."""
        if self.moved:
            self.status = Status('done', progress=1.0)

    def step(self, stillness: Stillness | None = None) -> Command | None:
        """
        Advance by one period of the stream.

        Parameters
        ----------
        stillness : Stillness or None
            Verdict on the tool, wanted while :attr:`settling`.

        Returns
        -------
        Setpoint, JointSetpoint or None
            What to send; None where the stream is silent.
        """
        if not self._streaming:
            return None
        if self._closing:
            self._last = self._close()
        else:
            self._last = self._follow(stillness)
        return self._last

    def _enter(self, index: int) -> None:
        self._index, self._time = index, -self._period
        if index < len(self._parts):
            segment = self._parts[index].segment
            self.status = Status(segment.phase, segment.label, '', self._progress())
        else:
            self.status = Status('settle', self._ending, '', 1.0)
            self._begin_closing()

    def _progress(self) -> float:
        return min(1.0, (self._ended + max(0.0, self._time)) / self._expected)

    def _begin_closing(self) -> None:
        self._closing = max(2, round(self.settings.closing * self.settings.rate))

    def _follow(self, stillness: Stillness | None) -> Command:
        part = self._parts[self._index]
        before = self._rate.value
        self._rate = self._rate.stepped()
        rate = self._rate.value
        self._time += self._period * (before + rate) / 2
        command = self._holding()
        if part.move is not None and self._time > 0.0:
            command = part.move.at(self._time, rate)
        if self.status.phase == 'aborted':
            if not command.moving:
                self._hold_at(command)
                return self._holding()
        elif part.duration is None:
            self._settle(stillness)
        elif self._time >= part.duration - 1e-9:
            self._rest = part.goal
            self._ended += part.duration
            self._enter(self._index + 1)
        self.status = self.status._replace(progress=self._progress())
        return command

    def _settle(self, stillness: Stillness | None) -> None:
        if self._time < self.settings.settle_minimum or stillness is None:
            return
        if stillness.still:
            self._ended += self.settings.settle_minimum
            self._enter(self._index + 1)
        elif self._time >= self.settings.settle_timeout:
            self.abort(f'not still {self._time:.1f} s after the move to {self.status.label}: '
                       f'{stillness.detail}; look for vibration, or raise settle.factor')

    def _hold_at(self, command: Command) -> None:
        self._rest = command.pose if isinstance(command, Setpoint) else command.positions
        self._begin_closing()

    def _holding(self) -> Command:
        assert self._rest is not None
        return hold(self._rest) if isinstance(self._rest, Pose) else hold_joints(self._rest)

    def _close(self) -> Command:
        self._closing -= 1
        self._streaming = self._closing > 0
        return self._holding()
