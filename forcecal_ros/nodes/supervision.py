"""Supervision of a motion: its sensors, the dead-man switch, clocks and other nodes."""

from collections.abc import Callable, Iterable
from functools import partial
from math import inf
from typing import NamedTuple, Protocol, TYPE_CHECKING, TypeAlias

from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.monitor import Monitor, WatchSettings
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.nodes.inputs import Input
from forcecal_ros.nodes.runtime import SECOND, STEADY
from forcecal_ros.nodes.wire import Inbox, Sample
from rclpy.clock import Clock
from std_msgs.msg import Header

if TYPE_CHECKING:
    from forcecal_ros.impedance.session import Session
    from forcecal_ros.motion.sequence import MotionSequence

Motion: TypeAlias = 'MotionSequence | Session'
"""Maker of commands, one a period, from a start to done or aborted."""


class Deadman:
    """
    Monitor of the topic ``deadman``.

    Parameters
    ----------
    timeout : float
        Silence that stops a motion [s]; 0: there is no switch.
    """

    def __init__(self, inbox: Inbox, timeout: float) -> None:
        self._received = 0
        self._timeout = round(timeout * SECOND)
        if self._timeout:
            inbox.subscribe(Header, 'deadman', self._on_deadman)

    def _on_deadman(self, raw: bytes) -> None:
        self._received = STEADY.now().nanoseconds

    def fault(self, steady_ns: int) -> str:
        """Return why to stop, at a time on the steady clock [ns]; empty: there is no reason."""
        silent = steady_ns - self._received
        if not 0 < self._timeout < silent:
            return ''
        if not self._received:
            return 'deadman: nothing received; press the switch'
        return f'deadman: silent for {silent / SECOND:.3f} s'


Record: TypeAlias = Callable[[str, int, tuple[float, ...]], None]
"""Called with channel, stamp [ns] and values of every sample and command."""


class Sensors:
    """The topics that a motion depends on, with monitor and dead-man switch."""

    def __init__(self, inbox: Inbox, inputs: Iterable[Input], deadman: Deadman,
                 watch: WatchSettings, limits: Limits, record: Record | None = None) -> None:
        inputs = tuple(inputs)
        self.deadman = deadman
        self.monitor = Monitor(watch, limits, {
            one.channel: one.name or one.topic for one in inputs if one.watched})
        self._record = record
        self._raw: dict[str, bytes] = {}
        self._stamps: dict[str, int] = {}
        self._frame_of = {one.channel: one.frame_of for one in inputs}
        for one in inputs:
            inbox.subscribe(one.message_type, one.topic, one.taker(self._user(one)))

    def _user(self, one: Input) -> Callable[[bytes, Sample], None]:
        channel, record, newest, stamps = one.channel, self._record, self._raw, self._stamps
        watch = self._watch_of(channel) if one.watched else None

        def use(raw: bytes, sample: Sample) -> None:
            stamp_ns, values = sample
            newest[channel], stamps[channel] = raw, stamp_ns
            if watch is not None:
                watch(stamp_ns * 1e-9, values)
            if record is not None:
                record(channel, stamp_ns, values)

        return use

    def _watch_of(self, channel: str) -> Callable[[float, tuple[float, ...]], None]:
        monitor = self.monitor
        return {'wrench': monitor.wrench, 'pose': monitor.pose}.get(
            channel, partial(monitor.other, channel))

    def commanded(self, stamp_ns: int, pose: tuple[float, ...]) -> None:
        """Note a command, x y z [m] qx qy qz qw, with which measured poses are compared."""
        self.monitor.command(stamp_ns * 1e-9, pose)
        if self._record is not None:
            self._record('target', stamp_ns, pose)

    def newest(self, channel: str) -> tuple[float, ...]:
        """Return the newest values of a channel; zero where there is no such channel."""
        found = self.monitor.channels.get(channel)
        return found.values if found is not None else (0.0,)

    def measured_pose(self) -> Pose:
        """Return the pose of a robot at rest, its position averaged over the newest poses."""
        return Pose(self.monitor.mean('pose'), matrix_from_quaternion(self.newest('pose')[3:]))

    @property
    def pose_stamp_ns(self) -> int:
        """Header stamp of the newest pose [ns]."""
        return self._stamps['pose']

    @property
    def frames(self) -> dict[str, str]:
        """The frame_id of the newest message, by channel."""
        return {channel: self._frame_of[channel](raw) for channel, raw in self._raw.items()}


CLOCK_JUMP = 0.1
"""Largest change of the clock of the stamps against the steady one in a sequence: the slewing of
NTP, at most 0.5 ms/s, stays below it for three minutes [s]."""


class Fault(NamedTuple):
    """Reason to abort; ``at_once``: the robot rests already."""

    reason: str
    at_once: bool = False


class Commanded(Protocol):
    """A topic of commands, watched for commands of other nodes."""

    topic: str
    commands_of_others: int


