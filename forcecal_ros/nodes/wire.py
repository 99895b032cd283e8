"""Serialised messages of the fast topics, and subscriptions that are polled.

At 1 kHz and four topics the message objects cost more than all that is computed from them. Every
type here is a header and then doubles, so that all offsets follow from the length of frame_id.

An executor wakes up for every message. Polling every few milliseconds halves the load (3250
messages per second: 9 % of a core against 20 %), and a node that was late takes all messages
before it decides anything.
"""

from collections.abc import Callable, Sequence
from struct import pack, Struct
from typing import Any, NamedTuple

from forcecal_ros.core.cdr import FormReader, Layout
from forcecal_ros.core.parameters import Parameter
from forcecal_ros.nodes.runtime import declare, SECOND, SENSOR, values_of
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

READ = {Imu: slice(25, 28), AccelStamped: slice(3)}
"""Doubles to read, where not all: the linear acceleration."""


class Sample(NamedTuple):
    """Header stamp [ns], the numbers and the frame_id of one message."""

    stamp_ns: int
    values: tuple[float, ...]
    frame: str = ''


class Reader:
    """Reads serialised messages of one type of ``DOUBLES``."""

    def __init__(self, message_type: Any) -> None:
        first, last, _ = READ.get(message_type, slice(None)).indices(DOUBLES[message_type])
        self._read = FormReader(('i', 'I', 's', f'{last}d'))
        self._first = 4 + first  # behind the stamp, and the length and letters of the frame

    def __call__(self, raw: bytes) -> Sample:
        """
        Read one message.

        Raises
        ------
        struct.error
            The message is shorter than its type.
        """
        layout, values = self._read(raw)
        return Sample(values[0] * SECOND + values[1], values[self._first:], layout.texts[0])


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
        return values[0] * SECOND + values[1], [
            None if slot is None else values[slot] for slot in self._slots]


class Writer:
    """
    Writes serialised messages of one type, in one frame.

    Parameters
    ----------
    message_type : type
        One of ``DOUBLES``, or a JointState.
    joint : str
        Name of the only joint of a JointState.
    """

    def __init__(self, message_type: Any, frame: str = '', joint: str = '') -> None:
        self._head = _text(frame)
        self._after = b''
        if joint:
            self._head = _text(joint, self._head + pack('<I', 1)) + pack('<I', 1)
            self._after = bytes(8)  # no velocity, no effort
        self._head += bytes(-len(self._head) % 8)
        self._pack = Struct(f'<4siI{len(self._head)}s{DOUBLES.get(message_type, 1)}d'
                            f'{len(self._after)}s').pack

    def __call__(self, stamp_ns: int, values: Sequence[float]) -> bytes:
        """Write one message of header stamp [ns] and all doubles in order."""
        return self._pack(b'\0\1\0\0', stamp_ns // SECOND, stamp_ns % SECOND, self._head,
                          *values, self._after)


def _text(text: str, before: bytes = b'') -> bytes:
    """Return a serialised text behind others, up to where an integer may follow."""
    letters = text.encode() + b'\0'
    return before + pack('<I', len(letters)) + letters + bytes(-len(letters) % 4)


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
