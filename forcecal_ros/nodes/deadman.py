"""The dead-man switch: a topic whose silence stops the motion."""

from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.runtime import SECOND, STEADY
from std_msgs.msg import Header


class Deadman:
    """
    Monitor of the topic ``deadman``.

    Parameters
    ----------
    timeout : float
        Silence that stops a motion [s]; 0: there is no switch.
    """

    def __init__(self, inbox: Inbox, timeout: float) -> None:
        self._heard = 0
        self._timeout = round(timeout * SECOND)
        if self._timeout:
            inbox.subscribe(Header, 'deadman', self._on_deadman)

    def _on_deadman(self, raw: bytes) -> None:
        self._heard = STEADY.now().nanoseconds

    def fault(self, steady_ns: int) -> str:
        """Return why to stop, at a time on the steady clock [ns]; empty: there is no reason."""
        silent = steady_ns - self._heard
        if not 0 < self._timeout < silent:
            return ''
        if not self._heard:
            return ('deadman: nothing received; press the switch, or set '
                    'motion.deadman_timeout to 0.0')
        return f'deadman: silent for {silent / SECOND:.3f} s'
