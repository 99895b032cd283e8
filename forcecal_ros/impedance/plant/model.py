"""Models of robot and tool along x of ft_sensor, with their standard errors."""

from dataclasses import dataclass

from forcecal_ros.calibration.model import Estimate
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Robot:
    """
    Commanded to reached position, as difference equation in the form of [Gamez2005] Eq. 28.

    y_k = sum_i feedback_i y_(k-i) + sum_i feedforward_i r_(k-delay-i+1), i from 1.

    Attributes
    ----------
    period : float
        [s]
    delay : int
        Periods from a command to the first position that it changes, at least 1.
    feedback, feedforward : Estimate, shape (n,), (m,)
        [1]
    """

    period: float
    delay: int
    feedback: Estimate
    feedforward: Estimate

    def __post_init__(self) -> None:
        if not 0.0 < self.period < 1.0 or self.delay < 1:
            raise ConfigError(f'robot: period {self.period:g} s and delay {self.delay}; expected '
                              'a period below 1 s and a delay of 1 or more periods')
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
class Slide:
    """
    The tool on the Optidrive, [Gamez2005] Eq. 29.

    Attributes
    ----------
    mass, stiffness, damping : Estimate
        [kg], [N/m], [N s/m]
    """

    mass: Estimate
    stiffness: Estimate
    damping: Estimate

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 < float(value) < np.inf:
                raise ConfigError(f'slide.{name} is {float(value):g}; it wants a positive number')


@dataclass(frozen=True)
class Plant:
    """Robot and slide together."""

    robot: Robot
    slide: Slide
