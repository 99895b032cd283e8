"""A test's side of the wire: nodes as processes, a node to listen with, and a robot to play."""

import os
import signal
import tempfile
import time

from diagnostic_msgs.msg import DiagnosticArray
from forcecal_ros.core.geometry import quaternion_from_matrix
from forcecal_ros.motion.profiles import nominal_poses
from forcecal_ros.nodes.runtime import LATCHED, OUTPUT
from forcecal_ros.nodes.wire import Reader, Writer
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_process import NodeProcess
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

PATIENCE = 120.0
"""A loaded machine is slow; nothing here waits that long on a quiet one [s]."""

AWAKE = 1.0
"""Longest that one look for what is waited for takes on a loaded machine [s]."""

RIG_TIME = {'clock__publish': True, 'clock__wait': 0.5}
"""Of the sim: its time passes as slowly as the machine lets it, and waits for late commands."""

ON_RIG_TIME = {'use_sim_time': True, 'watch__clock_timeout': 5.0, 'watch__pause_timeout': 2.0,
               'watch__lost_timeout': 5.0, 'watch__most_pauses': 0}
"""
Of a node that moves the rig: its motion is in step with the rig's time.

Silence is counted on the wall's, so that the rig may be slow without counting as silent.
"""

REST = np.array([4.0, -3.0, 135.5, 1.6, -4.1, 0.1])


