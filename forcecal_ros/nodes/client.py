"""Running nodes from a command: child processes, a temporary node, services and states."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.resources import files
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from types import TracebackType
from typing import Any, IO

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.schema import yaml_value
from forcecal_ros.core.topics import ROLES, Topic
from forcecal_ros.nodes.runtime import Interrupt, LEVELS, OUTPUT, SIGNAL_CHECK, starting
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger


class Processes:
    """
    Nodes of this package; the end of its context ends them all.

    Parameters
    ----------
    environment : mapping
        Variables added to those of this process.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._environment = {**os.environ, **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._outputs: dict[str, IO[bytes]] = {}

    def start(self, node: str, parameters: Mapping[str, object]) -> None:
        """Start one node with its parameters."""
        arguments = [part for name, value in parameters.items()
                     for part in ('-p', f'{name}:={yaml_value(value)}')]
        self._outputs[node] = tempfile.TemporaryFile()  # noqa: SIM115 - outlives this call
        self._running[node] = subprocess.Popen(
            [sys.executable, '-m', f'forcecal_ros.nodes.{node}', '--ros-args', *arguments],
            stdin=subprocess.DEVNULL, stdout=self._outputs[node], stderr=subprocess.STDOUT,
            env=self._environment, start_new_session=True)

    def check(self) -> None:
        """
        Check that all nodes are running.

        Raises
        ------
        DataError
            One has ended; with the last line of its output.
        """
        for node, process in self._running.items():
            if process.poll() is not None:
                self._outputs[node].seek(0)
                said = self._outputs[node].read().decode(errors='replace').strip().splitlines()
                raise DataError(f'the {node} node ended with status {process.returncode}: '
                                f'{said[-1] if said else "no output"}')

    def __enter__(self) -> 'Processes':
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._running.values():
            try:
                # time from SIGINT to SIGKILL [s], ten times what a node takes to come to rest
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for output in self._outputs.values():
            output.close()


def only_this_machine() -> dict[str, str]:
    """
    Return environment variables that keep a process' DDS traffic on the loopback interface.

    With Fast DDS, Jazzy's own, messages go over UDP and never through shared memory, where each
    process of the machine, of any domain, waits at locks that a killed one never releases.
    Its profile alone has to say so: ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` would bring
    shared memory back. Its buffers hold some tenths of a second of topics at 1 kHz, as far as the
    system grants them. Any other middleware is set to LOCALHOST.
    """
    if os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps').startswith('rmw_fastrtps'):
        return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                'FASTRTPS_DEFAULT_PROFILES_FILE': str(files(__package__) / 'loopback.xml')}
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


@contextmanager
def own_domain() -> Iterator[dict[str, str]]:
    """
    Take this process to a DDS domain of this machine only, where no robot listens.

    A ROS_DOMAIN_ID of the user is kept.

    Yields
    ------
    dict
        Environment variables for child processes.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or str(random.randint(1, 101))
    environment = {'ROS_DOMAIN_ID': domain, **only_this_machine()}
    before = {name: os.environ[name] for name in environment if name in os.environ}
    os.environ.update(environment)
    try:
        yield environment
    finally:
        for name in environment:
            os.environ.pop(name, None)
        os.environ.update(before)


class TemporaryNode:
    """A node with its executor."""

    def __init__(self, node: Node, executor: Executor, interrupt: Interrupt) -> None:
        self.node = node
        self._executor = executor
        self._interrupt = interrupt

    @property
    def interrupted(self) -> bool:
        """Whether a signal requests the end."""
        return self._interrupt.count > 0 or not rclpy.ok()

    def spin(self, seconds: float) -> None:
        """Handle what arrives within some time [s]."""
        self._executor.spin_until_future_complete(Future(), timeout_sec=seconds)


@contextmanager
def temporary_node(name: str) -> Iterator[TemporaryNode]:
    """Run a node within this context, in the domain of the environment."""
    interrupt = Interrupt()
    try:
        with starting('forcecal'):
            rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node(name)
        executor = EventsExecutor()
        executor.add_node(node)
        interrupt.running = True
        try:
            yield TemporaryNode(node, executor, interrupt)
        finally:
            executor.shutdown()
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
        interrupt.restore()


NODES = ('sequencer', 'observer', 'sim', 'gap', 'impedance')
"""Names of this package's nodes, in the order of a report."""

