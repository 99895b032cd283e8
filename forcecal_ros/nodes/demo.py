"""Calibration end to end over DDS: simulated rig, sequencer and observer, all topics recorded."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.nodes.bags import Recorder
from forcecal_ros.nodes.client import own_domain, Processes
from forcecal_ros.nodes.runtime import Interrupt, LATCHED, OUTPUT, SIGNAL_CHECK, starting
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.time import Time
from std_msgs.msg import String
from std_srvs.srv import Trigger

RECORDED = ('wrench', 'accelerometer', 'optidrive', 'pose', 'target', 'contact_truth',
            'contact_wrench', 'phase', 'calibration', 'observer_gain', 'tool_inertia')
"""Roles of the topics that the recording of a demo holds."""

START_TIMEOUT = 120.0
"""Time in which a node has to answer: a first run compiles the simulator before [s]."""

ON_TIME = {'clock.publish': True, 'clock.wait': 0.5}
"""
Rig parameters: the others go by its clock, which waits for commands, so that a busy computer makes
none late.
"""

PATIENCE = 30.0
"""Time without progress after which the demo fails: on a slow computer progress is slow [s]."""

FOR_SIMULATION = {
    'use_sim_time': True,
    'limits.workspace_max': [1.35, 0.4, 1.4],
    'limits.force': 1000.0,
    'limits.torque': 1000.0,
    'limits.tracking_error': 0.2,
    'limits.tracking_angle': 1.0,
    'watch.max_age': 5.0,
    'watch.most_pauses': 0,
    'watch.lost_timeout': 10.0,
    'watch.clock_timeout': 10.0,
    'settle.timeout': 20.0,
    'timing.approach': 1.5,
}
"""
Sequencer parameters of a simulated rig: the tip may reach the wall, and a busy computer be late.

