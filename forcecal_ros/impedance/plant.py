"""Robot and tool along x of ft_sensor: their models, ``plant.yaml``, and the process with a wall.

The continuous form of [Gamez2005] Eq. 30 holds at the sample times only: between them its robot
swings at several m/s, and the tool with it. So the robot stays a difference equation, and the
slide, driven by a position that goes linearly from sample to sample, is solved exactly over a
period.
"""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, NamedTuple

from forcecal_ros.core.calibration import Entry, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.schema import load, Row, Section
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

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
                              'all must be below 1')

    @property
    def poles(self) -> Complex:
        """Poles in z."""
        return np.roots([1.0, *(-self.feedback.value)]).astype(complex)

    @property
    def static_gain(self) -> float:
        """Position reached per position commanded."""
        return float(self.feedforward.value.sum() / (1.0 - self.feedback.value.sum()))


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


FORMAT = 'forcecal-plant/1'


def load_plant(path: Path | str | None = None) -> Plant:
    """
    Read ``plant.yaml``.

    Parameters
    ----------
    path : Path or str, optional
        By default what was identified on the nominal rig.

    Raises
    ------
    ConfigError
        The file cannot be read, or is none of ``forcecal fit-rig --for impedance``.
    """
    name = 'plant.yaml' if path is None else str(path)
    source = files('forcecal_ros') / 'config' / name if path is None else Path(path)
    return load(Plant, source, name=name, form=FORMAT, extra=True,
                remedy='give a file of forcecal fit-rig --for impedance')


class Process(NamedTuple):
    """
    X_(k+1) = A X_k + B u_k + F f_k, all along x of ft_sensor.

    Attributes
    ----------
    A : ndarray, shape (n, n)
    B : ndarray, shape (n,)
        Of the command u of S [m].
    F : ndarray, shape (n,)
        Of a force f on the tool that holds for a period [N].
    robot, tool, velocity : ndarray, shape (n,)
        Rows that give the positions of S and of the tool [m], and the tool's velocity [m/s].
    wall : ndarray, shape (n,)
        Row that gives the force of the wall on the tool [N].
    """

    A: Array
    B: Array
    F: Array
    robot: Array
    tool: Array
    velocity: Array
    wall: Array


class Wall(NamedTuple):
    """A wall that the tool stays in contact with: stiffness [N/m], damping [N s/m]."""

    stiffness: float = 0.0
    damping: float = 0.0


def process(plant: Plant, latency: int = 0, wall: Wall = Wall()) -> Process:
    """
    Put robot, slide and wall together.

    Parameters
    ----------
    latency : int
        Periods that a command takes beyond the robot's own delay.
    wall : Wall
        Its surface at position 0; of stiffness 0 where there is none.
    """
    A_r, B_r, C_r = _robot(plant.robot, latency)
    over, begin, end, push = _slide(plant.slide, wall, plant.robot.period)
    n = len(A_r)
    # the slide is driven by C_r x at the begin of the period, C_r (A_r x + B_r u) at its end
    A = np.block([[A_r, np.zeros((n, 2))],
                  [np.outer(begin, C_r) + np.outer(end, C_r @ A_r), over]])
    B = np.append(B_r, end * (C_r @ B_r))
    F = np.append(np.zeros(n), push)
    robot = np.append(C_r, (0.0, 0.0))
    tool, rest = np.eye(n + 2)[-2:]
    velocity = rest - _drag(plant.slide) * (tool - robot)
    return Process(A, B, F, robot, tool, velocity,
                   -wall.stiffness * tool - wall.damping * velocity)


def _drag(slide: Slide) -> float:
    return float(slide.damping) / float(slide.mass)


def _robot(robot: Robot, latency: int) -> tuple[Array, Array, Array]:
    """Return A, B and C of the difference equation, in observer form, delays included."""
    a = robot.feedback.value
    b = np.append(np.zeros(robot.delay - 1 + latency), robot.feedforward.value)
    n = max(len(a), len(b))
    A = np.eye(n, k=1)
    A[:len(a), 0] = a
    return A, np.append(b, np.zeros(n - len(b))), np.eye(n)[0]


def _slide(slide: Slide, wall: Wall, period: float) -> tuple[Array, Array, Array, Array]:
    """
    Solve the slide over one period, [Gamez2005] Eq. 29.

    States are x and w = dx/dt + d/m (x - x_rb), so that the velocity of S is not needed.

    Returns
    -------
    over : ndarray, shape (2, 2)
        From the states at the begin.
    begin, end : ndarray, shape (2,)
        From the position of S there.
    push : ndarray, shape (2,)
        From a force that holds.
    """
    m, k, drag = float(slide.mass), float(slide.stiffness), _drag(slide)
    force = np.array([0.0, 1.0 / m])
    # wall: f = -k_e x - d_e (w - d/m x + d/m x_rb)
    A = np.array([[-drag, 1.0], [-k / m, 0.0]]) + np.outer(
        force, [wall.damping * drag - wall.stiffness, -wall.damping])
    B = np.array([drag, k / m]) - force * wall.damping * drag
    joint = np.zeros((5, 5))  # states, x_rb, its change in the period, force
    joint[:2, :2], joint[:2, 2], joint[:2, 4] = A * period, B * period, force * period
    joint[2, 3] = 1.0
    solved = expm(joint)[:2]
    return solved[:, :2], solved[:, 2] - solved[:, 3], solved[:, 3], solved[:, 4]
