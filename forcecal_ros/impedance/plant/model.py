"""Models of robot and tool along x of ft_sensor, with standard errors and in state space."""

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from forcecal_ros.core.calibration import Entry, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import Row, Section
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import logm

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


_REAL = 1e-6
"""Largest imaginary part of a matrix logarithm, relative, that counts as rounding."""


class StateSpace(NamedTuple):
    """
    dX/dt = A X + B x_r, and C X are the positions of S and of the tool.

    Attributes
    ----------
    A : ndarray, shape (n, n)
    B : ndarray, shape (n,)
    C : ndarray, shape (2, n)
        States: n - 2 of the robot, position [m] and velocity [m/s] of the tool.
    """

    A: Array
    B: Array
    C: Array


def state_space(plant: Plant) -> StateSpace | None:
    """
    Give the continuous form that has the robot's samples, [Gamez2005] Eq. 30.

    The command holds for a period. Position and velocity of S, which drive the tool, are no
    states as in print but C x and C (A x + B x_r).

    Returns
    -------
    StateSpace or None
        None where the robot's difference equation has no continuous form: more delay than one
        period, or poles that are not positive.
    """
    robot, slide = plant.robot, plant.slide
    a, b = robot.feedback.value, robot.feedforward.value
    n = len(a)
    if robot.delay != 1 or len(b) > n:
        return None
    # controller form: the states are the last n values of command / denominator
    discrete = np.zeros((n + 1, n + 1))
    discrete[0, :n], discrete[1:n, :n - 1], discrete[0, n], discrete[n, n] = a, np.eye(n - 1), 1, 1
    if np.linalg.matrix_rank(discrete) <= n:
        return None
    continuous = np.asarray(logm(discrete)) / robot.period
    if np.abs(np.imag(continuous)).max() > _REAL * np.abs(continuous).max():
        return None
    A_r, B_r = np.real(continuous)[:n, :n], np.real(continuous)[:n, n]
    C_r = np.append(b, np.zeros(n - len(b)))
    m, k, d = float(slide.mass), float(slide.stiffness), float(slide.damping)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n], A[n, n + 1] = A_r, 1.0
    A[n + 1] = np.concatenate([(k * C_r + d * (C_r @ A_r)) / m, [-k / m, -d / m]])
    B = np.concatenate([B_r, [0.0, d / m * (C_r @ B_r)]])
    C = np.zeros((2, n + 2))
    C[0, :n], C[1, n] = C_r, 1.0
    return StateSpace(A, B, C)
