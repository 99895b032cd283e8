"""What a node says of itself: diagnostics, and one line for what it waits for."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from forcecal_ros.observe.sample import describe, level
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


class LastMessage(NamedTuple):
    """When a topic was received last [ns], and the frame_id of its first message."""

    steady_ns: int
    frame: str


def health(active: bool, calibrated: str | None, received: Mapping[str, LastMessage],
           silent: Sequence[str], status: int, more: Sequence[str] = ()) -> tuple[str, str]:
    """
    Return level and message for /diagnostics.

    Parameters
    ----------
    calibrated : str or None
        Sensor frame of the calibration in use; None without one.
    received, silent : dict, sequence of str
        The last message by topic; the topics that have fallen silent.
    status : int
        All bits of :class:`forcecal_ros.observe.Status` since the last report.
    more : sequence of str
        Further warnings.
    """
    if not active:
        return 'stale', 'not active'
    if calibrated is None:
        return 'warn', 'waiting for a calibration'
    if 'wrench' in silent or 'wrench' not in received:
        return 'error', 'wrench: nothing received'
    warnings = [*(f'{topic}: nothing received' for topic in silent), *more]
    frame = received['wrench'].frame
    if frame and frame != calibrated:
        warnings.append(f'wrench is of {frame!r}, the calibration of {calibrated!r}: is it '
                        'the same sensor?')
    grade = level(status)
    if warnings and grade == 'ok':
        grade = 'warn'
    return grade, '; '.join((*warnings, *describe(status))) or 'estimating'
