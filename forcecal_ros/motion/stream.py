"""When commands are due: once a period, and never many at once."""

MOST_AT_ONCE = 3
"""Commands sent in one go at most, 12 ms of motion at 250 Hz: more would be a jump to a robot that
takes the newest only."""


class StreamClock:
    """
    The periodic due times of one command stream.

    A caller that is a little late sends up to ``MOST_AT_ONCE`` commands, so that the motion keeps
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
        if count > MOST_AT_ONCE:
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
