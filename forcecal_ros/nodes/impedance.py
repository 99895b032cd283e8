"""Impedance control with the observer's force: a contact task, one command every 4 ms."""

from collections import deque
from collections.abc import Sequence
from struct import error as StructError
from time import sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.errors import DataError, ForcecalError, MotionError
from forcecal_ros.geometry import Array, matrix_from_quaternion
from forcecal_ros.impedance.design import design
from forcecal_ros.impedance.law import Measurement
from forcecal_ros.impedance.plant.file import load_plant
from forcecal_ros.impedance.regulator import Regulator
from forcecal_ros.impedance.session import Session, Status
from forcecal_ros.motion.limits import check_workspace
from forcecal_ros.motion.monitor import Monitor
from forcecal_ros.motion.profiles import Pose, Setpoint
from forcecal_ros.motion.stream import phased, StreamClock
from forcecal_ros.nodes.backends import pose_numbers, TargetFrame
from forcecal_ros.nodes.deadman import Deadman
from forcecal_ros.nodes.guard import Guard
from forcecal_ros.nodes.impedance_settings import PARAMETERS, Settings, settings_of
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.parameters import declare
from forcecal_ros.nodes.reporting import diagnostic_array
from forcecal_ros.nodes.runtime import OUTPUT, run, SECOND, STEADY
from forcecal_ros.nodes.wire import JointReader, Reader
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

REMEMBERED = 15_000
"""Control periods that the jitter is told of: a minute."""


class Senses:
    """What the node hears, each sample watched over as it comes."""

    def __init__(self, node: Node, inbox: Inbox, settings: Settings) -> None:
        topics = {'wrench': 'observer/contact_wrench', 'pose': 'current_pose', 'sensor': 'wrench'}
        joint = node.get_parameter('optidrive.joint').value
        if joint:
            topics['optidrive'] = 'optidrive'
        self.monitor = Monitor(settings.watch, settings.limits, topics)
        self.deadman = Deadman(inbox, node.get_parameter('motion.deadman_timeout').value)
        self.pose_stamp_ns = 0

        def hear(topic: str, message_type: Any, read: Any, watch: Any) -> None:
            def on_sample(raw: bytes) -> None:
                try:
                    sample = read(raw)
                except StructError:
                    return
                if sample is not None:
                    watch(sample.stamp_ns * 1e-9, sample.values)
            inbox.subscribe(message_type, topic, on_sample)

        hear(topics['wrench'], WrenchStamped, Reader(WrenchStamped), self.monitor.wrench)
        hear(topics['pose'], PoseStamped, Reader(PoseStamped), self.monitor.pose)
        # a sensor that sticks shows here alone: what the observer makes of it goes on changing
        hear(topics['sensor'], WrenchStamped, Reader(WrenchStamped),
             lambda stamp, values: self.monitor.other('sensor', stamp, values))
        if joint:
            hear('optidrive', JointState, JointReader(joint),
                 lambda stamp, values: self.monitor.other('optidrive', stamp, values))

    def newest(self, name: str) -> tuple[float, ...]:
        """Return the newest values of a channel; zero of one that there is not."""
        channel = self.monitor.channels.get(name)
        return channel.values if channel is not None else (0.0,)


