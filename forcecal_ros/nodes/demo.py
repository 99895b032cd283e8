"""Calibration end to end over DDS: simulated rig, sequencer and observer, all topics recorded."""

from collections.abc import Callable
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.errors import DataError, MotionError
from forcecal_ros.core.topics import ROLES
from forcecal_ros.io.bags import BagWriter
from forcecal_ros.nodes import client
from forcecal_ros.nodes.bags import Recorder
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT
from rcl_interfaces.srv import SetParameters
from rclpy.time import Time
from std_msgs.msg import String
from std_srvs.srv import Trigger

RECORDED = {role: f'/{ROLES[role].topic}' for role in (
    'wrench', 'accelerometer', 'optidrive', 'pose', 'target', 'contact_truth', 'contact_wrench',
    'phase', 'calibration', 'observer_gain', 'tool_inertia')}
"""Topics that the recording of a demo holds, by role."""

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

Progress = Callable[[str], None]
"""Called with each phase."""


class _Demo:
    """Starts the sequences, follows their phases and records the topics."""

    def __init__(self, ros: client.TemporaryNode, nodes: client.Processes, writer: BagWriter,
                 progress: Progress) -> None:
        self._ros, self._nodes, self._progress = ros, nodes, progress
        self._shown = ''
        self.phase, self.label, self.calibration, self.since = '', '', '', 0
        self._recorder = Recorder(ros.node, writer,
                                  lambda name, msgtype: name in RECORDED.values())
        self._start = ros.node.create_client(Trigger, 'sequencer/start')
        self._set = ros.node.create_client(SetParameters, 'sequencer/set_parameters')
        ros.node.create_subscription(DiagnosticArray, 'sequencer/phase', self._on_phase, OUTPUT)
        ros.node.create_subscription(
            String, 'sequencer/calibration', self._on_calibration, LATCHED)

    def _on_phase(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        if status.message != self.phase:
            self.since = Time.from_msg(message.header.stamp).nanoseconds
        self.phase = status.message
        self.label = next((pair.value for pair in status.values if pair.key == 'reason'), '')

    def _on_calibration(self, message: String) -> None:
        self.calibration = message.data

    def count(self, role: str) -> int:
        """Return how many messages of a role were recorded."""
        return self._recorder.counts[RECORDED[role]]

    def wait(self, condition: Callable[[], bool], timeout: float, what: str,
             progress: Callable[[], object] = lambda: None) -> None:
        """
        Spin until a condition holds.

        Raises
        ------
        DataError
            It does not hold ``timeout`` [s] after the last change of ``progress``, or a node has
            ended.
        """
        def meanwhile() -> object:
            self._nodes.check()
            self._recorder.subscribe_to_new_topics()
            if (shown := self.phase or 'starting') != self._shown:
                self._progress(shown)
                self._shown = shown
            return progress()

        if not client.until(self._ros, condition, timeout, meanwhile):
            raise DataError(f'{what} did not happen within {timeout:.0f} s')

    def call(self, client: Any, request: object) -> Any:
        """Call a service and wait for its answer."""
        self.wait(client.service_is_ready, START_TIMEOUT, f'service {client.srv_name}')
        future = client.call_async(request)
        self.wait(future.done, PATIENCE, f'an answer from {client.srv_name}')
        return future.result()

    def run_sequence(self, name: str) -> float:
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
        answer = self.call(self._set, client.sequence_request(name)).results[0]
        if not answer.successful:
            raise MotionError(f'sequence {name}: {answer.reason}')
        # time in which a start has to be accepted: the sequencer first requires
        # samples of every sensor [s]
        end = time.monotonic() + 30.0
        while not (answer := self.call(self._start, Trigger.Request())).success:
            if time.monotonic() > end:
                raise MotionError(f'sequence {name}: {answer.message}')
        self.wait(lambda: self.phase not in ('idle', 'done', 'aborted', ''), PATIENCE,
                  f'the start of sequence {name}')
        began = self.since
        self.wait(lambda: self.phase in ('done', 'aborted'), PATIENCE,
                  f'the end of sequence {name}', lambda: self.count('pose'))
        if self.phase == 'aborted':
            raise MotionError(f'sequence {name} was aborted: {self.label}')
        return (self.since - began) * 1e-9


def run_demo(accelerometer: str, out: Path, seed: int, progress: Progress) -> tuple[str, float]:
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

    Returns
    -------
    calibration : str
        Text of ``calibration.yaml``, as the sequencer published it.
    duration : float
        From the first command to the gains, in simulated time [s].

    Raises
    ------
    ForcecalError
        A node ended or did not answer, or a sequence was aborted.
    """
    coupling = 'ac' if accelerometer == 'acc2' else 'dc'
    with (client.own_domain() as environment, client.temporary_node('demo') as ros,
          client.Processes(environment) as nodes, BagWriter(out / 'bag') as writer):
        demo = _Demo(ros, nodes, writer, progress)
        nodes.start('sim', {'accelerometer': accelerometer, 'seed': seed, **ON_TIME})
        nodes.start('observer', {'use_sim_time': True})
        nodes.start('sequencer', {'accelerometer.coupling': coupling, **FOR_SIMULATION})
        demo.wait(lambda: demo.count('pose') > 0, START_TIMEOUT,
                  'a first pose of the simulated rig')
        duration = demo.run_sequence('calibrate')
        demo.wait(lambda: bool(demo.calibration), PATIENCE, 'the calibration')
        received = demo.count('contact_wrench')
        demo.wait(lambda: demo.count('contact_wrench') > received + 500, PATIENCE,
                  'the use of the calibration by the observer')
        demo.run_sequence('contact')
        return demo.calibration, duration
