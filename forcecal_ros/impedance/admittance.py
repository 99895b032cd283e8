"""The wanted impedance itself, integrated: the command moves as mass, damper and spring would."""

from dataclasses import dataclass

from forcecal_ros.errors import ConfigError
from forcecal_ros.impedance.program import Reference
from forcecal_ros.impedance.trial import Heard


@dataclass(frozen=True)
class Wanted:
    """
    How the tool shall give way to a force.

    Attributes
    ----------
    mass, damping, stiffness : float
        [kg], [N s/m], [N/m]
    """

    mass: float = 25.0
    damping: float = 500.0
    stiffness: float = 1000.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise ConfigError(f'impedance.{name} is {value}; it wants a positive number')


class Admittance:
    """
    Controller of one run.

    Parameters
    ----------
    wanted : Wanted
    period : float
        [s]
    """

    def __init__(self, wanted: Wanted, period: float) -> None:
        self._wanted, self._period = wanted, period
        self._position = self._velocity = 0.0

    def __call__(self, reference: Reference, heard: Heard) -> float:
        """Return the command of S along x of ft_sensor, from the start [m]."""
        wanted = self._wanted
        pull = (wanted.stiffness * (reference.position - self._position)
                + wanted.damping * (reference.velocity - self._velocity))
        self._velocity += (heard.force + pull) / wanted.mass * self._period
        self._position += self._velocity * self._period
        return self._position