class Impedance(Node):
    """Runs one contact task at a time, from start to done or aborted."""

    def __init__(self) -> None:
        super().__init__('impedance')
        declare(self, PARAMETERS, lambda changes: settings_of({**self._values(), **changes}))
        self._settings = settings_of(self._values())
        self._plant = load_plant(self.get_parameter('plant').value or None)
        self._law = design(self._plant, self._settings.wanted, self._settings.design).law
        self._period_ns = round(SECOND * self._law.period)
        self._session = Session(self._law.period)
        self._simulated = self.get_parameter('use_sim_time').value
        self._inbox = Inbox(self)
        self._senses = Senses(self, self._inbox, self._settings)
        self._backend = TargetFrame(self, self._inbox, self.get_parameter('motion.frame').value)
        self._guard = Guard(self._senses, self._backend, self._session, self.get_clock(),
                            self._simulated)
        self._stream: StreamClock | None = None
        self._said = Status()
        self._sent = 0
        self._periods: deque[int] = deque(maxlen=REMEMBERED)
        self._phase_out = self.create_publisher(DiagnosticArray, 'impedance/phase', OUTPUT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        self.create_service(Trigger, 'impedance/start', self._on_start)
        self.create_service(Trigger, 'impedance/abort', self._on_abort)
        clock = None if self._simulated else STEADY
        self._timer = self.create_timer(self._law.period, self._tick, clock=clock)
        self.create_timer(0.02, self._watch_clock, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        self.get_logger().info('ready: impedance/start begins')

    def _values(self) -> dict[str, Any]:
        return {row.name: self.get_parameter(row.name).value for row in PARAMETERS}

    def destroy_node(self) -> None:
        """Free what the node holds."""
        self._inbox.close()
        super().destroy_node()  # type: ignore[no-untyped-call]

    # The loop -------------------------------------------------------------------------------

    def _tick(self) -> None:
        self._inbox.drain()
        steady = STEADY.now().nanoseconds
        self._senses.monitor.tick(steady * 1e-9)
        self._guard.listen(steady)
        if not self._session.streaming or self._stream is None:
            return
        if self._session.running:
            fault = self._guard.check(steady, self._session.moving)
            if fault:
                self._abort(fault.reason)
        now = self.get_clock().now().nanoseconds if self._simulated else steady
        slipped = self._stream.slipped_ns
        due = self._stream.due(now)
        if self._stream.slipped_ns != slipped:
            self._session.restart()
        for _ in range(due):
            if not self._send(self._stream.next_stamp()):
                break
        if self._session.status.phase != self._said.phase:
            self._announce()

    def _send(self, stamp_ns: int) -> bool:
        """Make one control step; say whether there was a command."""
        offset = self._session.step(self._heard())
        if offset is None:
            return False
        setpoint = Setpoint(Pose(self._home.position + offset * self._axis,
                                 self._home.R_base_sensor), np.zeros(3), np.zeros(3))
        pose = pose_numbers(setpoint.pose)
        self._senses.monitor.command(stamp_ns * 1e-9, pose)
        self._backend.send(stamp_ns, setpoint, pose)
        steady = STEADY.now().nanoseconds
        if self._sent:
            self._periods.append(steady - self._sent)
        self._sent = steady
        return True

    def _heard(self) -> Measurement:
        place = np.array(self._senses.newest('pose')[:3])
        return Measurement(float((place - self._home.position) @ self._axis),
                           self._senses.newest('optidrive')[0] - self._slide,
                           self._senses.newest('wrench')[0])

    def _watch_clock(self) -> None:
        """Abort where the ROS clock that drives the motion has stopped or jumped."""
        if not (self._simulated and self._session.streaming) or self._stream is None:
            return
        fault = self._guard.clock_fault(STEADY.now().nanoseconds)
        if fault and self._abort(fault.reason):
            while self._send(self._stream.next_stamp()):
                pass

    # Start and abort ------------------------------------------------------------------------

    def _on_start(self, request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        try:
            response.message = self._start()
            response.success = True
        except ForcecalError as error:
            response.success, response.message = False, str(error)
            self.get_logger().warning(f'not started: {error}', throttle_duration_sec=1.0)
        return response

    def _start(self) -> str:
        if self._session.running or self._session.streaming:
            raise MotionError(f'a task is under way already ({self._session.status.phase}); '
                              'abort it first')
        before, settings = self._settings, settings_of(self._values())
        if (settings.wanted, settings.design) != (before.wanted, before.design):
            self._law = design(self._plant, settings.wanted, settings.design).law
        self._settings = settings
        monitor = self._senses.monitor
        monitor.settings, monitor.limits = settings.watch, settings.limits
        self._inbox.drain()
        steady, ros = STEADY.now().nanoseconds, self.get_clock().now().nanoseconds
        if self._simulated and ros == 0:
            raise DataError('/clock: nothing received, and use_sim_time is set; start what '
                            'publishes it')
        monitor.tick(steady * 1e-9)
        monitor.begin(ros * 1e-9)
        if others := self._guard.others(steady):
            raise MotionError(others)
        self._home = Pose(monitor.mean('pose'),
                          matrix_from_quaternion(self._senses.newest('pose')[3:]))
        self._axis: Array = self._home.R_base_sensor[:, 0]
        self._slide = self._senses.newest('optidrive')[0]
        program = settings.task.program(settings.cycles)
        self._check_reach(program.farthest)
        self._session.start(program, settings.task.clearance, Regulator(self._law),
                            settings.bounds)
        self._begin_stream()
        return f'contact task started: {program.duration:.1f} s'

    def _check_reach(self, reach: tuple[float, float]) -> None:
        """Refuse a task whose reference takes sensor or tip out of the box."""
        limits, home = self._settings.limits, self._home
        places = home.position + np.outer(reach, self._axis)
        check_workspace(places, limits, 'the task: the sensor')
        # the tool stops at the wall, whatever the reference does behind it
        at_wall = home.position + np.outer(
            np.minimum(reach, self._settings.task.clearance), self._axis)
        check_workspace(at_wall + home.R_base_sensor @ limits.tip, limits, 'the task: the tip')

    def _begin_stream(self) -> None:
        """Begin the stream in the phase of the measured poses, and the timer with it."""
        ros = self.get_clock().now().nanoseconds
        stamp = phased(ros, round(self._senses.monitor.channels['pose'].stamp * SECOND),
                       self._period_ns)
        if not self._simulated:
            sleep((stamp - ros) / SECOND)
            self._timer.reset()
        steady = STEADY.now().nanoseconds
        self._guard.begin(steady)
        self._stream = StreamClock(self._period_ns, stamp if self._simulated else steady, stamp)
        self._sent = 0
        self._periods.clear()
        self._announce()

    def _on_abort(self, request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        response.success = self._abort('asked to by impedance/abort')
        response.message = 'stopping' if response.success else 'nothing is under way'
        return response

    def _abort(self, reason: str) -> bool:
        aborted = self._session.abort(reason)
        if aborted:
            self._announce()
        return aborted

    def stop(self) -> None:
        """Begin to come to rest, away from the wall, before the node goes."""
        self._abort('the impedance node was told to go')

    @property
    def at_rest(self) -> bool:
        """Whether the command stream has ended."""
        return not self._session.streaming

    # What is said ---------------------------------------------------------------------------

    def _announce(self) -> None:
        """Say a change of phase, and why where it is for the worse."""
        status = self._session.status
        if status.phase == 'aborted' and self._said.phase != 'aborted':
            self.get_logger().error(f'aborted: {status.reason}')
        self._say()

    def _say(self) -> None:
        self._said = status = self._session.status
        self._phase_out.publish(diagnostic_array(
            self, 'phase', 'error' if status.phase == 'aborted' else 'ok', status.phase,
            {'reason': status.reason, 'contacts': status.contacts, 'missed': status.missed}))

    def _report(self) -> None:
        self._say()
        status, channels = self._session.status, self._senses.monitor.channels.values()
        silent = [channel.topic for channel in channels if not channel.values]
        level = 'error' if status.phase == 'aborted' else 'warn' if silent else 'ok'
        message = f'{status.phase}: {status.reason}' if status.reason else status.phase
        if silent and not status.reason:
            message += f'; nothing received on {", ".join(silent)}'
        values: dict[str, object] = {'contacts': status.contacts, 'missed': status.missed,
                                     'commands held to the limits': status.limited}
        if self._periods:
            median, late = np.percentile(self._periods, (50.0, 99.0)) * 1e-6
            values['period, median [ms]'] = float(median)
            values['period, 99th percentile [ms]'] = float(late)
        if self._stream is not None:
            values['stream put off by [s]'] = self._stream.slipped_ns / SECOND
        self._diagnostics.publish(diagnostic_array(self, '', level, message, values))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('impedance', Impedance, arguments)


if __name__ == '__main__':
    raise SystemExit(main())
