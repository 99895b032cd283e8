"""Fast topics, taken in one go whenever the node has time for them.

An executor wakes up once a message: at 1 kHz and four topics that is most of what a node costs.
Taking all that has arrived every few milliseconds halves it (3250 messages a second: 9 % of a
core against 20 %), and a node that was late hears all before it judges.
"""

from collections.abc import Callable
from typing import Any

from forcecal_ros.nodes.runtime import SENSOR
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type

MOST = 500
"""Messages of one topic taken in one go at most, so that no flood starves the node."""


class Polled:
    """
    A subscription that no executor knows of: rclpy's own would wake up for every message.

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
        """Take what has arrived."""
        with self._handle:
            for _ in range(MOST):
                message = self._handle.take_message(self._message_type, True)
                if message is None:
                    break
                self._take(message[0])

    def destroy(self) -> None:
        """End the subscription."""
        self._handle.destroy_when_not_in_use()


class Inbox:
    """
    Subscriptions that are looked into by :meth:`drain` instead of by the executor.

    Parameters
    ----------
    node : Node
    polled : bool
        False: leave the subscriptions to the executor, which wakes up for every message.
    """

    def __init__(self, node: Node, polled: bool = True) -> None:
        self._node = node
        self._wanted = polled
        self._polled: list[Polled] = []

    def subscribe(self, message_type: Any, topic: str, take: Callable[[bytes], None]
                  ) -> Subscription | Polled:
        """Subscribe as to a sensor; ``take`` gets each message as it came over the wire."""
        if not self._wanted:
            return self._node.create_subscription(message_type, topic, take, SENSOR, raw=True)
        polled = Polled(self._node, message_type, topic, take)
        self._polled.append(polled)
        return polled

    def drain(self) -> None:
        """Take all that has arrived, topic by topic in the order they were subscribed."""
        for polled in self._polled:
            polled.drain()

    def unsubscribe(self, subscription: Subscription | Polled) -> None:
        """End one subscription."""
        if isinstance(subscription, Polled):
            self._polled = [one for one in self._polled if one is not subscription]
            subscription.destroy()
        else:
            self._node.destroy_subscription(subscription)

    def close(self) -> None:
        """End all of them; the node does not know of them."""
        for polled in self._polled:
            polled.destroy()
        self._polled = []
