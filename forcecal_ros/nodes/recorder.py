"""Messages of topics, kept serialised: in memory, or written as they come."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from forcecal_ros.core.topics import ROLES
from forcecal_ros.io.bags import BagWriter
from forcecal_ros.nodes.runtime import LATCHED
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

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
        Of :data:`forcecal_ros.core.topics.ROLES`.

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


def of_this_package(name: str, msgtype: str) -> bool:
    """Return whether a topic has the name and type of a role, in any namespace."""
    return any(f'/{name.lstrip("/")}'.endswith(f'/{role.topic}') and msgtype in role.types
               for role in ROLES.values())


class StreamRecorder:
    """
    Subscribes to every wanted topic that appears, and writes each message at once.

    Parameters
    ----------
    writer : BagWriter
        Has to stay open.
    wanted : callable
        Name and type of a topic -> whether it is recorded.

    Attributes
    ----------
    counts : Counter
        Number of messages, by topic.
    unknown : set of str
        Message types whose package is not installed.
    """

    def __init__(self, node: Node, writer: BagWriter, wanted: Callable[[str, str], bool]) -> None:
        self._node, self._writer, self._wanted = node, writer, wanted
        self._clock = node.get_clock()
        self._subscribed: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.unknown: set[str] = set()

    def subscribe_to_new_topics(self) -> None:
        """Subscribe to the topics that have appeared since."""
        for name, types in self._node.get_topic_names_and_types():
            if name in self._subscribed or not self._wanted(name, types[0]):
                continue
            if publishers := self._node.get_publishers_info_by_topic(name):
                self._subscribe(name, types[0], [one.qos_profile for one in publishers])

    def missing(self, names: Collection[str]) -> list[str]:
        """Return the topics without a message."""
        return sorted(name for name in names if not self.counts[f'/{name.lstrip("/")}'])

    def _subscribe(self, name: str, msgtype: str, offered: list[QoSProfile]) -> None:
        self._subscribed.add(name)
        try:
            kind = message_class(msgtype)
        except (ImportError, AttributeError, ValueError):
            self.unknown.add(msgtype)
            return
        latched = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in offered)
        reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in offered)
        quality = QoSProfile(
            depth=RECORDED.depth,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched
                        else DurabilityPolicy.VOLATILE))
        self._node.create_subscription(
            kind, name, partial(self._keep, name, msgtype, latched), quality, raw=True)

    def _keep(self, name: str, msgtype: str, latched: bool, raw: bytes) -> None:
        self._writer.write_raw(name, msgtype, self._clock.now().nanoseconds, raw, latched=latched)
        self.counts[name] += 1
