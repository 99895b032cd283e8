"""Subscriptions that are polled, so that all messages that have arrived are taken in one go.

An executor wakes up for every message: at 1 kHz and four topics that is most of what a node costs.
Taking all that has arrived every few milliseconds halves it (3250 messages per second: 9 % of a
core against 20 %), and a node that was late takes all messages before it decides anything.
"""

from collections.abc import Callable
from typing import Any

from forcecal_ros.nodes.runtime import SENSOR
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.type_support import check_is_valid_msg_type

MOST = 500
"""Messages of one topic taken in one go at most, 2.5 times the queue of a sensor topic, so that no
flood starves the node."""


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
    Subscriptions that :meth:`drain` takes messages from, instead of the executor.

    Parameters
    ----------
    polled : bool
        False: leave the subscriptions to the executor, which wakes up for every message.
    """

    def __init__(self, node: Node, polled: bool = True) -> None:
        self._node = node
        self._wanted = polled
        self._polled: list[PolledSubscription] = []

    def subscribe(self, message_type: Any, topic: str, take: Callable[[bytes], None]
                  ) -> Subscription | PolledSubscription:
        """Subscribe with the QoS of a sensor; ``take`` gets the serialised messages."""
        if not self._wanted:
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
