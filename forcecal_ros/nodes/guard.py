"""Whoever may end a motion besides the plan: sensors, robot, clocks, other nodes, a person."""

from typing import Any, NamedTuple, Protocol

from forcecal_ros.motion.monitor import Monitor
from forcecal_ros.nodes.backends import Backend
from forcecal_ros.nodes.deadman import Deadman
from forcecal_ros.nodes.runtime import SECOND
from rclpy.clock import Clock

CLOCK_JUMP = 0.1
"""The clock of the stamps may depart from the steady one by that much in a sequence [s]."""

UNEVEN = 3.0
"""A /clock may pass so many times as fast as it did."""

FORGETTING = 0.98
"""The fastest that a /clock passed fades by this factor from look to look."""

UNKNOWN = 1e3
"""How fast a /clock may pass before it is known [s a second]."""

SHORTEST_LOOK = 0.02
"""Looks at /clock that follow each other faster do not show how fast it passes [s]."""

STALL = 0.5
"""A motion whose commands ceased for longer is not resumed [s]."""

AT_ONCE, READINGS = 0.001, 5
"""Clocks are read anew where that took longer [s], so many times: a busy machine takes the
processor away for 0.15 s now and then, which would look like a clock that jumps."""

FOREIGN = 0.5
"""Commands of someone else that are more recent than this forbid a start [s]."""


class Fault(NamedTuple):
    """Reason to abort; ``at_once`` where the robot stands already."""

    reason: str
    at_once: bool = False


class Watched(Protocol):
    """What is heard while the robot moves."""

    monitor: Monitor
    deadman: Deadman


class Pausable(Protocol):
    """A motion that can stand for a while."""

    def pause(self, paused: bool) -> None:
        """Stand, or go on."""


class Guard:
    """
    Watch over one motion after another.

    Parameters
    ----------
    sensors : Watched
    backend : Backend
    motion : Pausable
    clock : Clock
        Of the header stamps.
    steady : Clock
        Only goes forward.
    simulated : bool
        Whether the clock of the stamps also drives the motion.
    """

    def __init__(self, sensors: Watched, backend: Backend[Any], motion: Pausable, clock: Clock,
                 steady: Clock, simulated: bool) -> None:
        self._sensors, self._backend, self._motion = sensors, backend, motion
        self._clock, self._steady, self._simulated = clock, steady, simulated
        self._foreign, self._foreign_heard = 0, -SECOND
        self.pauses = 0
        self.doubt = ''

    def begin(self) -> None:
        """Begin with a motion."""
        steady, now = self._readings()
        self._started = self._ticked = steady
        self._offset = now - steady
        self._seen, self._advanced, self._rate = now, steady, UNKNOWN
        self._doubtful_since: int | None = None
        self.pauses, self.doubt = 0, ''

    def _readings(self) -> tuple[int, int]:
        """Read both clocks at one instant, as far as the processor is not taken away [ns]."""
        pairs: list[tuple[int, int, int]] = []
        while len(pairs) < READINGS:
            before = self._steady.now().nanoseconds
            now = self._clock.now().nanoseconds
            within = self._steady.now().nanoseconds - before
            pairs.append((within, before + within // 2, now))
            if within < AT_ONCE * SECOND:
                break
        _, steady, now = min(pairs)
        return steady, now

    def others(self) -> str:
        """Return what forbids a start: another node that commands, or no dead-man switch."""
        self.listen()
        steady = self._steady.now().nanoseconds
        if steady - self._foreign_heard < FOREIGN * SECOND:
            return f'{self._backend.topic}: another node commands the robot; stop it'
        return self._sensors.deadman.fault(steady)

    def listen(self) -> None:
        """Note commands that were not one's own."""
        if self._backend.foreign != self._foreign:
            self._foreign = self._backend.foreign
            self._foreign_heard = self._steady.now().nanoseconds

    def check(self, moving: bool) -> Fault | None:
        """Return why to abort now; stands while a sensor is silent or late."""
        steady, now = self._readings()
        silent, self._ticked = (steady - self._ticked) / SECOND, steady
        if moving and silent > STALL and not self._simulated:
            return Fault(f'the command stream stalled for {silent:.2f} s; the machine is '
                         'overloaded', at_once=True)
        drift = (now - steady - self._offset) / SECOND
        if not self._simulated and abs(drift) > CLOCK_JUMP:
            return Fault(f'the system clock jumped by {drift:.2f} s')
        reason = self._sensors.monitor.check(moving) or self._sensors.deadman.fault(steady)
        if not reason and self._foreign_heard > self._started:
            reason = f'{self._backend.topic}: another node commands the robot'
        reason = reason or self._stand_while_in_doubt(steady, now)
        return Fault(reason) if reason else None

    def _stand_while_in_doubt(self, steady: int, now: int) -> str:
        """Pause while a sensor is silent or late; return why where that lasts for too long."""
        monitor = self._sensors.monitor
        self.doubt = monitor.doubt(now * 1e-9)
        self._motion.pause(bool(self.doubt))
        if not self.doubt:
            self._doubtful_since = None
            return ''
        if self._doubtful_since is None:
            self._doubtful_since = steady
            self.pauses += 1
            if 0 < monitor.settings.most_pauses < self.pauses:
                return (f'{self.doubt}, for the {self.pauses}th time; watch.most_pauses is '
                        f'{monitor.settings.most_pauses}')
        lost = monitor.settings.lost_timeout - monitor.settings.pause_timeout
        return self.doubt if steady - self._doubtful_since > lost * SECOND else ''

    def clock_fault(self) -> Fault | None:
        """Return why to abort where the clock that drives the motion stands or jumps."""
        steady, now = self._readings()
        if now != self._seen:
            step, elapsed = (now - self._seen) / SECOND, (steady - self._advanced) / SECOND
            self._seen, self._advanced = now, steady
            usual = CLOCK_JUMP + UNEVEN * self._rate * elapsed
            rate = step / max(elapsed, SHORTEST_LOOK)
            self._rate = max(self._rate * FORGETTING, rate) if self._rate < UNKNOWN else rate
            return None if 0 < step < usual else Fault(
                f'/clock jumped by {step:.3g} s', at_once=True)
        if steady - self._advanced > self._sensors.monitor.settings.clock_timeout * SECOND:
            return Fault('/clock has stopped', at_once=True)
        return None
