"""Which command holds in which robot period of a live simulation."""

from collections import deque
from typing import Any

OLDEST = 1_000_000_000
"""Age beyond which a stamp is of another clock, and the arrival of its command counts [ns]."""

LONGEST_LAG = 250
"""Most periods that a late stream lags behind; commands beyond that are dropped."""


class CommandSchedule:
    """
    Commands on their way to a robot that takes one a period.

    A command acts in the first period that begins at its stamp or later, as in a recording that
    is replayed. Stamps that jitter neither drop nor double a command: one within half a period of
    the slot that comes next takes that slot. Nor do commands that come late: they act one after
    the other, and the stream lags until it rests.

    Parameters
    ----------
    period_ns : int
        Of the robot [ns].
    start_ns : int
        When period 0 begins [ns].

    Attributes
    ----------
    late : int
        Commands that came too late for their period.
    """

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self._period = period_ns
        self._start = start_ns
        self._queue: deque[tuple[int, Any]] = deque()
        self._last = -1
        self._newest: Any = None
        self._lag = 0
        self.late = 0

    def add(self, stamp_ns: int, now_ns: int, next_period: int, command: Any) -> None:
        """
        Take in a command.

        Parameters
        ----------
        stamp_ns : int
            Of its header; taken to be now where it is in the future or too old.
        next_period : int
            The first period that is not simulated yet.
        command : object
            Compared with the one before: where they are equal the robot rests.
        """
        frontier = self._start + next_period * self._period
        if not frontier - OLDEST <= stamp_ns <= now_ns:
            stamp_ns = now_ns
        if command == self._newest:
            self._lag = 0
        due = self._due(stamp_ns - self._start)
        behind = next_period - due
        if behind > self._lag:
            self._lag = min(behind, LONGEST_LAG)
            self.late += 1
        self._last = max(due + self._lag, next_period, self._last)
        self._newest = command
        self._queue.append((self._last, command))

    @property
    def commanded_ns(self) -> int:
        """End of the last period that a command has come for [ns]."""
        return self._start + (self._last + 1) * self._period

    def _due(self, since: int) -> int:
        """Return the period a command is due in, ``since`` the start [ns]."""
        expected, half = self._last - self._lag + 1, self._period // 2
        if abs(since - expected * self._period + half) <= self._period:
            return expected
        return -(-since // self._period)

    def restarted(self, start_ns: int) -> 'CommandSchedule':
        """
        Return a schedule for a time that was skipped: what waits acts one after the other.

        Parameters
        ----------
        start_ns : int
            When period 0 begins from now on [ns].
        """
        schedule = CommandSchedule(self._period, start_ns)
        schedule._queue.extend((i, command) for i, (_, command) in enumerate(self._queue))
        schedule._last, schedule._newest = len(self._queue) - 1, self._newest
        schedule._lag = min(len(self._queue), LONGEST_LAG)
        schedule.late = self.late
        return schedule

    def drop(self) -> None:
        """Forget what waits, its sender silent; a stream that lags acts to its end."""
        if not self._lag:
            self._queue.clear()

    def take(self, period: int) -> Any:
        """Return the newest command that acts in a period; None: the one before holds."""
        newest = None
        while self._queue and self._queue[0][0] <= period:
            newest = self._queue.popleft()[1]
        return newest
