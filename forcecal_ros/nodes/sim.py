"""The simulated rig as a node: follows ``target_frame``, publishes its sensors, injects faults."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from struct import error as StructError
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.errors import ConfigError, MotionError
from forcecal_ros.core.geometry import matrix_from_quaternion, quaternion_of
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.nodes import runtime
from forcecal_ros.nodes.runtime import OUTPUT, STEADY, STREAM
from forcecal_ros.nodes.wire import Reader, ReceivingNode, Writer
from forcecal_ros.sim.rig import faults
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import (
    CommandSchedule,
    Samples,
    Simulator,
    waits_for_compiler,
    warm_up,
)
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Imu, JointState

PREFIX = 'fault.'


def _row(name: str, what: str, kinds: dict[str, str]) -> Parameter:
    meaning = '; '.join(f'{word}: {meaning}' for word, meaning in kinds.items())
    return Parameter(PREFIX + name, 'none', f'Fault of {what}, applied at once. {meaning}',
                     choices=tuple(kinds), live=True)


FAULT_PARAMETERS = (
    *(_row(sensor, f'the sensor {sensor}', faults.FAULTS) for sensor in faults.SENSORS),
    _row('robot', 'the robot', faults.ROBOT_FAULTS),
    _row('clock', 'the clock that is published', faults.CLOCK_FAULTS),
)


class Faults:
    """
    The injected faults of one simulated rig.

    Parameters
    ----------
    node : Node
        Has declared ``PARAMETERS``.
    seed : int or None
        Of garbage readings.
    jump : callable or None
        Makes the published clock jump [ns]; None where no clock is published.

    Attributes
    ----------
    robot : RobotFault
        Changes each command, or drops it.
    """

    def __init__(self, node: Node, seed: int | None, jump: Callable[[int], None] | None) -> None:
        self._sensors = {sensor: faults.SensorFault(sensor, seed) for sensor in faults.SENSORS}
        self.robot = faults.RobotFault()
        self._jump = jump
        self._clock = 'none'
        runtime.refuse_changes(node, self._check)
        node.add_post_set_parameters_callback(
            lambda changes: self._set({change.name: change.value for change in changes}))
        start = runtime.values_of(node, FAULT_PARAMETERS)
        self._check(start)
        self._set(start)

    def _check(self, values: dict[str, Any]) -> None:
        if self._jump is None and values.get('fault.clock', 'none') != 'none':
            raise ConfigError('fault.clock requires a clock that this node publishes; set '
                              'clock.publish')

    def _set(self, values: dict[str, Any]) -> None:
        for name, kind in values.items():
            part = name.removeprefix(PREFIX)
            if name == part:
                continue
            if part != 'clock':
                (self.robot if part == 'robot' else self._sensors[part]).kind = kind
                continue
            before, self._clock = self._clock, kind
            if self._jump is not None and kind != before and kind in ('forward', 'back'):
                self._jump(round(faults.CLOCK_JUMP * 1e9) * (1 if kind == 'forward' else -1))

    @property
    def clock_stopped(self) -> bool:
        """Whether the published clock stands still."""
        return self._clock == 'stopped'

    @property
    def active(self) -> list[str]:
        """The faults that are switched on, such as ``wrench stuck``."""
        named = [*((s, f.kind) for s, f in self._sensors.items()), ('robot', self.robot.kind),
                 ('clock', self._clock)]
        return [f'{name} {kind}' for name, kind in named if kind != 'none']

    def changed(self, samples: Samples) -> Samples:
        """Return the samples after faults of the sensors."""
        for fault in self._sensors.values():
            samples = fault(samples)
        return samples


PARAMETERS = (
    runtime.EXECUTOR,
    Parameter('rig', '', 'Rig file (YAML); empty: the nominal rig'),
    Parameter('accelerometer', '', 'Mounted accelerometer; empty: that of the rig file',
              choices=('', 'acc1', 'acc2')),
    Parameter('seed', -1, 'Seed of the noise; -1: random at each start', low=-1, high=2**31),
    Parameter('noise', True, 'Whether the sensors are noisy'),
    Parameter('speed', 1.0,
              'Simulated seconds per second; if not 1, /clock is published', low=0.1, high=20.0),
    Parameter('clock.publish', False,
              "Publish /clock; otherwise a rig with use_sim_time requires another node's /clock"),
    Parameter('clock.wait', 0.0,
              'Longest wait of /clock for a command, on a busy computer', 's', 0.0, 10.0),
    Parameter('latency', 0.004,
              'Delay of the simulation to let commands arrive, not in stamps', 's', 0.0, 0.1),
    Parameter('imu.publish', False, 'Also publish imu/data_raw, scaled specific force'),
    Parameter('frames.base', 'base', 'frame_id of poses; commands in another frame are ignored'),
    Parameter('frames.sensor', 'ft_sensor', 'frame_id of wrenches'),
    Parameter('frames.accelerometer', 'accelerometer', 'frame_id of the accelerometer'),
    *FAULT_PARAMETERS,
)

LONGEST_BACKLOG = 0.5
"""Time is skipped instead of caught up after a longer stall or a jump of the clock; to catch up
with this takes 0.25 s [s]."""


class Sim(ReceivingNode):
    """A simulated rig, live."""

    def __init__(self) -> None:
        super().__init__('sim', PARAMETERS)
        value = self._values()
        self._rig = load_rig(Path(value['rig']) if value['rig'] else None)
        if waits_for_compiler():
            self.get_logger().info('compiling the simulator; this takes about 10 s, on the first '
                                   'run only')
        warm_up()
        self._simulator = Simulator(
            self._rig, value['accelerometer'] or None,
            value['seed'] if value['seed'] >= 0 else None)
        self._noise, accelerometer = value['noise'], self._rig.accelerometer
        mounted = getattr(accelerometer, value['accelerometer'] or accelerometer.mounted)
        self._variance = (accelerometer.noise / float(np.abs(mounted.gain).min())) ** 2
        self._frame = value['frames.base']
        self._make_clock(value)
        self._make_publishers(value)
        self._read = Reader(PoseStamped)
        self._ignored = 0
        self._received = self._reported = -10**12
        self._last_command: Sequence[float] | None = None
        self._faults = Faults(self, value['seed'] if value['seed'] >= 0 else None,
                              self._jump if self._own_clock else None)
        self._inbox.subscribe(PoseStamped, 'target_frame', self._on_target)
        period = max(0.001, self._period_ns * 1e-9 / self._speed)
        self.create_timer(period, self._tick, clock=STEADY)
        self.create_timer(1.0, self._report, clock=STEADY)
        self._waiting = runtime.Waiting(self)
        clock = '; publishes /clock' if self._own_clock else ''
        self.get_logger().info(f'up: {value["rig"] or "the nominal rig"} holds still until '
                               f'commands arrive on target_frame{clock}')

    # Time -----------------------------------------------------------------------------------

    def _make_clock(self, value: dict[str, Any]) -> None:
        self._speed = value['speed']
        self._own_clock = value['clock.publish'] or self._speed != 1.0
        self._wait_ns = round(value['clock.wait'] * 1e9)
        self._latency_ns = round(value['latency'] * 1e9 * self._speed)
        self._period_ns = round(self._rig.robot.period * 1e9)
        # periods simulated in one tick at most, so that a late node catches up at three times the
        # speed; its own clock runs no faster than that
        self._most = max(3, round(2 * self._speed))
        self._ticked = STEADY.now().nanoseconds
        self._own_time = runtime.SYSTEM.now().nanoseconds
        self._schedule: CommandSchedule | None = None
        if self._own_clock:
            self._clock_out = self.create_publisher(ClockMessage, '/clock', OUTPUT)

    def _now(self) -> int:
        return self._own_time if self._own_clock else self.get_clock().now().nanoseconds

    def _jump(self, by: int) -> None:
        """Let the published clock jump by some time [ns], and the simulation with it."""
        self._own_time += by
        if self._schedule is not None:
            self._begin(self._now())

    def _begin(self, now: int) -> CommandSchedule:
        """Begin a schedule, with period 0 at the next whole period of the clock."""
        self._start = -(-now // self._period_ns) * self._period_ns
        self._next = 0
        self._schedule = (self._schedule.restarted(self._start) if self._schedule is not None
                          else CommandSchedule(self._period_ns, self._start))
        self._sample0 = self._start - round(self._simulator.time * 1e9)
        return self._schedule

    def _pass(self, elapsed: int, steady: int) -> None:
        """Advance the own clock, at most to where the next command is needed."""
        now = self._own_time + elapsed
        if self._schedule is not None and steady - self._received < self._wait_ns:
            self._inbox.drain()
            now = min(now, self._schedule.commanded_ns + self._period_ns + self._latency_ns - 1)
        self._own_time = max(self._own_time, now)

    def _tick(self) -> None:
        steady = STEADY.now().nanoseconds
        if not self._faults.clock_stopped:
            self._pass(round((steady - self._ticked) * self._speed), steady)
        self._ticked = steady
        now = self._now()
        if now <= 0:
            return
        schedule = self._schedule or self._begin(now)
        due = (now - self._latency_ns - self._start) // self._period_ns - self._next
        if self._own_clock:
            late = max(0, due - self._most)
            self._own_time -= late * self._period_ns
            due -= late
            message = ClockMessage()
            message.clock = Time(nanoseconds=self._own_time).to_msg()
            self._clock_out.publish(message)
        if abs(due) * self._period_ns > (LONGEST_BACKLOG + 1) * 1e9 * self._speed:
            self.get_logger().warning(
                f'the clock is {due * self._period_ns * 1e-9:.3g} s ahead; time is skipped')
            self._begin(now)
            return
        for _ in range(min(due, self._most)):
            self._inbox.drain()
            self._advance(schedule)

    def _advance(self, schedule: CommandSchedule) -> None:
        command = schedule.take(self._next)
        self._last_command = command or self._last_command
        runaway = self._faults.robot.kind == 'runaway'  # moves without new commands
        if self._last_command is not None and (command or runaway):
            self._follow(self._last_command)
        self._publish(self._faults.changed(self._simulator.advance(self._noise)))
        self._next += 1

    def _follow(self, command: Sequence[float]) -> None:
        position = self._faults.robot(np.array(command[:3]), self._rig.robot.period)
        if position is None:
            return
        try:
            self._simulator.command(position, matrix_from_quaternion(command[3:]))
        except (MotionError, ValueError) as error:
            self._ignore(f'target_frame: {error}')
            self._last_command = None

    # Messages -------------------------------------------------------------------------------

    def _on_target(self, raw: bytes) -> None:
        if self._schedule is None:
            return
        try:
            stamp, values, frame = self._read(raw)
        except StructError:
            return
        if frame != self._frame:
            self._ignore(f'target_frame is in {frame!r}, the robot base is {self._frame!r}')
            return
        self._received = STEADY.now().nanoseconds
        self._schedule.add(stamp, self._now(), self._next, values)

    def _ignore(self, why: str) -> None:
        self._ignored += 1
        self.get_logger().warning(f'command ignored: {why}', throttle_duration_sec=1.0)

    def _make_publishers(self, value: dict[str, Any]) -> None:
        frames = {name: value[f'frames.{name}'] for name in ('sensor', 'base', 'accelerometer')}
        self._outputs = {
            topic: (self.create_publisher(kind, topic, STREAM), Writer(kind, frame, joint))
            for topic, kind, frame, joint, published in (
                ('wrench', WrenchStamped, frames['sensor'], '', True),
                ('~/contact_wrench', WrenchStamped, frames['sensor'], '', True),
                ('accelerometer/raw', Vector3Stamped, frames['accelerometer'], '', True),
                ('imu/data_raw', Imu, frames['accelerometer'], '', value['imu.publish']),
                ('optidrive', JointState, '', 'optidrive', self._rig.optidrive),
                ('current_pose', PoseStamped, frames['base'], '', True)) if published}
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)

    def _publish(self, samples: Samples) -> None:
        poses = [(*position.tolist(), *quaternion_of(R_base_sensor))
                 for position, R_base_sensor in zip(samples.position, samples.R_base_sensor)]
        for topic, t, rows in (
                ('wrench', samples.wrench_t, samples.wrench.tolist()),
                ('~/contact_wrench', samples.contact_t, samples.contact.tolist()),
                ('accelerometer/raw', samples.accelerometer_t, samples.volts.tolist()),
                ('imu/data_raw', samples.accelerometer_t,
                 [self._imu(force) for force in samples.specific_force.tolist()]),
                ('optidrive', samples.optidrive_t, samples.optidrive[:, np.newaxis].tolist()),
                ('current_pose', samples.pose_t, poses)):
            if topic in self._outputs:
                publisher, write = self._outputs[topic]
                for at, row in zip(t.tolist(), rows):  # stamps are whole microseconds
                    publisher.publish(write(self._sample0 + round(at * 1e6) * 1000, row))

    def _imu(self, force: Sequence[float]) -> tuple[float, ...]:
        """Return the numbers of an Imu that measures neither orientation nor turning."""
        nothing = (-1.0, *(0.0,) * 8)
        known = (self._variance, 0.0, 0.0, 0.0) * 2 + (self._variance,)
        return 0.0, 0.0, 0.0, 1.0, *nothing, 0.0, 0.0, 0.0, *nothing, *force, *known

    def _report(self) -> None:
        self._waiting.of('' if self._schedule else '/clock, because use_sim_time is set')
        if self._schedule is None:
            self._diagnostics.publish(runtime.diagnostic_array(
                self, '', 'stale', 'waiting for /clock', {}))
            return
        followed = self._received > self._reported
        self._reported = STEADY.now().nanoseconds
        message = 'following target_frame' if followed else 'holding'
        if self._faults.active:
            message += f'; faults switched on: {", ".join(self._faults.active)}'
        behind = (self._now() - self._start) * 1e-9 - self._next * self._period_ns * 1e-9
        self._diagnostics.publish(runtime.diagnostic_array(
            self, '', 'warn' if behind > LONGEST_BACKLOG or self._faults.active else 'ok',
            message, {
                'behind [s]': behind, 'commands late': self._schedule.late,
                'commands ignored': self._ignored, 'simulated [s]': self._simulator.time}))


main = partial(runtime.run, 'sim', Sim, PARAMETERS)
"""Runs the node; takes the arguments, by default those of the process, and returns the status."""


if __name__ == '__main__':
    raise SystemExit(main())
