"""Simulated rig, observer and impedance control over DDS: contacts, and how regular the loop is.

    python benchmark/impedance_live.py [SECONDS] [acc1|acc2]

Says how many visits of the wall touched it and how many did not, the period of the control loop
as the node sees it (median, 99th percentile), and the true and the observed force in contact.
Wants a quiet machine of two cores or more.
"""

from pathlib import Path
import sys
import tempfile
import time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from calibration_runs import rehearse
from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.impedance.session import Task
from forcecal_ros.io.calibration_file import save
from forcecal_ros.nodes.client import own_domain, Processes
from forcecal_ros.nodes.runtime import OUTPUT
from forcecal_ros.nodes.wire import Reader
from forcecal_ros.sim.rig.file import load_rig
from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from std_srvs.srv import Trigger

PATIENCE = 60.0
"""For nodes to come up, on a first run the compiler included [s]."""

FOR_SIMULATION = {
    'watch.pause_timeout': 0.4, 'watch.lost_timeout': 2.0, 'watch.frozen_timeout': 0.4,
    'watch.max_age': 5.0, 'limits.overspeed': 10.0}
"""Where no robot moves, a busy computer may be late."""


class Listener:
    """What the bench hears."""

    def __init__(self):
        self.node = rclpy.create_node('bench')
        self.executor = EventsExecutor()
        self.executor.add_node(self.node)
        self.phase, self.reason = '', ''
        self.values, self.truth, self.observed, self.commands = {}, [], [], []
        self.start = self.node.create_client(Trigger, 'impedance/start')
        self.node.create_subscription(DiagnosticArray, 'impedance/phase', self._on_phase, OUTPUT)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, OUTPUT)
        for message_type, topic, kept in (
                (WrenchStamped, 'sim/contact_wrench', self.truth),
                (WrenchStamped, 'observer/contact_wrench', self.observed),
                (PoseStamped, 'target_frame', self.commands)):
            self._keep(message_type, topic, kept)

    def _keep(self, message_type, topic, kept):
        read = Reader(message_type)

        def take(raw):
            sample = read(raw)
            kept.append((sample.stamp_ns * 1e-9, sample.values[0]))

        self.node.create_subscription(message_type, topic, take, 2000, raw=True)

    def _on_phase(self, message):
        self.phase = message.status[0].message
        self.reason = {pair.key: pair.value for pair in message.status[0].values}['reason']

    def _on_report(self, message):
        if message.status[0].name.endswith('impedance'):
            self.values = {pair.key: pair.value for pair in message.status[0].values}

    def until(self, condition, timeout, nodes=None):
        """Spin until a condition holds."""
        end = time.monotonic() + timeout
        while not condition():
            if nodes is not None:
                nodes.check()
            if time.monotonic() > end:
                raise SystemExit(f'not within {timeout:.0f} s; phase {self.phase} {self.reason}')
            self.executor.spin_until_future_complete(Future(), timeout_sec=0.01)

    def call_start(self, nodes):
        """Call start until it is accepted."""
        def accepted():
            future = self.start.call_async(Trigger.Request())
            self.until(future.done, 10.0, nodes)
            return future.result().success

        self.until(self.start.service_is_ready, PATIENCE, nodes)
        self.until(accepted, PATIENCE, nodes)


def main(seconds=60.0, accelerometer='acc1'):
    """Measure, and print what was found."""
    cycles = max(1, int(seconds // Task().program().duration))
    with tempfile.TemporaryDirectory() as folder, own_domain() as environment:
        path = Path(folder) / 'calibration.yaml'
        save(rehearse(load_rig(), accelerometer, 1), path)
        rclpy.init(args=[])
        with Processes(environment) as nodes:
            heard = Listener()
            nodes.start('sim', {'accelerometer': accelerometer, 'seed': 3})
            nodes.start('observer', {'calibration.file': path})
            nodes.start('impedance', {'limits.workspace_max': [1.35, 0.4, 1.4],
                                      'task.cycles': cycles, **FOR_SIMULATION})
            heard.call_start(nodes)
            heard.until(lambda: heard.phase in ('done', 'aborted'), 3.0 * seconds + 30.0, nodes)
            end = time.monotonic() + 1.5
            heard.until(lambda: time.monotonic() > end, 10.0)
            report(heard, cycles)


def report(heard, cycles):
    """Print the figures."""
    t, truth = np.array(heard.truth).T
    seen_t, seen = np.array(heard.observed).T
    pressed = np.interp(seen_t, t, truth) < -5.0
    error = (seen - np.interp(seen_t, t, truth))[pressed]
    values = heard.values
    print(f'ended as {heard.phase} {heard.reason}'.rstrip())
    print(f'visits of the wall {cycles}: touched {values["contacts"]}, missed {values["missed"]}')
    print(f'control period: median {values.get("period, median [ms]")} ms, 99th percentile '
          f'{values.get("period, 99th percentile [ms]")} ms; put off by '
          f'{values.get("stream put off by [s]")} s in all')
    if pressed.any():
        print(f'true force at most {-truth.min():.1f} N; observed less true in contact '
              f'{np.sqrt(np.mean(error ** 2)):.2f} N RMS')


if __name__ == '__main__':
    main(*[kind(text) for kind, text in zip((float, str), sys.argv[1:])])