class Guard:
    """
    Supervision of one motion after another.

    Parameters
    ----------
    clock : Clock
        Of the header stamps.
    steady : Clock
        Only goes forward.
    simulated : bool
        Whether the clock of the stamps also drives the motion.

    Attributes
    ----------
    pauses : int
        Since the start.
    stale : str
        Which sensor is silent or late, so that the motion pauses; empty: none is.
    """

    def __init__(self, sensors: Sensors, backend: Commanded, motion: Motion, clock: Clock,
                 steady: Clock, simulated: bool) -> None:
        self._sensors, self._backend, self._motion = sensors, backend, motion
        self._clock, self._steady, self._simulated = clock, steady, simulated
        self._others_count, self._other_received = 0, -SECOND
        self.pauses = 0
        self.stale = ''

    def begin(self) -> None:
        """Begin the supervision of a motion."""
        steady, now = self._readings()
        self._started = self._ticked = steady
        self._offset = now - steady
        self._seen, self._advanced, self._rate = now, steady, inf  # rate not known yet
        self._stale_since: int | None = None
        self.pauses, self.stale = 0, ''

    def _readings(self) -> tuple[int, int]:
        """Read both clocks at one instant, as far as the processor is not taken away [ns]."""
        pairs: list[tuple[int, int, int]] = []
        # at once and readings: clocks are read again where a reading took longer [s], so many
        # times at most: a busy machine takes the processor away for 0.15 s now and then, which
        # would look like a clock that jumps
        while len(pairs) < 5:
            before = self._steady.now().nanoseconds
            now = self._clock.now().nanoseconds
            within = self._steady.now().nanoseconds - before
            pairs.append((within, before + within // 2, now))
            if within < 0.001 * SECOND:
                break
        _, steady, now = min(pairs)
        return steady, now

    def others(self) -> str:
        """Return why a start is refused: commands of another node, or no dead-man switch."""
        self.listen()
        steady = self._steady.now().nanoseconds
        # a start is refused for that long after a command of another node, which at any usual rate
        # would have sent the next one by then [s]
        if steady - self._other_received < 0.5 * SECOND:
            return f'{self._backend.topic}: another node commands the robot; stop it'
        return self._sensors.deadman.fault(steady)

    def listen(self) -> None:
        """Note the time of the newest command of another node."""
        if self._backend.commands_of_others != self._others_count:
            self._others_count = self._backend.commands_of_others
            self._other_received = self._steady.now().nanoseconds

    def check(self, moving: bool) -> Fault | None:
        """Return why to abort now; pauses the motion while a sensor is silent or late."""
        steady, now = self._readings()
        silent, self._ticked = (steady - self._ticked) / SECOND, steady
        # a command stream that was interrupted for longer is not resumed: a stop takes a tenth of
        # that, so that the robot has come to rest meanwhile [s]
        if moving and silent > 0.5 and not self._simulated:
            return Fault(f'the command stream stalled for {silent:.2f} s; the machine is '
                         'overloaded', at_once=True)
        drift = (now - steady - self._offset) / SECOND
        if not self._simulated and abs(drift) > CLOCK_JUMP:
            return Fault(f'the system clock jumped by {drift:.2f} s')
        reason = self._sensors.monitor.check(moving) or self._sensors.deadman.fault(steady)
        if not reason and self._other_received > self._started:
            reason = f'{self._backend.topic}: another node commands the robot'
        reason = reason or self._pause_while_stale(steady, now)
        return Fault(reason) if reason else None

    def _pause_while_stale(self, steady: int, now: int) -> str:
        """Pause while a sensor is silent or late; return why to abort if that lasts too long."""
        monitor = self._sensors.monitor
        self.stale = monitor.stale(now * 1e-9)
        self._motion.pause(bool(self.stale))
        if not self.stale:
            self._stale_since = None
            return ''
        if self._stale_since is None:
            self._stale_since = steady
            self.pauses += 1
            if 0 < monitor.settings.most_pauses < self.pauses:
                return (f'{self.stale}, for the {self.pauses}th time; watch.most_pauses is '
                        f'{monitor.settings.most_pauses}')
        lost = monitor.settings.lost_timeout - monitor.settings.pause_timeout
        return self.stale if steady - self._stale_since > lost * SECOND else ''

    def clock_fault(self) -> Fault | None:
        """Return why to abort where the clock that drives the motion stops or jumps."""
        steady, now = self._readings()
        if now != self._seen:
            step, elapsed = (now - self._seen) / SECOND, (steady - self._advanced) / SECOND
            self._seen, self._advanced = now, steady
            # a simulated clock that runs by less than this factor faster than before does not
            # jump: a busy simulator is slow, and then catches up
            usual = CLOCK_JUMP + 3.0 * self._rate * elapsed
            # least time over which the rate of a simulated clock is taken:
            # that between two checks [s]
            rate = step / max(elapsed, 0.02)
            # factor by which the fastest rate of a simulated clock decays from check to check: by
            # half in 0.7 s of a check every 20 ms
            self._rate = max(self._rate * 0.98, rate) if self._rate < inf else rate
            return None if 0 < step < usual else Fault(
                f'/clock jumped by {step:.3g} s', at_once=True)
        if steady - self._advanced > self._sensors.monitor.settings.clock_timeout * SECOND:
            return Fault('/clock has stopped', at_once=True)
        return None
