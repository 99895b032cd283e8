"""The dead-man switch: a topic that has to keep speaking."""

from forcecal_ros.nodes.inbox import Inbox
from forcecal_ros.nodes.runtime import SECOND, STEADY
from std_msgs.msg import Header


class Deadman:
    """
    Hears the topic ``deadman``.

    Parameters
    ----------
    inbox : Inbox
    timeout : float
        Silence that stops a motion [s]; 0: no such switch.
    """

    def __init__(self, inbox: Inbox, timeout: float) -> None:
        self._heard = 0
        self._timeout = round(timeout * SECOND)
        if self._timeout:
            inbox.subscribe(Header, 'deadman', self._on_deadman)

    def _on_deadman(self, raw: bytes) -> None:
        self._heard = STEADY.now().nanoseconds

    def fault(self, steady_ns: int) -> str:
        """Return what to say where the switch is asked for and silent; else nothing."""
        quiet = steady_ns - self._heard
        if not 0 < self._timeout < quiet:
            return ''
        if not self._heard:
            return ('deadman: nothing received; press the switch, or set '
                    'motion.deadman_timeout to 0.0')
        return f'deadman: silent for {quiet / SECOND:.3f} s'
