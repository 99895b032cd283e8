"""Recordings of topics: written while nodes run, and published again."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable
from functools import partial
from importlib import import_module
import time
from typing import Any

from forcecal_ros.core.errors import MotionError
from forcecal_ros.core.topics import ROLES, Topic
from forcecal_ros.io.bags import BagWriter, Raw
from forcecal_ros.nodes.client import TemporaryNode
from forcecal_ros.nodes.runtime import LATCHED, SECOND, SENSOR
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

RECORDED = QoSProfile(depth=2000)
"""QoS of a recorded topic, whose queue holds two seconds at 1 kHz."""


def message_class(msgtype: str, unknown: set[str]) -> Any:
    """Return the class of a type as ``geometry_msgs/msg/WrenchStamped``; None: it is unknown."""
    try:
        package, _, name = msgtype.split('/')
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        unknown.add(msgtype)
        return None


def of_this_package(name: str, msgtype: str) -> bool:
    """Return whether a topic has the name and type of a role, in any namespace."""
    return any(f'/{name.lstrip("/")}'.endswith(f'/{role.topic}') and msgtype in role.types
               for role in ROLES.values())


class Recorder:
    """
    Subscribes to every selected topic that appears, and writes each message at once.

    Parameters
    ----------
    writer : BagWriter
        Has to stay open.
    selected : callable
        Name and type of a topic -> whether it is recorded.

    Attributes
    ----------
    counts : Counter
        Number of messages, by topic.
    unknown : set of str
        Message types whose package is not installed.
    """

    def __init__(self, node: Node, writer: BagWriter, selected: Callable[[str, str], bool]
                 ) -> None:
        self._node, self._writer, self._selected = node, writer, selected
        self._clock = node.get_clock()
        self._subscribed: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.unknown: set[str] = set()

    def subscribe_to_new_topics(self) -> None:
        """Subscribe to the topics that have appeared since."""
        for name, types in self._node.get_topic_names_and_types():
            if name in self._subscribed or not self._selected(name, types[0]):
                continue
            if publishers := self._node.get_publishers_info_by_topic(name):
                self._subscribe(name, types[0], [one.qos_profile for one in publishers])

    def missing(self, names: Collection[str]) -> list[str]:
        """Return the topics without a message."""
        return sorted(name for name in names if not self.counts[f'/{name.lstrip("/")}'])

    def _subscribe(self, name: str, msgtype: str, offered: list[QoSProfile]) -> None:
        self._subscribed.add(name)
        if (kind := message_class(msgtype, self.unknown)) is None:
            return
        latched = all(one.durability == DurabilityPolicy.TRANSIENT_LOCAL for one in offered)
        reliable = all(one.reliability == ReliabilityPolicy.RELIABLE for one in offered)
        quality = QoSProfile(
            depth=RECORDED.depth, durability=(LATCHED if latched else RECORDED).durability,
            reliability=(RECORDED if reliable else SENSOR).reliability)
        self._node.create_subscription(
            kind, name, partial(self._keep, name, msgtype, latched), quality, raw=True)

    def _keep(self, name: str, msgtype: str, latched: bool, raw: bytes) -> None:
        self._writer.write_raw(name, msgtype, self._clock.now().nanoseconds, raw, latched=latched)
        self.counts[name] += 1


LATCHED_NAMES = ('tf_static', 'robot_description',
                 *(role.topic for role in ROLES.values() if role.latched))
"""Topics that are published with transient-local durability."""


class Player:
    """
    Publishes the messages of a recording when they are due.

    Parameters
    ----------
    rate : float
        Recorded seconds per second.
    clock_rate : float
        Rate of /clock [Hz]; 0: it is not published.
    renamed : callable
        Name of a recorded topic -> name under which it is published.

    Attributes
    ----------
    counts : Counter
        Number of messages published, by topic.
    unknown : set of str
        Message types whose package is not installed.
    unreceived : set of Topic
        Topics that no one may subscribe to while they are published.
    """

    def __init__(self, host: TemporaryNode, rate: float, clock_rate: float,
                 renamed: Callable[[str], str]) -> None:
        self._host, self._rate, self._renamed = host, rate, renamed
        self._publishers: dict[Topic, Publisher | None] = {}
        self._tick = SECOND / clock_rate if clock_rate else 0.0
        self._clock = host.node.create_publisher(Clock, '/clock', 10) if clock_rate else None
        self.counts: Counter[str] = Counter()
        self.unknown: set[str] = set()
        self.unreceived: set[Topic] = set()

    def offer(self, topics: Iterable[Topic]) -> None:
        """Create publishers, so that subscriptions are matched before the first message."""
        for topic in topics:
            self._publishers[topic] = self._publisher(topic)

    def listeners(self, topics: Iterable[Topic]) -> dict[str, list[str]]:
        """Return the names of the nodes that subscribe to topics, by the name of the topic."""
        found = {}
        for topic in topics:
            publisher = self._publishers.get(topic)
            if publisher is not None and publisher.get_subscription_count():
                found[publisher.topic_name] = sorted({
                    one.node_name for one in
                    self._host.node.get_subscriptions_info_by_topic(publisher.topic_name)})
        return found

    def play(self, messages: Iterable[Raw], each: Callable[[float], None]) -> None:
        """
        Publish until the messages or a signal end it.

        Parameters
        ----------
        each : callable
            Called with the recorded time since the first message at the rate of /clock [s].

        Raises
        ------
        MotionError
            A node subscribes to a topic of :attr:`unreceived`.
        """
        first = began = next_tick = 0
        for message in messages:
            if not first:
                first, began, next_tick = message.log_ns, time.monotonic_ns(), message.log_ns
            while True:
                now = first + int((time.monotonic_ns() - began) * self._rate)
                clock_ns = min(now, message.log_ns)  # on a busy computer messages may lag
                if self._clock is not None and clock_ns >= next_tick:
                    self._clock.publish(Clock(clock=Time(nanoseconds=clock_ns).to_msg()))
                    next_tick = clock_ns + int(self._tick * self._rate)
                    each((clock_ns - first) / SECOND)
                if now >= message.log_ns or self._host.interrupted:
                    break
                self._wait(message.log_ns, next_tick, now)
            if self._host.interrupted:
                return
            self._publish(message)

    def finish(self, seconds: float) -> None:
        """Wait until all reliable subscriptions have received everything, at most so long."""
        for publisher in self._publishers.values():
            if publisher is not None:
                publisher.wait_for_all_acked(Duration(seconds=seconds))

    def _wait(self, due: int, next_tick: int, now: int) -> None:
        until = min(due, next_tick) if self._clock is not None else due
        # shortest wait and longest wait: bounds of a wait for the next message [s]: half the
        # period of a topic at 1 kHz, and the delay of a signal that is not noticed
        time.sleep(min(max((until - now) / SECOND / self._rate, 0.0005), 0.02))

    def _publish(self, message: Raw) -> None:
        publisher = self._publishers.get(message.topic)
        if publisher is not None:
            if message.topic in self.unreceived and publisher.get_subscription_count():
                raise MotionError(f'a node has subscribed to the commands on '
                                  f'{publisher.topic_name}; playback is stopped')
            publisher.publish(message.data)
            self.counts[publisher.topic_name] += 1

    def _publisher(self, topic: Topic) -> Publisher | None:
        if (kind := message_class(topic.type, self.unknown)) is None:
            return None
        latched = topic.name.endswith(tuple(f'/{name}' for name in LATCHED_NAMES))
        return self._host.node.create_publisher(
            kind, self._renamed(topic.name), LATCHED if latched else RECORDED)
