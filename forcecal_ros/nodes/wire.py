"""Serialised messages of the fast topics, and subscriptions that are polled.

At 1 kHz and four topics the message objects cost more than all that is computed from them. Every
type here is a header and then doubles, so that all offsets follow from the length of frame_id.

An executor wakes up for every message. Polling every few milliseconds halves the load (3250
messages per second: 9 % of a core against 20 %), and a node that was late takes all messages
before it decides anything.
"""

from collections.abc import Callable, Sequence
from struct import pack, Struct, unpack_from
from typing import Any, NamedTuple

from forcecal_ros.core.cdr import FormReader, Layout
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.nodes.runtime import declare, SENSOR, values_of
from geometry_msgs.msg import (
    AccelStamped,
    PoseStamped,
    TwistStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type
from sensor_msgs.msg import Imu

DOUBLES: dict[type, int] = {
    WrenchStamped: 6, PoseStamped: 7, Vector3Stamped: 3, AccelStamped: 6, TwistStamped: 6,
    Imu: 37}
"""Number of doubles after the header of each type."""

FIRST = {Imu: 25}
"""Index of the first double to read, where not 0: the linear acceleration of an IMU."""

READ_COUNT = {Imu: 3, AccelStamped: 3}
"""Number of doubles to read, where not all."""


class Sample(NamedTuple):
    """Header stamp [ns] and the numbers of one message."""

    stamp_ns: int
    values: tuple[float, ...]


class Reader:
    """Reads serialised messages of one type of ``DOUBLES``."""

    def __init__(self, message_type: Any) -> None:
        first = FIRST.get(message_type, 0)
        count = READ_COUNT.get(message_type, DOUBLES[message_type])
        self._skip = 8 * first
        self._little = Struct(f'<{count}d').unpack_from
        self._big = Struct(f'>{count}d').unpack_from
        self._head = Struct('<iII').unpack_from
        self._head_big = Struct('>iII').unpack_from

    def __call__(self, raw: bytes) -> Sample:
        """
        Read one message.

        Raises
        ------
        struct.error
            The message is shorter than its type.
        """
        little = raw[1] == 1
        sec, nanosec, length = (self._head if little else self._head_big)(raw, 4)
        offset = 16 + length
        offset += (4 - offset) % 8 + self._skip
        values = (self._little if little else self._big)(raw, offset)
        return Sample(sec * 1_000_000_000 + nanosec, values)


def frame_of(raw: bytes) -> str:
    """Return the frame_id of a serialised message that begins with a header."""
    order = '<' if raw[1] == 1 else '>'
    (length,) = unpack_from(order + 'I', raw, 12)
    return raw[16:16 + length].rstrip(b'\0').decode(errors='replace')


class JointsReader:
    """
    Reads the positions of several joints, by their names, from serialised JointStates.

    Attributes
    ----------
    names : tuple of str
        Joints of the newest message.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = tuple(joints)
        self._read = FormReader(('i', 'I', 's', ('s',), ('d',)))
        self._layout: Layout | None = None
        self._slots: list[int | None] = []
        self.names: tuple[str, ...] = ()

    def __call__(self, raw: bytes) -> tuple[int, list[float | None]]:
        """
        Read one message.

        Returns
        -------
        int and list of float or None
            Header stamp [ns], and positions [rad or m] in the order of the joints requested; None
            where the message lacks one.

        Raises
        ------
        struct.error
            The message is shorter than its type.
        """
        layout, values = self._read(raw)
        if layout is not self._layout:
            self._layout, self.names = layout, layout.texts[1:]
            count = layout.counts[1]
            listed = self.names[:count]
            self._slots = [len(values) - count + listed.index(joint) if joint in listed else None
                           for joint in self._joints]
        return values[0] * 1_000_000_000 + values[1], [
            None if slot is None else values[slot] for slot in self._slots]


class JointReader:
    """Reads the position of one joint, by its name, from serialised JointStates."""

    def __init__(self, joint: str) -> None:
        self._read = JointsReader([joint])

    def __call__(self, raw: bytes) -> Sample | None:
        """
        Read one message; None where it lacks the joint.

        Raises
        ------
        struct.error
            The message is shorter than its type.
        """
        stamp_ns, (value,) = self._read(raw)
        return None if value is None else Sample(stamp_ns, (value,))


class Writer:
    """Writes serialised messages of one type of ``DOUBLES``, in one frame."""

    def __init__(self, message_type: Any, frame: str) -> None:
        name = frame.encode() + b'\0'
        padding = -(12 + len(name)) % 8
        self._frame = pack('<I', len(name)) + name + bytes(padding)
        self._pack = Struct(f'<4siI{len(self._frame)}s{DOUBLES[message_type]}d').pack

    def __call__(self, stamp_ns: int, values: Sequence[float]) -> bytes:
        """Write one message of header stamp [ns] and all doubles in order."""
        return self._pack(b'\0\1\0\0', stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000,
                          self._frame, *values)


class JointWriter:
    """Writes serialised JointStates with the position of one joint."""

    def __init__(self, joint: str, frame: str = '') -> None:
        text, name = frame.encode() + b'\0', joint.encode() + b'\0'
        head = pack('<I', len(text)) + text
        head += bytes(-len(head) % 4) + pack('<II', 1, len(name)) + name
        head += bytes(-len(head) % 4) + pack('<I', 1)
        head += bytes(-(8 + len(head)) % 8)
        self._head = head
        self._pack = Struct(f'<4siI{len(head)}sdII').pack

    def __call__(self, stamp_ns: int, position: float) -> bytes:
        """Write one message of header stamp [ns] and position [rad] or [m]."""
        return self._pack(b'\0\1\0\0', stamp_ns // 1_000_000_000, stamp_ns % 1_000_000_000,
                          self._head, position, 0, 0)


class PolledSubscription:
    """
    A subscription outside any executor, which would wake up for every message.

    Attributes
    ----------
    topic_name : str
        Resolved.
    """

    def __init__(self, node: Node, message_type: Any, topic: str, take: Callable[[bytes], None]
                 ) -> None:
        check_is_valid_msg_type(message_type)  # which also imports its C part
        self._message_type, self._take = message_type, take
        self.topic_name = node.resolve_topic_name(topic)
        with node.handle:
            self._handle = rclpy_implementation.Subscription(
                node.handle, message_type, topic, SENSOR.get_c_qos_profile())

    def drain(self) -> None:
        """Take the messages that have arrived."""
        with self._handle:
            for _ in range(500):
                message = self._handle.take_message(self._message_type, True)
                if message is None:
                    break
                self._take(message[0])

    def destroy(self) -> None:
        """End the subscription."""
        self._handle.destroy_when_not_in_use()


class Inbox:
    """
    Subscriptions that :meth:`drain` takes messages from, instead of the executor.

    Parameters
    ----------
    polled : bool
        False: leave the subscriptions to the executor, which wakes up for every message.
    """

    def __init__(self, node: Node, polled: bool = True) -> None:
        self._node = node
        self._selected = polled
        self._polled: list[PolledSubscription] = []

    def subscribe(self, message_type: Any, topic: str, take: Callable[[bytes], None]
                  ) -> Subscription | PolledSubscription:
        """Subscribe with the QoS of a sensor; ``take`` gets the serialised messages."""
        if not self._selected:
            return self._node.create_subscription(message_type, topic, take, SENSOR, raw=True)
        polled = PolledSubscription(self._node, message_type, topic, take)
        self._polled.append(polled)
        return polled

    def drain(self) -> None:
        """Take the messages that have arrived, topic by topic in the order of subscription."""
        for polled in self._polled:
            polled.drain()

    def unsubscribe(self, subscription: Subscription | PolledSubscription) -> None:
        """End one subscription."""
        if isinstance(subscription, PolledSubscription):
            self._polled = [one for one in self._polled if one is not subscription]
            subscription.destroy()
        else:
            self._node.destroy_subscription(subscription)

    def close(self) -> None:
        """End all polled subscriptions, which the node does not know of."""
        for polled in self._polled:
            polled.destroy()
        self._polled = []


class ReceivingNode(Node):
    """
    A node with the parameters of a table, and an inbox that ends with it.

    Parameters
    ----------
    table, check
        As of :func:`forcecal_ros.nodes.runtime.declare`.
    """

    def __init__(self, name: str, table: Sequence[Parameter],
                 check: Callable[[dict[str, Any]], object] | None = None) -> None:
        super().__init__(name)
        self._table = table
        declare(self, table, check)
        self._inbox = Inbox(self)

    def _values(self) -> dict[str, Any]:
        return values_of(self, self._table)

    def destroy_node(self) -> None:
        """End the subscriptions, then the node."""
        self._inbox.close()
        super().destroy_node()  # type: ignore[no-untyped-call]
