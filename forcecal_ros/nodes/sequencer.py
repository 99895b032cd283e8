"""The calibration sequence as a node: moves the robot, listens, identifies, publishes."""

from collections.abc import Sequence as Words
from pathlib import Path
from threading import Thread
from time import sleep
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.calibration.file import load, save
from forcecal_ros.calibration.model import Calibration
from forcecal_ros.calibration.sensor_matrix import required_six_axis, SixAxis, with_matrix_of
from forcecal_ros.errors import ConfigError, DataError, ForcecalError, MotionError
from forcecal_ros.geometry import matrix_from_quaternion
from forcecal_ros.identify.pipeline import identify
from forcecal_ros.motion.joints import JointSetpoint
from forcecal_ros.motion.monitor import Stillness
from forcecal_ros.motion.plan import check_wrench, Goal, prepare
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.motion.programs import SEQUENCES
from forcecal_ros.motion.sequence import Command, Sequence, Status
from forcecal_ros.motion.stream import phased, StreamClock
from forcecal_ros.nodes.backends import JointTrajectories, pose_numbers, TargetFrame, TwistCommands
from forcecal_ros.nodes.guard import Guard
from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.parameters import declare
from forcecal_ros.nodes.reporting import diagnostic_array
from forcecal_ros.nodes.results import calibration_message, gain_message, inertia_message
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT, run, SECOND, STEADY
from forcecal_ros.nodes.sensors import Sensors
from forcecal_ros.nodes.sequencer_settings import PARAMETERS, settings_of
from forcecal_ros.observe.gains import with_kalman_gains
from geometry_msgs.msg import InertiaStamped
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

UNSEEN = ('where joint vectors lead is not known beforehand: limits.workspace, speed, force and '
          'torque are held as measured, not as planned')
"""What a start with joints says, since a sequencer that knows no kinematics plans blindly."""

LOOK = 5
"""Stillness is judged every so many commands."""


