"""Models of robot and tool along x of ft_sensor, with their standard errors."""

from dataclasses import dataclass
from typing import Annotated

from forcecal_ros.calibration.model import Entry, Estimate
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
from forcecal_ros.schema import Row, Section
import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Robot(Section):
    """
    Commanded to reached position, as difference equation in the form of [Gamez2005] Eq. 28.

    y_k = sum_i feedback_i y_(k-i) + sum_i feedforward_i r_(k-delay-i+1), i from 1.
    """

    period: Annotated[float, Row(
        'Of the equation and of the commands', 's', above=0.0, below=1.0)]
    delay: Annotated[int, Row(
        'Periods from a command to the first position that it changes', low=1)]
    feedback: Annotated[Estimate, Entry('Of y', '1', shape=(None,))]
    feedforward: Annotated[Estimate, Entry('Of the command', '1', shape=(None,))]

    def __post_init__(self) -> None:
        super().__post_init__()
        fastest = float(np.abs(self.poles).max(initial=0.0))
        if not fastest < 1.0:
            raise ConfigError(f'robot.feedback: unstable, a pole of magnitude {fastest:.4f}; '
                              'all must lie below 1')

    @property
    def poles(self) -> Complex:
        """Poles in z."""
        return np.roots([1.0, *(-self.feedback.value)]).astype(complex)

    @property
    def zeros(self) -> Complex:
        """Zeros in z; those of the delay left out."""
        return np.roots(self.feedforward.value).astype(complex)

    @property
    def static_gain(self) -> float:
        """Position reached per position commanded."""
        return float(self.feedforward.value.sum() / (1.0 - self.feedback.value.sum()))

    def response(self, frequency: Array) -> Complex:
        """
        Return the complex frequency response.

        Parameters
        ----------
        frequency : ndarray, shape (n,)
            [Hz]

        Returns
        -------
        ndarray of complex, shape (n,)
        """
        q = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        above = np.polynomial.polynomial.polyval(q, self.feedforward.value) * q**self.delay
        below = np.polynomial.polynomial.polyval(q, [1.0, *(-self.feedback.value)])
        return np.asarray(above / below, dtype=complex)


@dataclass(frozen=True)
class Slide(Section):
    """The tool on the Optidrive, [Gamez2005] Eq. 29."""

    mass: Annotated[Estimate, Entry('Of the tool', 'kg', above=0.0)]
    stiffness: Annotated[Estimate, Entry('Of the spring', 'N/m', above=0.0)]
    damping: Annotated[Estimate, Entry('Of the damper', 'N s/m', above=0.0)]


@dataclass(frozen=True)
class Plant:
    """Robot and slide together."""

    robot: Robot
    slide: Slide
