"""The gap between robot and simulator, live: excess of every channel, and the first stage."""

from functools import partial
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.diagnose.live import Judgement, LiveGap
from forcecal_ros.nodes import inputs, runtime
from forcecal_ros.nodes.collector import Collector
from forcecal_ros.nodes.runtime import OUTPUT, SECOND, STEADY
from forcecal_ros.nodes.wire import ReceivingNode, Sample
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import warm_up
from geometry_msgs.msg import PoseStamped, WrenchStamped
from std_srvs.srv import Trigger

PARAMETERS = (
    runtime.EXECUTOR,
    Parameter('rig', '', 'Rig file (YAML) to compare with; empty: the nominal rig'),
    Parameter('accelerometer.mounted', '', 'Mounted accelerometer; empty: that of the rig file',
              choices=('', 'acc1', 'acc2')),
    inputs.ACCELEROMETER_SOURCE,
    Parameter('optidrive.joint', 'optidrive', 'Name in the JointState of the compliant tool'),
    *inputs.POSE_PARAMETERS,
    inputs.WRENCH_SIGN,
    Parameter('delay', 0.3, 'Largest transport delay of samples', 's', low=0.05, high=5.0),
)

KEPT = 2 * SECOND
"""Samples are kept for that long before a first command, and after their comparison [ns]."""


class Gap(ReceivingNode):
    """Compares the robot with the simulated rig, from its first command on."""

    def __init__(self) -> None:
        super().__init__('gap', PARAMETERS)
        value = self._values()
        self._rig = load_rig(Path(value['rig']) if value['rig'] else None)
        warm_up()
        self._value = value
        accelerometer, unit = inputs.accelerometer_input(value['accelerometer.source'])
        self._collector = Collector(unit, value['wrench.sign'])
        mounting, poses = inputs.mounting_parameter(self), inputs.pose_source(self)
        self._needed = {'wrench': 'wrench', 'pose': poses.name or poses.topic}
        target = inputs.plain_input('target', 'target_frame', PoseStamped)
        topics = [inputs.plain_input('wrench', 'wrench', WrenchStamped), accelerometer,
                  inputs.at_sensor(poses, mounting), inputs.at_sensor(target, mounting)]
        if self._rig.optidrive:
            topics.append(inputs.optidrive_input(value['optidrive.joint']))
        for one in filter(None, topics):
            self._inbox.subscribe(one.message_type, one.topic,
                                  one.taker(partial(self._collect, one.channel)))
        self._reset()
        self._out = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT)
        self.create_service(Trigger, '~/reset', runtime.answering(self._reset))
        self.create_timer(0.02, self._inbox.drain, clock=STEADY)
        self.create_timer(1.0, self._judge, clock=STEADY)
        self._waiting = runtime.Waiting(self)
        self.get_logger().info('up: compares the robot with '
                               f'{value["rig"] or "the nominal rig"} from its first command on')

    def _collect(self, channel: str, sample: Sample) -> None:
        self._collector.add(channel, sample.stamp_ns, sample.values)

    def _reset(self) -> str:
        self._live: LiveGap | None = None
        self._origin = 0
        self._announced = ''
        self._collector.clear()
        return 'restarts with the next command'

    def _judge(self) -> None:
        missing = self._missing()
        self._waiting.of(missing)
        if missing:
            self._report('stale', f'waiting for {missing}', {})
            self._collector.forget(self._collector.newest('wrench') - KEPT)
            return
        try:
            found = self._judgement(min(map(self._collector.newest, self._needed)))
        except ForcecalError as error:
            self._report('error', str(error), {})
            self._reset()
            return
        self._publish(found)

    def _missing(self) -> str:
        """Return which topics a comparison waits for; empty: none."""
        missing = [topic for channel, topic in self._needed.items()
                   if not self._collector.newest(channel)]
        if not missing and not (self._live or self._collector.newest('target')):
            missing = ['target_frame']
        return ' and '.join(missing)

    def _judgement(self, received: int) -> Judgement:
        recording = self._collector.recording()
        start = recording.start_ns
        if self._live is None:
            assert recording.target is not None
            streams = [name for name in ('wrench', 'accelerometer', 'optidrive', 'pose')
                       if getattr(recording, name) is not None]
            self._live = LiveGap(self._rig, streams, self._value['accelerometer.mounted'] or None)
            self._origin = start + round(float(recording.target.t[0]) * SECOND)
        until = received - round(self._value['delay'] * SECOND)
        found = self._live.judge(recording, (self._origin - start) / SECOND,
                                 (until - start) / SECOND)
        done = self._origin + round(self._live.time * SECOND)
        self._collector.forget(min(done, received) - KEPT)
        return found

    def _publish(self, found: Judgement) -> None:
        values: dict[str, object] = {
            **{f'{name} [noise RMS]': excess for name, excess in found.excess.items()},
            'stage': found.stage, 'channels': ', '.join(found.channels),
            'first stage': found.first}
        level, message = 'ok', 'within the noise'
        if found.learning:
            message = 'learning the noise, at rest'
        elif found.stage:
            worst = max(found.channels, key=lambda name: found.excess.get(name, 0.0))
            level, message = 'error', (f'{found.first}: {worst} exceeds its noise by '
                                       f'{found.excess[worst]:.2g} noise RMS')
        elif found.first:
            level, message = 'warn', f'{found.first} has exceeded the noise'
        self._report(level, message, values)
        if found.first != self._announced:
            self._announced = found.first
            self.get_logger().warning(f'{found.first} exceeds the noise: '
                                      f'{", ".join(found.channels)}')

    def _report(self, level: str, message: str, values: dict[str, object]) -> None:
        self._out.publish(runtime.diagnostic_array(self, '', level, message, values))


main = partial(runtime.run, 'gap', Gap, PARAMETERS)
"""Runs the node; takes the arguments, by default those of the process, and returns the status."""


if __name__ == '__main__':
    raise SystemExit(main())
