"""The sequencer's state machine: periods of the command stream in, commands and phase out.

It knows neither clocks nor messages. Whoever owns the stream calls :meth:`Sequence.step` once a
period and sends what comes back; a call that comes late stretches the motion and never makes the
robot jump.
"""

from collections.abc import Sequence as Parts
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.control.joints import JointSetpoint, hold_joints
from forcecal_ros.control.monitor import Stillness
from forcecal_ros.control.motion import Pose, Setpoint, hold, stop_time
from forcecal_ros.control.plan import Goal, Part, expected_duration
from forcecal_ros.errors import MotionError

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
        self._index = 0
        self._count = 0
        self._elapsed = 0.0
        self._stop_count: int | None = None
        self._closing = 0
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
    def moved(self) -> bool:
        """Whether the motion is over and waits for its result."""
        return self.running and self._index == len(self._parts)

    @property
    def settling(self) -> bool:
        """Whether the tool has to become still before it goes on."""
        return self.running and not self.moved and self._parts[self._index].duration is None

    def start(self, parts: Parts[Part], start: Goal) -> None:
        """
        Begin a plan that :func:`forcecal_ros.control.plan.prepare` has checked.

        Parameters
        ----------
        parts : sequence of Part
        start : Pose or ndarray
            Where the robot stands: the first command.

        Raises
        ------
        MotionError
            One is under way already.
        """
        if self.running or self._streaming:
            raise MotionError(f'a sequence is under way already ({self.status.phase} '
                              f'{self.status.label}); abort it first')
        self._parts, self._rest = tuple(parts), start
        self._stop_count, self._streaming, self._ended = None, True, 0.0
        self._expected = expected_duration(parts, self.settings.settle_minimum)
        self._enter(0)

    def abort(self, reason: str) -> bool:
        """
        Stop: from the next step on the commands come to rest along the path they are on.

        Parameters
        ----------
        reason : str
            One line for the user.

        Returns
        -------
        bool
            False where nothing was under way.
        """
        if not self.running:
            return False
        if self._streaming and self._closing == 0:
            self._stop_count = 0
        self.status = self.status._replace(phase='aborted', reason=reason)
        return True

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
            return self._close()
        if self._stop_count is not None:
            return self._stop()
        return self._follow(stillness)

    def _enter(self, index: int) -> None:
        self._index, self._count, self._elapsed = index, 0, 0.0
        if index < len(self._parts):
            segment = self._parts[index].segment
            self.status = Status(segment.phase, segment.label, '', self._progress())
        else:
            self.status = Status('settle', 'identification', '', 1.0)
            self._begin_closing()

    def _progress(self) -> float:
        return min(1.0, (self._ended + self._elapsed) / self._expected)

    def _begin_closing(self) -> None:
        self._closing = max(2, round(self.settings.closing * self.settings.rate))

    def _follow(self, stillness: Stillness | None) -> Command:
        part = self._parts[self._index]
        self._elapsed = self._count * self._period
        self._count += 1
        command = part.move.at(self._elapsed) if part.move else self._holding()
        if part.duration is None:
            self._settle(stillness)
        elif self._elapsed >= part.duration - 1e-9:
            self._rest = part.goal
            self._ended += part.duration
            self._enter(self._index + 1)
        self.status = self.status._replace(progress=self._progress())
        return command

    def _settle(self, stillness: Stillness | None) -> None:
        if self._elapsed < self.settings.settle_minimum or stillness is None:
            return
        if stillness.still:
            self._ended += self.settings.settle_minimum
            self._enter(self._index + 1)
        elif self._elapsed >= self.settings.settle_timeout:
            self.abort(f'not still {self._elapsed:.1f} s after the move to {self.status.label}: '
                       f'{stillness.detail}; look for vibration, or raise settle.factor')

    def _holding(self) -> Command:
        assert self._rest is not None
        return hold(self._rest) if isinstance(self._rest, Pose) else hold_joints(self._rest)

    def _stop(self) -> Command:
        assert self._stop_count is not None
        self._stop_count += 1
        duration = self.settings.stop_duration
        tau = min(1.0, self._stop_count * self._period / duration)
        advance, rate, _ = (float(v) for v in stop_time(tau))
        # The last command was sent for one period before the one that comes next.
        begin = (self._count - 1) * self._period
        move = self._parts[self._index].move if self._count else None
        if move is not None:
            command = move.at(begin + advance * duration, rate)
            if tau < 1.0:
                return command
            self._rest = command.pose if isinstance(command, Setpoint) else command.positions
        self._stop_count = None
        self._begin_closing()
        return self._holding()

    def _close(self) -> Command:
        self._closing -= 1
        self._streaming = self._closing > 0
        return self._holding()