class Sequencer(Node):
    """Runs one sequence at a time, from start to done or aborted."""

    def __init__(self) -> None:
        super().__init__('sequencer')
        declare(self, PARAMETERS, lambda changes: settings_of({**self._values(), **changes}))
        settings = settings_of(self._values())
        self._settings = settings
        self._sequence = Sequence(settings.stream)
        self._stream: StreamClock | None = None
        self._command: Command | None = None
        self._worker: Thread | None = None
        self._result: Calibration | str | None = None
        self._calibration: Calibration | None = None
        self._said = Status()
        self._looked = 0
        self._stillness: Stillness | None = None
        self._simulated = self.get_parameter('use_sim_time').value
        self._inbox = Inbox(self)
        self._matrix, part = self._load_matrix()
        self._sensors = Sensors(self, self._inbox, settings.watch, settings.limits,
                                lambda: self._sequence.streaming, part)
        self._monitor = self._sensors.monitor
        self._make_backend()
        self._guard = Guard(self._sensors, self._backend, self._sequence, self.get_clock(),
                            self._simulated)
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
        super().destroy_node()  # type: ignore[no-untyped-call]

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

    def _send(self, stamp_ns: int, command: Command) -> None:
        self._command = command
        if isinstance(self._backend, JointTrajectories):
            assert isinstance(command, JointSetpoint)
            self._monitor.joints(stamp_ns * 1e-9, tuple(command.positions.tolist()))
            self._backend.send(command, self._period_ns)
            return
        assert not isinstance(command, JointSetpoint)
        pose = pose_numbers(command.pose)
        self._monitor.command(stamp_ns * 1e-9, pose)
        self._sensors.collector.add('target', stamp_ns, pose)
        if isinstance(self._backend, TwistCommands):
            self._backend.measured = self._sensors.pose
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
        self._guard.listen(steady)
        if self._worker is not None and not self._worker.is_alive():
            self._take_result()
        if not self._sequence.streaming or self._stream is None:
            return
        self._check_motion(steady)
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
        if self._sequence.moved and not self._sequence.streaming and self._worker is None:
            if SEQUENCES[self._settings.sequence].identifies:
                self._identify()
            else:
                self._finish()

    def _check_motion(self, steady: int) -> None:
        if not self._sequence.running or self._sequence.moved:
            return
        pauses = self._guard.pauses
        fault = self._guard.check(steady, self._command is not None and self._command.moving)
        if fault:
            self._abort(fault.reason, at_once=fault.at_once)
        elif astray := self._backend.astray(self._settings.limits.tracking_angle):
            self._abort(astray)
        elif self._guard.pauses > pauses:
            self.get_logger().warning(f'standing: {self._guard.doubt}')

    def _watch_clock(self) -> None:
        """Abort where the ROS clock that drives the motion has stopped or jumped."""
        if not (self._simulated and self._sequence.streaming) or self._stream is None:
            return
        fault = self._guard.clock_fault(STEADY.now().nanoseconds)
        if fault and self._abort(fault.reason, at_once=fault.at_once):
            while (command := self._sequence.step()) is not None:
                self._send(self._stream.next_stamp(), command)

    def _judge(self) -> Stillness | None:
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
            self.get_logger().warning(f'not started: {error}', throttle_duration_sec=1.0)
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
        if others := self._guard.others(steady):
            raise MotionError(others)
        start = self._where()
        goals, away = settings.goals(start)
        program = SEQUENCES[settings.sequence]
        plan = program.plan(goals, away, settings.timing)
        parts = prepare(plan, start, settings.pace, settings.limits)
        check_wrench(parts, self._monitor.mean('wrench'), settings.limits)
        self.get_logger().info(f'{settings.sequence} starts, with poses '
                               f'{", ".join(settings.poses)}')
        if isinstance(self._backend, JointTrajectories):
            self.get_logger().warning(UNSEEN)
        self._sensors.begin_recording()
        self._sequence.settings = settings.stream
        self._sequence.start(parts, start, 'identification' if program.identifies else '')
        self._begin_stream()
        if isinstance(self._backend, JointTrajectories):
            return f'{settings.sequence} started; {UNSEEN}'
        return f'{settings.sequence} started'

    def _where(self) -> Goal:
        """Return where the robot stands: the first command."""
        if isinstance(self._backend, JointTrajectories):
            return self._backend.where()
        return Pose(self._monitor.mean('pose'), matrix_from_quaternion(self._sensors.pose[3:]))

    def _begin_stream(self) -> None:
        """Begin the stream in the phase of the measured poses, and the timer with it."""
        period = self._period_ns
        ros = self.get_clock().now().nanoseconds
        stamp = phased(ros, self._sensors.pose_stamp_ns, period)
        if not self._simulated:
            sleep((stamp - ros) / SECOND)
            self._timer.reset()
        steady = STEADY.now().nanoseconds
        self._guard.begin(steady)
        self._backend.begin()
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

    def _load_matrix(self) -> tuple[Calibration | None, SixAxis | None]:
        name = self.get_parameter('wrench.matrix_file').value
        if not name:
            return None, None
        if self.get_parameter('wrench.sign').value != 1:
            raise ConfigError('wrench.matrix_file gives wrenches of the right sign already; '
                              'set wrench.sign to 1')
        source = load(Path(name).expanduser())
        return source, required_six_axis(source, name)

    def _identify(self) -> None:
        collector, settings = self._sensors.collector, self._settings.identification
        matrix = self._matrix
        self._result = None

        def work() -> None:
            try:
                found = identify(collector.recording(), settings)
                if matrix is not None:
                    found = with_matrix_of(found, matrix)
                self._result = with_kalman_gains(found)
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
                self._sensors.collector.enter(status.phase, stamp_ns)
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
        values: dict[str, object] = {
            channel.topic: 'heard' if channel.values else 'nothing received'
            for channel in monitor.channels.values()}
        silent = [channel.topic for channel in monitor.channels.values() if not channel.values]
        level = 'error' if status.phase == 'aborted' else 'warn' if silent else 'ok'
        message = f'{status.phase}: {status.reason}' if status.reason else status.phase
        if silent and not status.reason:
            message += f'; nothing received on {", ".join(silent)}'
        if self._stream is not None:
            values['stream put off by [s]'] = self._stream.slipped_ns / SECOND
            values['pauses'] = self._guard.pauses
        self._diagnostics.publish(diagnostic_array(self, '', level, message, values))


def main(arguments: Words[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('sequencer', Sequencer, arguments)


if __name__ == '__main__':
    raise SystemExit(main())