class Live:
    """Nodes of this package as processes, and a node of the test's own; use it as a context."""

    def __init__(self):
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('bench', context=self.context)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.processes = {}
        self.clients = {}
        self.output = {}
        self.phases = []
        self.entered = {}
        self.reasons = []
        self.diagnostics = {}
        self.node.create_subscription(
            DiagnosticArray, 'sequencer/phase', self._on_phase, OUTPUT)
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, OUTPUT)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def start(self, module, name=None, remap=(), files=(), **parameters):
        """Start a node, under a name of its own if it has one; ``a__b=1`` sets ``a.b``."""
        name = name or module
        arguments = [part for file in files for part in ('--params-file', str(file))]
        arguments += [part for key, value in parameters.items()
                     for part in ('-p', f'{key.replace("__", ".")}:={value}')]
        arguments += [part for rule in remap for part in ('-r', rule)]
        self.run(f'forcecal_ros.nodes.{module}', name, arguments)

    def run(self, module, name, arguments):
        """Run a module as a node with ROS arguments."""
        self.output[name] = tempfile.NamedTemporaryFile()  # noqa: SIM115 - outlives this call
        self.processes[name] = NodeProcess(module, ['--ros-args', *arguments],
                                           self.output[name].name, os.environ)

    def said(self, module):
        self.output[module].seek(0)
        return self.output[module].read().decode()

    def end(self, module, number=signal.SIGINT):
        """Send a signal and return the exit status."""
        process = self.processes.pop(module)
        process.send_signal(number)
        self.until(lambda: process.poll() is not None, f'{module} goes')
        return process.returncode

    def spin(self, seconds=0.01):
        self.executor.spin_until_future_complete(Future(), timeout_sec=seconds)

    def until(self, condition, what, timeout=PATIENCE):
        left, last = timeout, time.monotonic()
        while not condition():
            for module, process in self.processes.items():
                assert process.poll() is None, f'{module} went: {self.said(module)}'
            now = time.monotonic()
            # a machine that was put to sleep meanwhile has not let anybody wait
            left, last = left - min(now - last, AWAKE), now
            assert left > 0.0, (
                f'{what}: not within {timeout} s; phases {self.phases}, {self.reasons}; '
                f'{ {module: self.said(module) for module in self.output} }')
            self.spin()

    def hear(self, message_type, topic, take, qos=2000):
        """Call ``take(stamp_ns, values)`` for every message of a type that is all numbers."""
        read = Reader(message_type)
        self.node.create_subscription(message_type, topic, lambda raw: take(*read(raw)[:2]), qos,
                                      raw=True)

    def latched(self, message_type, topic):
        """Return a list that every message of a latched topic is put into."""
        heard = []
        self.node.create_subscription(message_type, topic, heard.append, LATCHED)
        return heard

    def client(self, service, service_type=Trigger):
        """Return a client of a service that is there."""
        client = self.clients.get(service)
        if client is None:
            client = self.clients[service] = self.node.create_client(service_type, service)
            self.until(client.service_is_ready, f'service {service}')
            self.spin(0.1)  # an answer is lost where the server has not discovered the client
        self.until(client.service_is_ready, f'service {service}')
        return client

    def call(self, service, service_type=Trigger, request=None):
        client = self.client(service, service_type)
        future = client.call_async(request or service_type.Request())
        self.until(future.done, f'answer of {service}')
        return future.result()

    def set(self, node, **parameters):
        """Set parameters of a running node; returns what it said to each."""
        request = SetParameters.Request(parameters=[
            ParameterMessage(name=name.replace('__', '.'),
                             value=Parameter('x', value=value).get_parameter_value())
            for name, value in parameters.items()])
        return self.call(f'{node}/set_parameters', SetParameters, request).results

    def state(self, node='observer'):
        """Return the label of a managed node's state."""
        return self.call(f'{node}/get_state', GetState).current_state.label

    def ask_for(self, transition, node='observer'):
        """Ask a managed node for a transition; return whether it was made."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.call(f'{node}/change_state', ChangeState, request).success

    def _on_phase(self, message):
        status = message.status[0]
        if not self.phases or self.phases[-1] != status.message:
            self.phases.append(status.message)
            stamp = message.header.stamp
            self.entered[status.message] = stamp.sec * 10**9 + stamp.nanosec
            reason = {pair.key: pair.value for pair in status.values}.get('reason', '')
            if reason:
                self.reasons.append(reason)

    def _on_diagnostics(self, message):
        for status in message.status:
            self.diagnostics[status.name] = status


def speeds(commands):
    """Return stamps [s], and speeds [m/s], [rad/s] from one (stamp [ns], pose) to the next."""
    stamps = np.array([stamp for stamp, _ in commands]) * 1e-9
    values = np.array([values for _, values in commands])
    dt = np.diff(stamps)
    speed = np.linalg.norm(np.diff(values[:, :3], axis=0), axis=1) / dt
    chord = np.minimum(np.linalg.norm(np.diff(values[:, 3:], axis=0), axis=1),
                       np.linalg.norm(values[1:, 3:] + values[:-1, 3:], axis=1))
    return stamps[1:], speed, 4 * np.arcsin(chord / 2) / dt


class Robot:
    """
    A robot that is where it was told to be, with sensors that say so, played by the test.

    Attributes
    ----------
    commands : list of tuple
        (stamp [ns], x y z qx qy qz qw) of every command heard.
    silent : set of str
        Topics not published.
    override : dict of str to tuple
        What a topic says instead.
    healthy : int
        When all topics last said what is so [ns].
    """

    TOPICS = {'wrench': WrenchStamped, 'accelerometer/raw': Vector3Stamped,
              'current_pose': PoseStamped}

    def __init__(self, live, commands=True, now=None, frame='base', names=None, qos=OUTPUT,
                 period=0.004):
        self.live = live
        self.now = now or (lambda: live.node.get_clock().now().nanoseconds)
        self.commands = []
        self.silent = set()
        self.override = {}
        self.healthy = 0
        self.ticks = []
        self.rng = np.random.default_rng(1)
        home = nominal_poses()['v']
        self.pose = (*home.position.tolist(),
                     *quaternion_from_matrix(home.R_base_sensor).tolist())
        self.publishers = {
            topic: live.node.create_publisher(kind, (names or {}).get(topic, topic), qos)
            for topic, kind in self.TOPICS.items()}
        self.writers = {topic: Writer(kind, frame) for topic, kind in self.TOPICS.items()}
        if commands:
            live.hear(PoseStamped, 'target_frame', self._on_command)
        live.node.create_timer(period, self._tick)

    def _on_command(self, stamp, values):
        if not stamp:
            return
        self.commands.append((stamp, values))
        self.pose = values

    def _tick(self):
        stamp = self.now()
        self.ticks.append(stamp)
        if not (self.silent or self.override):
            self.healthy = stamp
        noise = self.rng.normal(size=16)
        samples = {'wrench': REST + noise[:6] * 0.05,
                   'accelerometer/raw': 5.0 + 0.01 * noise[6:9],
                   'current_pose': (*(self.pose[:3] + 2e-5 * noise[9:12]), *self.pose[3:])}
        for topic, values in samples.items():
            if topic not in self.silent:
                self.publishers[topic].publish(self.writers[topic](
                    stamp, self.override.get(topic, values)))

    def speeds(self, first=0):
        """Return stamps [s], and speeds [m/s], [rad/s] from one command to the next."""
        return speeds(self.commands[first:])

    def late(self, since):
        """Return by how much this robot's own sensors were late in the next 0.2 s [s]."""
        gaps = np.diff([tick for tick in self.ticks if 0 <= tick - since <= 2e8]) * 1e-9
        return np.maximum(gaps - 0.006, 0).sum()

    def moving(self):
        """Whether the last commands turn."""
        return len(self.commands) > 3 and self.speeds(-3)[2].min() > 0.1
