"""Which command holds in which robot period, and how far a live simulation has to go."""

from collections import deque
from typing import Generic, TypeVar

Command = TypeVar('Command')

OLDEST = 200_000_000
"""A stamp older than this says nothing about when the command was meant [ns]."""


class CommandSchedule(Generic[Command]):
    """
    Commands on their way to a robot that takes one a period.

    A command acts in the first period that begins at its stamp or later, as in a recording that
    is replayed. Stamps that jitter neither drop nor double a command: one within half a period of
    the slot that comes next takes that slot.

    Parameters
    ----------
    period_ns : int
        Of the robot [ns].
    start_ns : int
        When period 0 begins [ns].
    """

    def __init__(self, period_ns: int, start_ns: int) -> None:
        self._period = period_ns
        self._start = start_ns
        self._queue: deque[tuple[int, Command]] = deque()
        self._last = -1
        self.late = 0

    def add(self, stamp_ns: int, now_ns: int, next_period: int, command: Command) -> None:
        """
        Take in a command.

        Parameters
        ----------
        stamp_ns : int
            Of its header; taken to be now where it is in the future or too old.
        now_ns : int
        next_period : int
            The first period that is not simulated yet.
        command : object
        """
        if not now_ns - OLDEST <= stamp_ns <= now_ns:
            stamp_ns = now_ns
        since = stamp_ns - self._start
        slot = -(-since // self._period)
        expected, half = self._last + 1, self._period // 2
        if (slot != expected
                and abs(since - expected * self._period + half) <= self._period):
            slot = expected
        if slot < next_period:
            self.late += 1
            slot = next_period
        self._last = max(slot, self._last)
        self._queue.append((self._last, command))

    def take(self, period: int) -> Command | None:
        """Return the newest command that acts in a period; None: the one before holds."""
        newest = None
        while self._queue and self._queue[0][0] <= period:
            newest = self._queue.popleft()[1]
        return newest
