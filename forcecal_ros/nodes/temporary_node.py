"""A node for the time of a command: made, spun, and ended by a signal."""

from collections.abc import Iterator
from contextlib import contextmanager

from forcecal_ros.nodes.runtime import Interrupt, starting
import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future


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
