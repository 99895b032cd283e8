"""The control law with its state, as a loop calls it once a period."""

from typing import Protocol

from forcecal_ros.impedance.law import at_rest, Law, Measurement, OK, step
from forcecal_ros.impedance.program import Reference


class Controller(Protocol):
    """One control step a period, along x of ft_sensor from the start."""

    def __call__(self, reference: Reference, measured: Measurement) -> float:
        """Return the command of S [m]."""

    def sent(self, command: float) -> None:
        """Take note of the command that was sent, which limits may have changed [m]."""


class Regulator:
    """
    The law as a controller, at rest at the start.

    Attributes
    ----------
    troubled : int
        Steps whose measurement or reference was not finite.
    """

    def __init__(self, law: Law) -> None:
        self._law, self._state = law, at_rest(law)
        self.troubled = 0

    def __call__(self, reference: Reference, measured: Measurement) -> float:
        """Return the command of S along x of ft_sensor, from the start [m]."""
        self._state, command, status = step(
            self._law, self._state, measured, reference.position, reference.velocity)
        self.troubled += status != OK
        return command

    def sent(self, command: float) -> None:
        """Let the estimator predict with the command that was sent [m]."""
        self._state = self._state._replace(command=command)