No robot moves there; the limits of a robot are for its user to widen.
"""

Progress = Callable[[str, float], None]
"""Called with the phase, and the time since the start [s]."""


@dataclass(frozen=True)
class DemoResult:
    """
    Result of a demo.

    Attributes
    ----------
    calibration : str
        Text of ``calibration.yaml``, as the sequencer published it.
    duration : float
        From the first command to the gains, in simulated time [s].
    """

    calibration: str
    duration: float


class DemoNode(Node):
    """Starts the sequences, follows their phases and records the topics."""

    def __init__(self) -> None:
        super().__init__('demo')
        self.phase, self.label, self.calibration = '', '', ''
        self.since = 0
        self.recorder = Recorder(self, RECORDED)
        self._executor: Executor = EventsExecutor()
        self._executor.add_node(self)
        self._start = self.create_client(Trigger, 'sequencer/start')
        self._set = self.create_client(SetParameters, 'sequencer/set_parameters')
        self.create_subscription(DiagnosticArray, 'sequencer/phase', self._on_phase, OUTPUT)
        self.create_subscription(String, 'sequencer/calibration', self._on_calibration, LATCHED)

    def _on_phase(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        if status.message != self.phase:
            self.since = Time.from_msg(message.header.stamp).nanoseconds
        self.phase = status.message
        self.label = next((pair.value for pair in status.values if pair.key == 'reason'), '')

    def _on_calibration(self, message: String) -> None:
        self.calibration = message.data

    def wait(self, until: Callable[[], bool], timeout: float, what: str,
             each: Callable[[], None] = lambda: None,
             progress: Callable[[], object] = lambda: None) -> None:
        """
        Spin until a condition holds.

        Raises
        ------
        DataError
            It does not hold ``timeout`` [s] after the last change of ``progress``.
        """
        end, before = time.monotonic() + timeout, progress()
        while not until():
            each()
            if (now := progress()) != before:
                end, before = time.monotonic() + timeout, now
            if time.monotonic() > end:
                raise DataError(f'{what} did not happen within {timeout:.0f} s')
            self._executor.spin_until_future_complete(Future(), timeout_sec=SIGNAL_CHECK)

    def call(self, client: Any, request: object, each: Callable[[], None]) -> Any:
        """Call a service and wait for its answer."""
        self.wait(client.service_is_ready, START_TIMEOUT, f'service {client.srv_name}', each)
        future = client.call_async(request)
        self.wait(future.done, PATIENCE, f'an answer of {client.srv_name}', each)
        return future.result()

    def run_sequence(self, name: str, each: Callable[[], None]) -> float:
        """
        Run one sequence to its end.

        Returns
        -------
        float
            Its duration in simulated time [s].

        Raises
        ------
        MotionError
            The sequence was refused or aborted; with the reason.
        """
        request = SetParameters.Request(parameters=[
            ParameterMessage(name='sequence', value=Parameter(
                'sequence', value=name).get_parameter_value())])
        answer = self.call(self._set, request, each).results[0]
        if not answer.successful:
            raise MotionError(f'sequence {name}: {answer.reason}')
        # ready timeout: time in which a start has to be accepted: the sequencer first requires
        # samples of every sensor [s]
        end = time.monotonic() + 30.0
        while not (answer := self.call(self._start, Trigger.Request(), each)).success:
            if time.monotonic() > end:
                raise MotionError(f'sequence {name}: {answer.message}')
        self.wait(lambda: self.phase not in ('idle', 'done', 'aborted', ''), PATIENCE,
                  f'the start of sequence {name}', each)
        began = self.since
        self.wait(lambda: self.phase in ('done', 'aborted'), PATIENCE,
                  f'the end of sequence {name}', each, lambda: self.recorder.counts['pose'])
        if self.phase == 'aborted':
            raise MotionError(f'sequence {name} was aborted: {self.label}')
        return (self.since - began) * 1e-9

    def close(self) -> None:
        """Free what the node holds."""
        self._executor.shutdown()
        self.destroy_node()


def run_demo(accelerometer: str, out: Path, seed: int, progress: Progress) -> DemoResult:
    """
    Calibrate the simulated rig over DDS, then touch its wall with the observer running.

    Parameters
    ----------
    accelerometer : str
        ``acc1`` or ``acc2``.
    out : Path
        Folder in which the recording is written, as ``bag``.
    seed : int
        Of the sensor noise.

    Raises
    ------
    ForcecalError
        A node ended or did not answer, or a sequence was aborted.
    """
    coupling = 'ac' if accelerometer == 'acc2' else 'dc'
    with own_domain() as environment, _node() as demo, Processes(environment) as nodes:
        began = time.monotonic()

        def each() -> None:
            nodes.check()
            progress(demo.phase or 'starting', time.monotonic() - began)

        nodes.start('sim', {'accelerometer': accelerometer, 'seed': seed, **ON_TIME})
        nodes.start('observer', {'use_sim_time': True})
        nodes.start('sequencer', {'accelerometer.coupling': coupling, **FOR_SIMULATION})
        demo.wait(lambda: demo.recorder.counts['pose'] > 0, START_TIMEOUT,
                  'a first pose of the simulated rig', each)
        duration = demo.run_sequence('calibrate', each)
        demo.wait(lambda: bool(demo.calibration), PATIENCE, 'the calibration', each)
        received = demo.recorder.counts['contact_wrench']
        demo.wait(lambda: demo.recorder.counts['contact_wrench'] > received + 500,
                  PATIENCE, 'the observer taking over the calibration', each)
        demo.run_sequence('contact', each)
        demo.recorder.write(out / 'bag')
        return DemoResult(demo.calibration, duration)


@contextmanager
def _node() -> Iterator[DemoNode]:
    """Run the demo's node within this context; signals end it, and not ROS alone."""
    interrupt = Interrupt()  # rclpy's own handler would leave the other nodes running
    try:
        with starting('forcecal'):
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        demo = DemoNode()
        try:
            yield demo
        finally:
            demo.close()
    finally:
        rclpy.try_shutdown()
        interrupt.restore()
