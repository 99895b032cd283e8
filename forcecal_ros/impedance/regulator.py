"""The law through one run: its state, and what became of its commands."""

from forcecal_ros.impedance.law import at_rest, Law, Measurement, OK, step
from forcecal_ros.impedance.program import Reference


class Regulator:
    """
    A controller, at rest at the start.

    Parameters
    ----------
    law : Law

    Attributes
    ----------
    troubled : int
        Steps with something that was not finite.
    """

    def __init__(self, law: Law) -> None:
        self._law, self._state = law, at_rest(law)
        self.troubled = 0

    def __call__(self, reference: Reference, heard: Measurement) -> float:
        """Return the command of S along x of ft_sensor, from the start [m]."""
        self._state, command, status = step(
            self._law, self._state, heard, reference.position, reference.velocity)
        self.troubled += status != OK
        return command

    def sent(self, command: float) -> None:
        """Learn which command was really sent, where limits changed it [m]."""
        self._state = self._state._replace(command=command)
