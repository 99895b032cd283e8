"""Diagnostic messages."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.time import Time

LEVELS = {'ok': DiagnosticStatus.OK, 'warn': DiagnosticStatus.WARN,
          'error': DiagnosticStatus.ERROR, 'stale': DiagnosticStatus.STALE}

NO_NAMESPACE = 'robot'
"""Hardware of a node without a namespace; in one, the namespace is the robot's name."""


def diagnostic_array(node: Node, part: str, level: str, message: str,
                     values: Mapping[str, object], stamp: Time | None = None) -> DiagnosticArray:
    """
    Build a DiagnosticArray of one status.

    Parameters
    ----------
    part : str
        Of the node, for the name of the status; empty for all of it.
    level : str
        ``ok``, ``warn``, ``error`` or ``stale``.
    values : mapping
        Published as text; floats with four significant digits.
    stamp : Time, optional
        By default now.
    """
    name = node.get_fully_qualified_name().lstrip('/') + (f': {part}' if part else '')
    status = DiagnosticStatus(
        level=LEVELS[level], name=name, message=message,
        hardware_id=node.get_namespace().strip('/') or NO_NAMESPACE,
        values=[KeyValue(key=key, value=f'{value:.4g}' if isinstance(value, float)
                         else str(value)) for key, value in values.items()])
    array = DiagnosticArray(status=[status])
    array.header.stamp = (stamp or node.get_clock().now()).to_msg()
    return array
