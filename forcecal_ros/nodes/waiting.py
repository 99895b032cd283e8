"""One line in the log for what a node waits for."""

from rclpy.node import Node


class Waiting:
    """Logs what a node waits for, once, when it has waited from one call to the next."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._before = self._said = ''

    def of(self, what: str) -> None:
        """Note what is waited for now; empty: nothing."""
        if what and what == self._before != self._said:
            self._node.get_logger().info(f'waiting for {what}')
            self._said = what
        self._before = what
        if not what:
            self._said = ''
