"""The sequencer's state machine and its clock: periods in, commands and phase out.

It knows neither clocks nor messages. The owner of the stream calls :meth:`MotionSequence.step`
once a period and sends what it returns; a late call stretches the motion and never makes the robot
jump.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.core.errors import MotionError
from forcecal_ros.motion.monitor import Stillness
from forcecal_ros.motion.plan import expected_duration, Goal, PlannedSegment
from forcecal_ros.motion.profiles import (
    hold,
    JointSetpoint,
    Setpoint,
    stop_time,
)

Command = Setpoint | JointSetpoint


@dataclass(frozen=True)
class StreamSettings:
    """
    How the command stream runs.

    Attributes
    ----------
    rate : float
        Commands per second [Hz].
    stop_duration : float
        From a stop's first command to rest [s].
    closing : float
        Duration of the commands at rest that end the stream [s].
    settle_minimum : float
        Least duration of settling [s]: the stillness window and the sensors' latency.
    settle_timeout : float
        Duration of settling after which the sequence is aborted where the tool is not still [s].
    """

    rate: float = 250.0
    stop_duration: float = 0.045
    closing: float = 0.1
    settle_minimum: float = 0.3
    settle_timeout: float = 6.0


class SequenceStatus(NamedTuple):
    """State of a sequence: phase word, what for, why it was aborted, how far it got (0 to 1)."""

    phase: str = 'idle'
    label: str = ''
    reason: str = ''
    progress: float = 0.0


class TimeScale(NamedTuple):
    """
    Rate of the path's time: 1 in motion, 0 at rest, and a smooth change between them.

    Attributes
    ----------
    periods : float
        Duration of a change, in periods of the stream.
    start, target : float
        Rates at its begin and end.
    elapsed : int
        Periods since it began.
    """

    periods: float
    start: float = 1.0
    target: float = 1.0
    elapsed: int = 0

    @property
    def value(self) -> float:
        """The rate now."""
        _, remaining, _ = stop_time(self.elapsed / self.periods)
        return self.target + (self.start - self.target) * float(remaining)

    def towards(self, target: float) -> 'TimeScale':
        """Begin a change to ``target``, unless that is under way."""
        if target == self.target:
            return self
        return TimeScale(self.periods, self.value, target)

    def next(self) -> 'TimeScale':
        """Return the rate one period later."""
        return self._replace(elapsed=self.elapsed + 1) if self.start != self.target else self


class MotionSequence:
    """One robot's sequence, from ``idle`` to ``done`` or ``aborted`` and again."""

    def __init__(self, settings: StreamSettings) -> None:
        self.settings = settings
        self._period = 1.0 / settings.rate
        self._plan: tuple[PlannedSegment, ...] = ()
        self._rest: Goal | None = None
        self._last: Command | None = None
        self._index = 0
        self._time = 0.0
        self._time_scale = TimeScale(settings.stop_duration * settings.rate)
        self._closing = 0
        self._ending = ''
        self._streaming = False
        self._ended = 0.0
        self._expected = 1.0
        self.status = SequenceStatus()

    @property
    def running(self) -> bool:
        """Whether a sequence is under way, the wait for its result included."""
        return self.status.phase not in ('idle', 'done', 'aborted')

    @property
    def streaming(self) -> bool:
        """Whether :meth:`step` has commands to give."""
        return self._streaming

    @property
    def guarded(self) -> bool:
        """Whether a fault aborts it: from the start to the end of the motion."""
        return self.running and not self.moved

    @property
    def moving(self) -> bool:
        """Whether the last command moves."""
        return self._last is not None and self._last.moving

    @property
    def moved(self) -> bool:
        """Whether the motion is over and waits for its result."""
        return self.running and self._index == len(self._plan)

    @property
    def settling(self) -> bool:
        """Whether the tool has to become still before the sequence goes on."""
        return self.running and not self.moved and self._plan[self._index].duration is None

    def start(self, plan: Sequence[PlannedSegment], start: Goal, ending: str = 'identification'
              ) -> None:
        """
        Begin a plan that :func:`forcecal_ros.motion.plan.prepare` has checked.

        Parameters
        ----------
        start : Pose or ndarray
            Where the robot stands: the first command.
        ending : str
            What it waits for after the motion, until :meth:`finish`.

        Raises
        ------
        MotionError
            One is under way already.
        """
        if self.running or self._streaming:
            raise MotionError(f'a sequence is under way already ({self.status.phase} '
                              f'{self.status.label}); abort it first')
        self._plan, self._rest, self._ending = tuple(plan), start, ending
        self._streaming, self._closing, self._ended, self._last = True, 0, 0.0, None
        self._period = 1.0 / self.settings.rate
        self._time_scale = TimeScale(self.settings.stop_duration * self.settings.rate)
        self._expected = expected_duration(plan, self.settings.settle_minimum)
        self._enter(0)

    def abort(self, reason: str, *, at_once: bool = False) -> bool:
        """
        Stop: from the next step on the commands come to rest along their path.

        Parameters
        ----------
        reason : str
            One line for the user.
        at_once : bool
            Hold the last command instead, for a stream that was silent for so long that the
            robot rests there.

        Returns
        -------
        bool
            False where nothing was under way.
        """
        if not self.running:
            return False
        self._time_scale = self._time_scale.towards(0.0)
        if at_once and self._closing == 0 and self._last is not None:
            self._hold_at(self._last)
        self.status = self.status._replace(phase='aborted', reason=reason)
        return True

    def pause(self, paused: bool) -> None:
        """Come to rest on the path and wait there, or go on; either takes the time of a stop."""
        if self.running:
            self._time_scale = self._time_scale.towards(0.0 if paused else 1.0)

    def restart(self) -> None:
        """Start again from rest, after a silence in which the robot came to a stop."""
        if self._streaming and self._closing == 0:
            self._time_scale = TimeScale(self._time_scale.periods, 0.0, self._time_scale.target)

    def finish(self) -> None:
        """End the sequence, once the result of the motion is there."""
        if self.moved:
            self.status = SequenceStatus('done', progress=1.0)

    def step(self, stillness: Stillness | None = None) -> Command | None:
        """
        Advance by one period of the stream.

        Parameters
        ----------
        stillness : Stillness or None
            Of the tool, needed while :attr:`settling`.

        Returns
        -------
        Setpoint, JointSetpoint or None
            The command to send; None where the stream has ended.
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
        if index < len(self._plan):
            segment = self._plan[index].segment
            self.status = SequenceStatus(segment.phase, segment.label, '', self._progress())
        else:
            self.status = SequenceStatus('settle', self._ending, '', 1.0)
            self._begin_closing()

    def _progress(self) -> float:
        return min(1.0, (self._ended + max(0.0, self._time)) / self._expected)

    def _begin_closing(self) -> None:
        self._closing = max(2, round(self.settings.closing * self.settings.rate))

    def _follow(self, stillness: Stillness | None) -> Command:
        part = self._plan[self._index]
        before = self._time_scale.value
        self._time_scale = self._time_scale.next()
        time_scale = self._time_scale.value
        self._time += self._period * (before + time_scale) / 2
        command = self._holding()
        if part.move is not None and self._time > 0.0:
            command = part.move.at(self._time, time_scale)
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
            self.abort(f'not at rest {self._time:.1f} s after the move to {self.status.label}: '
                       f'{stillness.detail}; check for vibration')

    def _hold_at(self, command: Command) -> None:
        self._rest = command.pose if isinstance(command, Setpoint) else command.positions
        self._begin_closing()

    def _holding(self) -> Command:
        assert self._rest is not None
        return hold(self._rest)

    def _close(self) -> Command:
        self._closing -= 1
        self._streaming = self._closing > 0
        return self._holding()


class StreamClock:
    """
    The periodic due times of one command stream.

    A caller that is a little late sends up to three commands, so that the motion keeps
    its time. One that is later than that finds the robot at rest: the motion is postponed.

    Parameters
    ----------
    period_ns : int
        Between commands [ns].
    start_ns : int
        When the first is due, on the clock that drives the motion [ns].
    stamp_ns : int
        Header stamp of the first, on the clock of the stamps [ns].

    Attributes
    ----------
    slipped_ns : int
        By how much the motion was postponed in all [ns].
    """

    def __init__(self, period_ns: int, start_ns: int, stamp_ns: int) -> None:
        self.period_ns = period_ns
        self._due_ns = start_ns
        self._stamp_ns = stamp_ns
        self.slipped_ns = 0

    def due(self, now_ns: int) -> int:
        """Return how many commands to send now."""
        late = now_ns - self._due_ns
        if late < 0:
            return 0
        count = late // self.period_ns + 1
        # commands sent in one go at most, 12 ms of motion at 250 Hz: more would be a jump to a
        # robot that takes the newest only
        if count > 3:
            slip = (count - 1) * self.period_ns
            self.slipped_ns += slip
            self._due_ns += slip
            self._stamp_ns += slip
            count = 1
        return count

    def next_stamp(self) -> int:
        """Return the stamp of the next command, and advance by a period [ns]."""
        stamp = self._stamp_ns
        self._stamp_ns += self.period_ns
        self._due_ns += self.period_ns
        return stamp


def next_in_phase(now_ns: int, phase_ns: int, period_ns: int) -> int:
    """Return the first instant from ``now_ns`` on that is whole periods from ``phase_ns`` [ns]."""
    return now_ns + (phase_ns - now_ns) % period_ns
