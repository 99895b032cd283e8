"""The calibration sequence as a node: moves the robot, listens, identifies, publishes."""

from collections.abc import Sequence as Words
from pathlib import Path
from struct import error as StructError
from threading import Thread
from time import sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.calibration import Calibration
from forcecal_ros.calibration_file import save
from forcecal_ros.control.joints import JointSetpoint
from forcecal_ros.control.monitor import Monitor
from forcecal_ros.control.motion import Pose
from forcecal_ros.control.plan import check_wrench, Goal, prepare, SEQUENCES
from forcecal_ros.control.sequence import Command, Sequence, Status
from forcecal_ros.control.stream import phased, StreamClock
from forcecal_ros.errors import DataError, ForcecalError, MotionError
from forcecal_ros.geometry import matrix_from_quaternion
from forcecal_ros.identify.pipeline import identify
from forcecal_ros.nodes.backends import JointTrajectories, pose_numbers, TargetFrame, TwistCommands
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.parameters import declare, guard
from forcecal_ros.nodes.reporting import diagnostic_array
from forcecal_ros.nodes.results import calibration_message, gain_message, inertia_message
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT, run, STEADY
from forcecal_ros.nodes.sequencer_settings import ACCELEROMETERS, PARAMETERS, settings_of
from forcecal_ros.nodes.wire import frame_of, JointReader, Reader, stamp_of
from forcecal_ros.observe.gains import with_kalman_gains
from geometry_msgs.msg import (
    AccelStamped,
    InertiaStamped,
    PoseStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray, Header, String
from std_srvs.srv import Trigger

SECOND = 1_000_000_000
CLOCK_JUMP = 0.1
"""The clock of the stamps may depart from the steady one by that much in a sequence [s]."""

CLOCK_STOPPED = 0.1
"""A /clock that stands for longer ends the sequence [s]."""

STALL = 0.5
"""A motion whose commands ceased for longer is not resumed [s]."""

FOREIGN = 0.5
"""Commands of someone else that are more recent than this forbid a start [s]."""

LOOK = 5
"""Stillness is judged every so many commands."""

ACCELEROMETER_TYPES = {'raw': Vector3Stamped, 'imu': Imu, 'accel': AccelStamped}


class Sequencer(Node):
    """Runs one sequence at a time, from start to done or aborted."""

    def __init__(self) -> None:
        super().__init__('sequencer')
        declare(self, PARAMETERS)
        settings = settings_of(self._values())
        guard(self, lambda changes: settings_of({**self._values(), **changes}))
        self._settings = settings
        self._sequence = Sequence(settings.stream)
        self._stream: StreamClock | None = None
        self._command: Command | None = None
        self._worker: Thread | None = None
        self._result: Calibration | str | None = None
        self._calibration: Calibration | None = None
        self._said = Status()
        self._ticked = 0
        self._looked = 0
        self._stillness = None
        self._simulated = self.get_parameter('use_sim_time').value
        self._inbox = Inbox(self)
        self._listen()
        self._make_backend()
        self._make_outputs()
        clock = None if self._simulated else STEADY
        self._timer = self.create_timer(1 / settings.stream.rate, self._tick, clock=clock)
        self.create_timer(0.02, self._watch_clock, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        self._say()
        self.get_logger().info('ready: sequencer/start begins')

    def _values(self) -> dict[str, Any]:
        return {row.name: self.get_parameter(row.name).value for row in PARAMETERS}

    def destroy_node(self) -> None:
        """Free what the node holds."""
        self._inbox.close()
        super().destroy_node()

    # Sensors in -----------------------------------------------------------------------------

    def _listen(self) -> None:
        source = self.get_parameter('accelerometer.source').value
        topics = {'wrench': 'wrench', 'pose': 'current_pose'}
        if source != 'none':
            topics['accelerometer'] = ACCELEROMETERS[source]
        self._collector = Collector('V' if source == 'raw' else 'm/s^2',
                                    self.get_parameter('wrench.sign').value)
        self._monitor = Monitor(self._settings.watch, self._settings.limits, topics)
        self._raw_heard: dict[str, bytes] = {}
        self._hear('wrench', WrenchStamped, topics['wrench'], self._monitor.wrench)
        self._hear('pose', PoseStamped, topics['pose'], self._monitor.pose)
        if source != 'none':
            def accelerometer(stamp: float, values: tuple[float, ...]) -> None:
                self._monitor.other('accelerometer', stamp, values)

            self._hear('accelerometer', ACCELEROMETER_TYPES[source], topics['accelerometer'],
                       accelerometer)
        self._hear('optidrive', JointState, 'optidrive', None)
        self._deadman_heard = 0
        self._deadman_timeout = round(
            self.get_parameter('motion.deadman_timeout').value * SECOND)
        if self._deadman_timeout:
            self._inbox.subscribe(Header, 'deadman', self._on_deadman)

    def _hear(self, channel: str, message_type: Any, topic: str, watch: Any) -> None:
        """Subscribe: every sample goes to the watch, and to the collector while it runs."""
        if message_type is JointState:
            read: Any = JointReader(self.get_parameter('optidrive.joint').value)
        else:
            read = Reader(message_type)
        add, sequence, heard = self._collector.add, self._sequence, self._raw_heard

        def on_sample(raw: bytes) -> None:
            try:
                sample = read(raw)
            except StructError:
                return
            if sample is None:
                return
            stamp_ns, values = sample
            heard[channel] = raw
            if watch is not None:
                watch(stamp_ns * 1e-9, values)
            if sequence.streaming:
                add(channel, stamp_ns, values)

        self._inbox.subscribe(message_type, topic, on_sample)

    def _on_deadman(self, raw: bytes) -> None:
        self._deadman_heard = STEADY.now().nanoseconds

    # Commands out ---------------------------------------------------------------------------

    def _make_backend(self) -> None:
        frame = self.get_parameter('motion.frame').value
        kind = self.get_parameter('motion.backend').value
        self._backend: TargetFrame | TwistCommands | JointTrajectories
        if kind == 'joint_trajectory':
            self._backend = JointTrajectories(
                self, self._inbox, self.get_parameter('joints.names').value)
        elif kind == 'delta_twist_cmds':
            gain = self.get_parameter('motion.twist_gain').value
            self._backend = TwistCommands(self, self._inbox, frame, gain)
        else:
            self._backend = TargetFrame(self, self._inbox, frame)
        self._foreign, self._foreign_heard = 0, -SECOND

    def _send(self, stamp_ns: int, command: Command) -> None:
        self._command = command
        if isinstance(self._backend, JointTrajectories):
            assert isinstance(command, JointSetpoint)
            self._backend.send(command, self._period_ns)
            return
        assert not isinstance(command, JointSetpoint)
        pose = pose_numbers(command.pose)
        self._monitor.command(stamp_ns * 1e-9, pose)
        self._collector.add('target', stamp_ns, pose)
        if isinstance(self._backend, TwistCommands):
            self._backend.measured = self._monitor.channels['pose'].values
        self._backend.send(stamp_ns, command, pose)

    @property
    def _period_ns(self) -> int:
        return round(SECOND / self._settings.stream.rate)

    # The stream -----------------------------------------------------------------------------

    def _now(self) -> int:
        """Time on the clock that drives the motion [ns]."""
        clock = self.get_clock() if self._simulated else STEADY
        return clock.now().nanoseconds

    def _tick(self) -> None:
        self._inbox.drain()
        steady = STEADY.now().nanoseconds
        self._monitor.tick(steady * 1e-9)
        self._note_foreign(steady)
        if self._worker is not None and not self._worker.is_alive():
            self._take_result()
        if not self._sequence.streaming or self._stream is None:
            self._ticked = steady
            return
        self._guard_motion(steady)
        slipped = self._stream.slipped_ns
        due = self._stream.due(self._now())
        if self._stream.slipped_ns != slipped:
            self._sequence.restart()
        for _ in range(due):
            stamp = self._stream.next_stamp()
            command = self._sequence.step(self._judge())
            if command is None:
                break
            self._announce(stamp)
            self._send(stamp, command)
        self._ticked = steady
        if self._sequence.moved and not self._sequence.streaming and self._worker is None:
            if SEQUENCES[self._settings.sequence].identifies:
                self._identify()
            else:
                self._finish()

    def _guard_motion(self, steady: int) -> None:
        """Abort where a sensor, the robot, a clock or a person says so."""
        if not self._sequence.running or self._sequence.moved:
            return
        moving = self._command is not None and self._command.moving
        silent = (steady - self._ticked) / SECOND
        if moving and silent > STALL and not self._simulated:
            self._abort(f'the command stream stalled for {silent:.2f} s; '
                        'the machine is overloaded', at_once=True)
            return
        ros = self.get_clock().now().nanoseconds
        drift = ros - steady - self._clock_offset
        if not self._simulated and abs(drift) > CLOCK_JUMP * SECOND:
            self._abort(f'the system clock jumped by {drift / SECOND:.2f} s')
            return
        fault = (self._monitor.check(moving) or self._others_fault(steady)
                 or self._stand_while_in_doubt(steady, ros))
        if fault:
            self._abort(fault)

    def _others_fault(self, steady: int) -> str:
        quiet = steady - self._deadman_heard
        if 0 < self._deadman_timeout < quiet:
            return f'deadman: silent for {quiet / SECOND:.3f} s'
        if self._foreign_heard > self._started:
            return f'{self._backend.topic}: another node commands the robot'
        return ''

    def _stand_while_in_doubt(self, steady: int, ros: int) -> str:
        """Pause while a sensor is silent or late; say so where that lasts for too long."""
        doubt = self._monitor.doubt(ros * 1e-9)
        self._sequence.pause(bool(doubt))
        if not doubt:
            self._in_doubt_since = None
            return ''
        if self._in_doubt_since is None:
            self._in_doubt_since = steady
            self._pauses += 1
            self.get_logger().warning(f'standing: {doubt}', throttle_duration_sec=1.0)
        lost = self._settings.watch.lost_timeout - self._settings.watch.pause_timeout
        return doubt if steady - self._in_doubt_since > lost * SECOND else ''

    def _watch_clock(self) -> None:
        """Abort where the ROS clock that drives the motion has stopped or jumped."""
        if not (self._simulated and self._sequence.streaming):
            return
        now, steady = self._now(), STEADY.now().nanoseconds
        if now != self._clock_seen:
            jumped = not 0 < now - self._clock_seen < SECOND
            self._clock_seen, self._clock_moved = now, steady
            if jumped:
                self._abort('/clock jumped', at_once=True)
        elif steady - self._clock_moved > CLOCK_STOPPED * SECOND:
            self._abort('/clock has stopped', at_once=True)
            while (command := self._sequence.step()) is not None:
                self._send(self._stream.next_stamp(), command)

    def _note_foreign(self, steady: int) -> None:
        if self._backend.foreign != self._foreign:
            self._foreign, self._foreign_heard = self._backend.foreign, steady

    def _judge(self) -> Any:
        if not self._sequence.settling:
            self._stillness = None
            return None
        self._looked += 1
        if self._stillness is None or self._looked % LOOK == 0:
            self._stillness = self._monitor.stillness()
        return self._stillness

    # Start, abort, save ---------------------------------------------------------------------

    def _on_start(self, request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        try:
            response.message = self._start()
            response.success = True
        except ForcecalError as error:
            response.success, response.message = False, str(error)
            self.get_logger().warning(f'not started: {error}')
        return response

    def _start(self) -> str:
        if self._sequence.running or self._sequence.streaming or self._worker is not None:
            raise MotionError(f'a sequence is under way already ({self._sequence.status.phase} '
                              f'{self._sequence.status.label}); abort it first')
        self._settings = settings = settings_of(self._values())
        self._monitor.settings, self._monitor.limits = settings.watch, settings.limits
        self._inbox.drain()
        steady, ros = STEADY.now().nanoseconds, self.get_clock().now().nanoseconds
        if self._simulated and ros == 0:
            raise DataError('/clock: nothing received, and use_sim_time is set; start what '
                            'publishes it')
        self._monitor.tick(steady * 1e-9)
        self._monitor.begin(ros * 1e-9)
        self._check_others(steady)
        start = self._where()
        goals, away = settings.goals(start)
        program = SEQUENCES[settings.sequence]
        plan = program.plan(goals, away, settings.timing)
        parts = prepare(plan, start, settings.pace, settings.limits)
        check_wrench(parts, self._monitor.mean('wrench'), settings.limits)
        self.get_logger().info(f'{settings.sequence} starts, with poses '
                               f'{", ".join(settings.poses)}')
        self._collector.clear()
        for channel, raw in self._raw_heard.items():
            self._collector.frames[channel] = frame_of(raw)
        self._sequence.settings = settings.stream
        self._sequence.start(parts, start, 'identification' if program.identifies else '')
        self._begin_stream()
        return f'{settings.sequence} started'

    def _check_others(self, steady: int) -> None:
        self._note_foreign(steady)
        if steady - self._foreign_heard < FOREIGN * SECOND:
            raise MotionError(f'{self._backend.topic}: another node commands the robot; stop it')
        if self._deadman_timeout and steady - self._deadman_heard > self._deadman_timeout:
            raise MotionError('deadman: nothing received; press the switch, or set '
                              'motion.deadman_timeout to 0.0')

    def _where(self) -> Goal:
        """Return where the robot stands: the first command."""
        if isinstance(self._backend, JointTrajectories):
            return self._backend.where()
        values = self._monitor.channels['pose'].values
        return Pose(self._monitor.mean('pose'), matrix_from_quaternion(values[3:]))

    def _begin_stream(self) -> None:
        """Begin the stream in the phase of the measured poses, and the timer with it."""
        period = self._period_ns
        ros = self.get_clock().now().nanoseconds
        stamp = phased(ros, stamp_of(self._raw_heard['pose']), period)
        if not self._simulated:
            sleep((stamp - ros) / SECOND)
            self._timer.reset()
        steady = STEADY.now().nanoseconds
        self._clock_offset = self.get_clock().now().nanoseconds - steady
        self._clock_seen, self._clock_moved = self._now(), steady
        self._started = self._ticked = steady
        self._in_doubt_since, self._pauses = None, 0
        self._stream = StreamClock(period, stamp if self._simulated else steady, stamp)
        self._command = None
        self._announce(stamp)

    def _on_abort(self, request: Trigger.Request, response: Trigger.Response
                  ) -> Trigger.Response:
        response.success = self._abort('asked to by sequencer/abort')
        response.message = 'stopping' if response.success else 'nothing is under way'
        return response

    def _abort(self, reason: str, *, at_once: bool = False) -> bool:
        aborted = self._sequence.abort(reason, at_once=at_once)
        if aborted:
            self.get_logger().error(f'aborted: {reason}')
            self._announce(self.get_clock().now().nanoseconds)
        return aborted

    def stop(self) -> None:
        """Begin to come to rest, before the node goes."""
        self._abort('the sequencer was told to go')

    @property
    def at_rest(self) -> bool:
        """Whether the command stream has ended."""
        return not self._sequence.streaming

    def _on_save(self, request: Trigger.Request, response: Trigger.Response
                 ) -> Trigger.Response:
        try:
            response.message = self._save()
            response.success = True
        except ForcecalError as error:
            response.success, response.message = False, str(error)
        return response

    def _save(self) -> str:
        if self._calibration is None:
            raise DataError('there is no calibration yet; call sequencer/start')
        path = Path(self.get_parameter('save.path').value).expanduser().absolute()
        save(self._calibration, path)
        return f'written to {path}'

    # Identification -------------------------------------------------------------------------

    def _identify(self) -> None:
        recording, settings = self._collector.recording(), self._settings.identification
        self._result = None

        def work() -> None:
            try:
                self._result = with_kalman_gains(identify(recording, settings))
            except ForcecalError as error:
                self._result = str(error)
            except Exception as error:
                self._result = f'identification failed: {type(error).__name__}: {error}'
                raise

        self._worker = Thread(target=work, name='identify', daemon=True)
        self._worker.start()

    def _take_result(self) -> None:
        self._worker, result = None, self._result
        if not self._sequence.running:
            return
        if not isinstance(result, Calibration):
            self._abort(' '.join(str(result).split()))
            return
        self._calibration = result
        self._calibration_out.publish(calibration_message(result))
        self._inertia_out.publish(inertia_message(result))
        if result.observer is not None:
            self._gain_out.publish(gain_message(result))
        self._finish()
        if self.get_parameter('save.automatic').value:
            try:
                self.get_logger().info(self._save())
            except ForcecalError as error:
                self.get_logger().error(str(error))

    def _finish(self) -> None:
        self._sequence.finish()
        self._announce(self.get_clock().now().nanoseconds)

    # What is said ---------------------------------------------------------------------------

    def _make_outputs(self) -> None:
        self._phase_out = self.create_publisher(DiagnosticArray, 'sequencer/phase', OUTPUT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        self._calibration_out = self.create_publisher(String, 'sequencer/calibration', LATCHED)
        self._gain_out = self.create_publisher(
            Float64MultiArray, 'sequencer/observer_gain', LATCHED)
        self._inertia_out = self.create_publisher(
            InertiaStamped, 'sequencer/tool_inertia', LATCHED)
        self.create_service(Trigger, 'sequencer/start', self._on_start)
        self.create_service(Trigger, 'sequencer/abort', self._on_abort)
        self.create_service(Trigger, 'sequencer/save_calibration', self._on_save)

    def _announce(self, stamp_ns: int) -> None:
        """Say a change of phase, stamped with the command it begins with."""
        status = self._sequence.status
        if status.phase != self._said.phase or status.label != self._said.label:
            if self._sequence.streaming:
                self._collector.enter(status.phase, stamp_ns)
            self._say(stamp_ns)

    def _say(self, stamp_ns: int | None = None) -> None:
        self._said = status = self._sequence.status
        stamp = None if stamp_ns is None else Time(nanoseconds=stamp_ns)
        self._phase_out.publish(diagnostic_array(
            self, 'phase', 'error' if status.phase == 'aborted' else 'ok', status.phase,
            {'for': status.label, 'reason': status.reason, 'progress': status.progress,
             'sequence': self._settings.sequence}, stamp))

    def _report(self) -> None:
        self._say()
        status, monitor = self._sequence.status, self._monitor
        values = {f'{channel.topic}': 'heard' if channel.values else 'nothing received'
                  for channel in monitor.channels.values()}
        silent = [channel.topic for channel in monitor.channels.values() if not channel.values]
        level = 'error' if status.phase == 'aborted' else 'warn' if silent else 'ok'
        message = f'{status.phase}: {status.reason}' if status.reason else status.phase
        if silent and not status.reason:
            message += f'; nothing received on {", ".join(silent)}'
        if self._stream is not None:
            values['stream put off by [s]'] = self._stream.slipped_ns / SECOND
            values['pauses'] = self._pauses
        self._diagnostics.publish(diagnostic_array(self, '', level, message, values))


def main(arguments: Words[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('sequencer', Sequencer, arguments)


if __name__ == '__main__':
    raise SystemExit(main())
