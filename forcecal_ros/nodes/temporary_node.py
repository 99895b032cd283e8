"""A node for the time of a command, and what it asks running nodes."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from forcecal_ros.core.errors import DataError
from forcecal_ros.nodes.reporting import LEVELS
from forcecal_ros.nodes.runtime import Interrupt, OUTPUT, starting
from geometry_msgs.msg import PoseStamped, WrenchStamped
import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger


class TemporaryNode:
    """A node with its executor."""

    def __init__(self, node: Node, executor: Executor, interrupt: Interrupt) -> None:
        self.node = node
        self._executor = executor
        self._interrupt = interrupt

    @property
    def interrupted(self) -> bool:
        """Whether a signal asks to end."""
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

SETTLED = 0.3
"""From where the service is known here until this client is known there, without which its answer
is lost: three times what Fast DDS waits by itself [s]."""

SPIN = 0.02
"""Delay of an answer that nobody notices [s]."""

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
    if not _until(ros, client.service_is_ready, patience):
        raise DataError(f'{service} is not there after {patience:g} s; start its node with '
                        'the same ROS_DOMAIN_ID and --namespace')
    ros.spin(SETTLED)
    answer = client.call_async(Trigger.Request())
    if not _until(ros, answer.done, patience):
        raise DataError(f'{service} has not answered within {patience:g} s, and may have done '
                        'what it was asked to; forcecal status tells')
    response: Trigger.Response = answer.result()
    return response


def node_statuses(ros: TemporaryNode, seconds: float) -> dict[str, DiagnosticStatus]:
    """Listen to /diagnostics; return the last status of each node of this package, by its name."""
    found: dict[str, DiagnosticStatus] = {}

    def take(message: DiagnosticArray) -> None:
        found.update({status.name: status for status in message.status
                      if status.name.rpartition('/')[2] in NODES})

    ros.node.create_subscription(DiagnosticArray, '/diagnostics', take, OUTPUT)
    _until(ros, lambda: False, seconds)
    return dict(sorted(found.items(), key=lambda item: (
        item[0].rpartition('/')[0], NODES.index(item[0].rpartition('/')[2]))))


def _until(ros: TemporaryNode, condition: Callable[[], bool], patience: float) -> bool:
    end = time.monotonic() + patience
    while not condition() and time.monotonic() < end:
        if ros.interrupted:
            raise KeyboardInterrupt
        ros.spin(SPIN)
    return condition()


def first_messages(namespace: str, topics: Mapping[str, str], timeout: float) -> dict[str, Any]:
    """
    Return the first message of each topic that is published, by its key.

    Parameters
    ----------
    namespace : str
        Of topics without a leading slash.
    topics : mapping of str to str
        Key to name: ``wrench``, ``pose`` or ``joints``.
    timeout : float
        How long to wait [s].
    """
    types = {'wrench': WrenchStamped, 'pose': PoseStamped, 'joints': JointState}
    found: dict[str, Any] = {}
    with temporary_node('init') as ros:
        for key, name in topics.items():
            full = name if name.startswith('/') else f'/{namespace.strip("/")}/{name}'
            ros.node.create_subscription(types[key], full.replace('//', '/'),
                                         partial(found.setdefault, key), qos_profile_sensor_data)
        _until(ros, lambda: len(found) == len(topics), timeout)
    return found
