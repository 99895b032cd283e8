"""Topics recorded as they appear, message by message."""

from collections import Counter
from collections.abc import Callable, Collection
from functools import partial

from forcecal_ros.nodes.recorder import message_class, RECORDED
from forcecal_ros.recording.bags import BagWriter
from forcecal_ros.recording.topics import ROLES
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy


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