WORDS = {level: word for word, level in LEVELS.items()}


def ask(ros: TemporaryNode, service: str, patience: float) -> Trigger.Response:
    """
    Call a Trigger service.

    Parameters
    ----------
    service : str
        With its namespace.
    patience : float
        For the service to be there, and for its answer [s].

    Raises
    ------
    DataError
        The service is not there, or does not answer.
    """
    client = ros.node.create_client(Trigger, service)
    if not until(ros, client.service_is_ready, patience):
        raise DataError(f'{service} was not found within {patience:g} s; start its node with '
                        'the same ROS_DOMAIN_ID and --namespace')
    # from where the service is known here until this client is known there, without which its
    # answer is lost: three times what Fast DDS waits by itself [s]
    ros.spin(0.3)
    answer = client.call_async(Trigger.Request())
    if not until(ros, answer.done, patience):
        raise DataError(f'{service} did not answer within {patience:g} s, but may have executed '
                        'the request; check with forcecal status')
    response: Trigger.Response = answer.result()
    return response


def sequence_request(name: str) -> SetParameters.Request:
    """Return the request that lets the sequencer run this sequence at its next start."""
    return SetParameters.Request(parameters=[
        Parameter('sequence', value=name).to_parameter_msg()])


def node_statuses(ros: TemporaryNode, seconds: float) -> dict[str, DiagnosticStatus]:
    """Listen to /diagnostics; return the last status of each node of this package, by its name."""
    found: dict[str, DiagnosticStatus] = {}

    def take(message: DiagnosticArray) -> None:
        found.update({status.name: status for status in message.status
                      if status.name.rpartition('/')[2] in NODES})

    ros.node.create_subscription(DiagnosticArray, '/diagnostics', take, OUTPUT)
    until(ros, lambda: False, seconds)
    return dict(sorted(found.items(), key=lambda item: (
        item[0].rpartition('/')[0], NODES.index(item[0].rpartition('/')[2]))))


def until(ros: TemporaryNode, condition: Callable[[], bool], patience: float,
          meanwhile: Callable[[], object] = lambda: None) -> bool:
    """
    Spin until a condition holds; return whether it does.

    Parameters
    ----------
    patience : float
        Time after the last change of what ``meanwhile`` returns [s].
    meanwhile : callable
        Called again and again.
    """
    end, before = time.monotonic() + patience, meanwhile()
    while not condition() and time.monotonic() < end:
        if ros.interrupted:
            raise KeyboardInterrupt
        ros.spin(SIGNAL_CHECK)
        if (now := meanwhile()) != before:
            end, before = time.monotonic() + patience, now
    return condition()


def first_messages(namespace: str, topics: Mapping[str, str], timeout: float
                   ) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """
    Return the first message of each topic, or of the only other one of its type.

    Parameters
    ----------
    namespace : str
        Of topics without a leading slash.
    topics : mapping of str to str
        Key to name: ``wrench``, ``current_pose`` or ``joint_states``.
    timeout : float
        How long to wait [s], twice if a topic is not there.

    Returns
    -------
    found : dict of str to message
    others : dict of str to list of str
        Key of a topic without a message, to those of its type that are published.
    """
    types = {'wrench': WrenchStamped, 'current_pose': PoseStamped, 'joint_states': JointState}
    found: dict[str, Any] = {}
    with temporary_node('init') as ros:
        def take(names: Mapping[str, str]) -> None:
            for key, name in names.items():
                ros.node.create_subscription(types[key], name, partial(found.setdefault, key),
                                             qos_profile_sensor_data)
            until(ros, lambda: names.keys() <= found.keys(), timeout)

        take({key: name if name.startswith('/') else f'/{namespace}/{name}'.replace('//', '/')
              for key, name in topics.items()})
        published = [Topic(name, kind.rpartition('/')[2])
                     for name, kinds in ros.node.get_topic_names_and_types() for kind in kinds
                     if ros.node.count_publishers(name)]
        others = {key: sorted(
            one.name for one in published if one.type == types[key].__name__
            and not one.is_command and not one.name.endswith(tuple(
                f'/{role.topic}' for role in ROLES.values() if role.topic != key)))
            for key in topics if key not in found}
        take({key: names[0] for key, names in others.items() if len(names) == 1})
    return found, others
