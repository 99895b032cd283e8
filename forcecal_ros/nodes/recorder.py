"""Messages of a set of topics, kept serialised and written as a recording."""

from collections import Counter
from collections.abc import Iterable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from forcecal_ros.nodes.runtime import LATCHED
from forcecal_ros.recording.bags import BagWriter
from forcecal_ros.recording.topics import ROLES
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

RECORDED = QoSProfile(depth=2000, history=HistoryPolicy.KEEP_LAST,
                      reliability=ReliabilityPolicy.RELIABLE)
"""QoS of a recorded topic, whose queue holds two seconds at 1 kHz."""


def message_class(msgtype: str) -> Any:
    """Return the class of a message type such as ``geometry_msgs/msg/WrenchStamped``."""
    package, _, name = msgtype.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class Recorder:
    """
    Subscribes to the topics of some roles and keeps every message.

    Parameters
    ----------
    roles : iterable of str
        Of :data:`forcecal_ros.recording.topics.ROLES`.

    Attributes
    ----------
    counts : Counter
        Number of messages received, by role.
    """

    def __init__(self, node: Node, roles: Iterable[str]) -> None:
        self._clock = node.get_clock()
        self._messages: list[tuple[int, str, bytes]] = []
        self.counts: Counter[str] = Counter()
        self._roles = tuple(roles)
        for role in self._roles:
            topic, types, latched = ROLES[role]
            node.create_subscription(
                message_class(types[0]), topic, partial(self._keep, role),
                LATCHED if latched else RECORDED, raw=True)

    def _keep(self, role: str, raw: bytes) -> None:
        self._messages.append((self._clock.now().nanoseconds, role, raw))
        self.counts[role] += 1

    def write(self, path: Path | str) -> None:
        """
        Write all messages as a recording.

        Raises
        ------
        ConfigError
            The recording cannot be written.
        """
        with BagWriter(path) as writer:
            for log_ns, role, raw in self._messages:
                topic, types, latched = ROLES[role]
                writer.write_raw(topic, types[0], log_ns, raw, latched=latched)
