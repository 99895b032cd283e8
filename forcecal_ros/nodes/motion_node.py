"""The base of all nodes that move a robot: start, command stream, supervision, stop."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import inf
from time import sleep
from typing import Any, NamedTuple, TYPE_CHECKING, TypeAlias

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.motion.sequence import (
    Command,
    MotionSequence,
    next_in_phase,
    StreamClock,
)
from forcecal_ros.nodes.backends import Backend
from forcecal_ros.nodes.inputs import Sensors
from forcecal_ros.nodes.runtime import answering, diagnostic_array, OUTPUT, SECOND, STEADY
from forcecal_ros.nodes.wire import ReceivingNode
import numpy as np
from rclpy.clock import Clock
from rclpy.time import Time
from std_msgs.msg import String
from std_srvs.srv import Trigger

if TYPE_CHECKING:
    from forcecal_ros.impedance.session import Session

Motion: TypeAlias = 'MotionSequence | Session'
"""Maker of commands, one a period, from a start to done or aborted."""

CLOCK_JUMP = 0.1
"""Largest change of the clock of the stamps against the steady one in a sequence: the slewing of
NTP, at most 0.5 ms/s, stays below it for three minutes [s]."""


class Fault(NamedTuple):
    """Reason to abort; ``at_once``: the robot rests already."""

    reason: str
    at_once: bool = False


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

    def __init__(self, sensors: Sensors, backend: Backend, motion: Motion, clock: Clock,
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


class MotionNode(ReceivingNode):
    """
    A node that moves a robot: one motion at a time, begun by its service ``start`` only.

    Parameters
    ----------
    role : str
        Usual name of the node, of which its topics and services take theirs.
    settings_of : callable
        Makes settings of the values of all parameters, by name: ``limits``, ``watch`` and what
        each node adds; raises a ConfigError where they contradict each other.
    """

    def __init__(self, role: str, table: Sequence[Parameter],
                 settings_of: Callable[[Mapping[str, Any]], Any]) -> None:
        super().__init__(
            role, table, lambda changes: settings_of({**self._values(), **changes}))
        self._settings_of = settings_of
        self._settings: Any = settings_of(self._values())
        self._simulated = self.get_parameter('use_sim_time').value
        self._stream: StreamClock | None = None
        self._announced = ''
        self._sent = 0
        self._periods: deque[int] = deque(maxlen=15_000)  # a minute at 250 Hz

    def _serve(self, source: Motion, sensors: Sensors, backend: Backend,
               period_ns: int) -> None:
        """Create topics, services and timers; nothing moves before a start."""
        self._source, self._sensors, self._backend = source, sensors, backend
        self._period_ns = period_ns
        self._guard = Guard(sensors, backend, source, self.get_clock(), STEADY, self._simulated)
        self._phase_out = self.create_publisher(DiagnosticArray, '~/phase', OUTPUT)
        self._state_out = self.create_publisher(String, '~/state', OUTPUT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        self.create_service(Trigger, '~/start', answering(self._start, self._refused))
        self.create_service(Trigger, '~/abort', self._on_abort)
        clock = None if self._simulated else STEADY
        self._timer = self.create_timer(period_ns / SECOND, self._tick, clock=clock)
        # period of the checks of a simulated clock that drives the motion: a fifth of the default
        # of ``watch.clock_timeout`` [s]
        self.create_timer(0.02, self._watch_clock, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        self._publish_phase()
        self.get_logger().info(f'ready: call {self.get_name()}/start')

    # What each node adds --------------------------------------------------------------------

    @abstractmethod
    def _begin(self) -> str:
        """Plan and check a motion, and start the source; return the answer of the service."""

    @abstractmethod
    def _command(self) -> Command | None:
        """Advance the source by one period."""

    @abstractmethod
    def _details(self) -> dict[str, object]:
        """Return the values of a phase message in addition to phase and reason."""

    def _new_settings(self) -> Any:
        """Return the settings of a start; raises where they contradict each other."""
        return self._settings_of(self._values())

    def _busy(self) -> bool:
        """Whether a start is refused, though the motion is over."""
        return False

    def _after(self) -> None:
        """Finish what follows the motion; called each period."""

    def _entered(self, stamp_ns: int) -> None:
        """Note a phase that begins with the command of that stamp."""

    def _figures(self) -> dict[str, object]:
        """Return the values of /diagnostics in addition to those of every such node."""
        return {}

    def _headline(self) -> str:
        """Return the text whose changes are announced by a phase message."""
        return self._source.status.phase

    # The stream -----------------------------------------------------------------------------

    def _now(self) -> int:
        """Return the time on the clock that drives the motion [ns]."""
        clock = self.get_clock() if self._simulated else STEADY
        return int(clock.now().nanoseconds)

    def _tick(self) -> None:
        self._inbox.drain()
        steady = STEADY.now().nanoseconds
        self._sensors.monitor.tick(steady * 1e-9)
        self._guard.listen()
        self._after()
        if not self._source.streaming or self._stream is None:
            return
        if self._source.guarded:
            self._check()
        slipped = self._stream.slipped_ns
        due = self._stream.due(self._now())
        if self._stream.slipped_ns != slipped:
            self._source.restart()
        for _ in range(due):
            if not self._step(self._stream):
                break

    def _check(self) -> None:
        pauses = self._guard.pauses
        fault = self._guard.check(self._source.moving)
        if fault is None and (
                off := self._backend.tracking_fault(self._settings.limits.tracking_angle)):
            fault = Fault(off)
        if fault is not None:
            self._abort(fault)
        elif self._guard.pauses > pauses:
            self.get_logger().warning(f'paused: {self._guard.stale}')

    def _step(self, stream: StreamClock) -> bool:
        """Send the next command; return whether there was one."""
        stamp = stream.next_stamp()
        command = self._command()
        if command is None:
            return False
        self._announce(stamp)
        self._backend.send(stamp, command)
        steady = STEADY.now().nanoseconds
        if self._sent:
            self._periods.append(steady - self._sent)
        self._sent = steady
        return True

    def _watch_clock(self) -> None:
        """Abort where the ROS clock that drives the motion has stopped or jumped."""
        if not (self._simulated and self._source.streaming) or self._stream is None:
            return
        fault = self._guard.clock_fault()
        if fault is not None and self._abort(fault):
            while self._step(self._stream):
                pass

    # Start and abort ------------------------------------------------------------------------

    def _refused(self, why: str) -> None:
        self.get_logger().warning(f'not started: {why}', throttle_duration_sec=1.0)

    def _start(self) -> str:
        self._make_ready()
        self._backend.require_controller()
        answer = self._begin()
        self._begin_stream()
        return self._with_caveat(answer)

    def _with_caveat(self, answer: str) -> str:
        if self._backend.caveat:
            self.get_logger().warning(self._backend.caveat)
            return f'{answer}; {self._backend.caveat}'
        return answer

    def _make_ready(self) -> None:
        """
        Take the settings over, and learn how sensors and robot are at rest; nothing moves.

        Raises
        ------
        ForcecalError
            A motion is under way, or must not begin.
        """
        if self._source.running or self._source.streaming or self._busy():
            raise MotionError(f'a motion is under way already ({self._headline()}); abort it '
                              'first')
        self._settings = settings = self._new_settings()
        monitor = self._sensors.monitor
        monitor.settings, monitor.limits = settings.watch, settings.limits
        self._inbox.drain()
        steady, ros = STEADY.now().nanoseconds, self.get_clock().now().nanoseconds
        if self._simulated and ros == 0:
            raise DataError('/clock: nothing received, and use_sim_time is set; start its '
                            'publisher')
        monitor.tick(steady * 1e-9)
        monitor.begin(ros * 1e-9)
        if others := self._guard.others():
            raise MotionError(others)
        self._backend.prepare(self._period_ns)

    def _begin_stream(self) -> None:
        """Begin the command stream, and its timer, in phase with the measured poses."""
        ros = self.get_clock().now().nanoseconds
        stamp = next_in_phase(ros, self._sensors.pose_stamp_ns, self._period_ns)
        if not self._simulated:
            sleep((stamp - ros) / SECOND)
            self._timer.reset()
        steady = STEADY.now().nanoseconds
        self._guard.begin()
        self._stream = StreamClock(self._period_ns, stamp if self._simulated else steady, stamp)
        self._sent = 0
        self._periods.clear()
        self._announce(stamp)

    def _on_abort(self, request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        response.success = self._abort(Fault(f'requested by {self.get_name()}/abort'))
        response.message = 'stopping' if response.success else 'no motion is under way'
        return response

    def _abort(self, fault: Fault) -> bool:
        aborted = self._source.abort(fault.reason, at_once=fault.at_once)
        if aborted:
            self._announce(self.get_clock().now().nanoseconds)
        return aborted

    def come_to_rest(self, spin: Callable[[], object]) -> None:
        """Begin to come to rest, and spin until the command stream has ended."""
        self._abort(Fault(f'the {self.get_name()} node received a signal to end'))
        requested = STEADY.now().nanoseconds
        # silence of the commands after which a node that received a signal to end no longer waits
        # to come to rest: five times what a clock that drives the motion may stand by default [s]
        while self._source.streaming and (
                STEADY.now().nanoseconds < max(requested, self._sent) + int(0.5 * SECOND)):
            spin()

    def halt(self) -> None:
        """Come to rest now, after an error; what is received counts no more."""
        self._abort(Fault(f'the {self.get_name()} node terminates after an error'))
        while self._stream is not None and self._step(self._stream):
            sleep(self._period_ns / SECOND)

    # Phase and diagnostics ------------------------------------------------------------------

    def _announce(self, stamp_ns: int) -> None:
        """Publish a change of phase, with the stamp of the command that it begins with."""
        if self._headline() == self._announced:
            return
        self._entered(stamp_ns)
        self._publish_phase(stamp_ns)
        status = self._source.status
        if status.phase == 'aborted':
            self.get_logger().error(f'aborted: {status.reason}')

    def _publish_phase(self, stamp_ns: int | None = None) -> None:
        self._announced, status = self._headline(), self._source.status
        self._state_out.publish(String(data=status.phase))
        if self._simulated and not self.get_clock().now().nanoseconds:
            return  # without /clock there is no stamp
        stamp = None if stamp_ns is None else Time(nanoseconds=stamp_ns)
        self._phase_out.publish(diagnostic_array(
            self, 'phase', 'error' if status.phase == 'aborted' else 'ok', status.phase,
            {'reason': status.reason, **self._details()}, stamp))

    def _report(self) -> None:
        self._publish_phase()
        status, channels = self._source.status, self._sensors.monitor.channels.values()
        silent = [channel.topic for channel in channels if not channel.values]
        level = 'error' if status.phase == 'aborted' else 'warn' if silent else 'ok'
        message = f'{status.phase}: {status.reason}' if status.reason else status.phase
        if silent and not status.reason:
            message += f'; nothing received on {", ".join(silent)}'
        values: dict[str, object] = {
            channel.topic: 'received' if channel.values else 'nothing received'
            for channel in channels}
        values |= self._figures()
        if self._periods:
            median, late = np.percentile(self._periods, (50.0, 99.0)) * 1e-6
            values['period, median [ms]'] = float(median)
            values['period, 99th percentile [ms]'] = float(late)
        if self._stream is not None:
            values['stream put off by [s]'] = self._stream.slipped_ns / SECOND
            values['pauses'] = self._guard.pauses
        self._diagnostics.publish(diagnostic_array(self, '', level, message, values))
