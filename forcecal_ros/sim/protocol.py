"""What a simulator has to offer to be compared with a robot: its parameters, and to be run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple, Protocol

from forcecal_ros.core.streams import JointStream, PoseStream


class Parameter(NamedTuple):
    """
    A number that a simulator lets others set.

    Attributes
    ----------
    name : str
        In the words of the simulator's user.
    nominal : float
        What it is now.
    sigma : float
        How well that is known, 1 sigma: a robot that is further away has a gap of this name.
    unit : str
        ``1`` where it has none.
    low, high : float
        Limits.
    stage : str
        ``robot``, ``tool`` or ``environment``: what it is a number of.
    stands_for : tuple of str
        Effects of the library that it makes itself, as ``tool_mass``; these are not tried beside.
    logarithmic : bool
        Whether signals are more nearly linear in its logarithm, as in gains and stiffnesses: a
        drive lags by kv / kp, and what trades between the two is a straight line then. It is
        above zero.
    """

    name: str
    nominal: float
    sigma: float
    unit: str = '1'
    low: float = -math.inf
    high: float = math.inf
    stage: str = 'robot'
    stands_for: tuple[str, ...] = ()
    logarithmic: bool = False

    def to_linear(self, value: float) -> float:
        """Return what signals are nearly linear in, which equals it and its slope at nominal."""
        if not self.logarithmic:
            return value
        ratio = math.log(value / self.nominal) if value > 0.0 else -math.inf
        return self.nominal * (1.0 + ratio)

    def from_linear(self, x: float, std: float = 0.0) -> tuple[float, float]:
        """Return the number again, and its standard error."""
        if not self.logarithmic:
            return x, std
        ratio = math.exp(x / self.nominal - 1.0)
        return self.nominal * ratio, std * ratio


@dataclass(frozen=True)
class Inputs:
    """
    What the robot was commanded, and when to begin and to end.

    Attributes
    ----------
    start, end : float
        All that is simulated is needed between them [s]. The robot rests at ``start``.
    target : PoseStream or None
        Commanded poses of ft_sensor in base.
    joints : JointStream or None
        Commanded positions of joints, and their names [rad] or [m].
    measured_joints : tuple of str
        Joints whose measured positions a simulator may be compared with, in the order of the
        columns required.
    """

    start: float
    end: float
    target: PoseStream | None = None
    joints: JointStream | None = None
    measured_joints: tuple[str, ...] = ()


class Simulator(Protocol):
    """
    A robot with its tool and sensors, which does the same whenever it is commanded the same.

    What ``simulate`` returns maps the name of a stream to its stamps [s], on the clock of the
    inputs, and its rows: ``wrench`` (n, 6) of all but the arm on the tool, so that at rest it is
    the tool's weight and points down, in ft_sensor [N], [N m]; ``pose`` (n, 7) position of
    ft_sensor in base [m] and quaternion x, y, z, w; where it has one, ``accelerometer`` (n, 3)
    specific force [m/s^2]; where it has joints, ``joints`` (n, k) their positions [rad] or [m], a
    column for each of the inputs' ``measured_joints``, NaN for those that it has not. No stream
    has noise.

    One that integrates may have a method ``simulate_finer``, which does the same with half the
    step, at the same stamps: what the step makes of the signals is then no gap. One with
    parameters of what may be touched may have a method ``idle(inputs)``, which names those that
    cannot act under these commands: they are left out.
    """

    def parameters(self) -> Sequence[Parameter]:
        """List what can be set."""

    def simulate(self, inputs: Inputs, parameters: Mapping[str, float]) -> Mapping[str, Any]:
        """Run under some commands with a value of every parameter."""
