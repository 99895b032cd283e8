"""Somebody's simulator as what a diagnosis changes: its parameters, beside tool and sensors."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Annotated

from forcecal_ros.core.schema import Row
from forcecal_ros.effects import Effect, EFFECTS, Quantity
from forcecal_ros.effects.library import MOVING
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.protocol import Parameter
from forcecal_ros.sim.rigid_tool import CABLE, RigidTool
from forcecal_ros.sim.signals import JOINTS, UNSEEN

MOUNTING = (0.005, 0.01)
"""Place of sensor and base, 1 sigma [m], [rad]: as far as a drawing and an arm are apart."""

LATE = 0.001
"""Delay of the robot beyond its simulator's, 1 sigma [s]: a cycle of a fast driver."""

ZERO = 2e-4
"""Of a joint's encoder against its simulation, 1 sigma [rad]: as exactly as arms are mastered."""

STEP, BEND, COARSE = 'integration.step', 'integration.bend', 1.0
"""
What is wrong with a step of integration, 1 sigma, in what half the step changes: a robot is no
simulation, and of an integrator of first order, as Euler, all of its error is twice that.
"""

VISIBLE = 10.0
"""A clearly visible change of a parameter, in its sigma: beyond what a nuisance may take."""

BESIDE = frozenset({'robot_delay', 'tool_mass', 'tool_com', 'base_tilt', CABLE})
"""Effects of robot and tool that are added to any simulator's signals."""


@dataclass(frozen=True)
class SimulatedRobot(RigidTool):
    """
    A tool and sensors behind somebody's simulator.

    Attributes
    ----------
    numbers : tuple of float
        A value of each of the simulator's parameters.
    mounting : tuple of float
        Of the measured pose against the simulated: position in base [m], turn in ft_sensor [rad].
    zeros : tuple of float
        Of the measured joints against the simulated [rad].
    late : float
        How much later than its simulation the robot does what it is told [s].
    finer : float
        What an integration of endless patience changes, in what half the step does.
    finest : float
        The same, in what a quarter of the step does beyond 1.5 times that: 2.7 of an error that
        goes with the square of the step.
    """

    numbers: Annotated[tuple[float, ...], Row('of the parameters')] = ()
    mounting: Annotated[tuple[float, ...], Row('position and turn')] = (0.0,) * 6
    zeros: Annotated[tuple[float, ...], Row('of the joints')] = (0.0,) * JOINTS
    late: Annotated[float, Row('robot behind its simulation', 's')] = 0.0
    finer: Annotated[float, Row('of what half the step of integration changes')] = 0.0
    finest: Annotated[float, Row('of what a quarter of it changes beyond 1.5 times that')] = 0.0


def simulated_robot(rigid_tool: RigidTool, parameters: tuple[Parameter, ...]) -> SimulatedRobot:
    """Put a tool and sensors behind a simulator with its nominal parameters."""
    own = {f.name: getattr(rigid_tool, f.name) for f in fields(RigidTool)}
    return SimulatedRobot(**own, numbers=tuple(p.nominal for p in parameters))


def library_of(parameters: tuple[Parameter, ...]) -> dict[str, Effect]:
    """
    List what a robot may have beside what is simulated: parameters that are off, and effects.

    A parameter's effect exceeds the nuisance of its name, and takes the place of the effects that
    it stands for.
    """
    made = {name for p in parameters for name in p.stands_for}
    own = {p.name: _effect(p) for p in parameters}
    late = EFFECTS['robot_delay']._replace(nuisance='late')
    known = {**EFFECTS, late.name: late}
    return {**own, **{name: e for name, e in known.items() if name not in made | set(own)}}


def addable(effect: Effect, accelerated: bool) -> bool:
    """Say whether an effect is a parameter's, or can be added to a simulator's signals."""
    if effect.nuisance == effect.name or effect.name in BESIDE:
        return True
    return effect.where == 'signal' and effect.name not in UNSEEN and (
        accelerated or effect.stage != 'accelerometer')


def _effect(p: Parameter) -> Effect:
    value = Quantity('value', p.unit, p.nominal, p.low, p.high, p.nominal + VISIBLE * p.sigma)
    return Effect(p.name, p.stage, (value,), MOVING, True, 'rig', p.name)


def nuisances_of(parameters: tuple[Parameter, ...], joints: int = 0, *, finer: bool = False,
                 finest: bool = False) -> list[Nuisance]:
    """
    List the simulator's parameters, and where base, sensor and joints are, as nuisances.

    Parameters
    ----------
    finer : bool
        Whether it is known what a finer integration changes.
    finest : bool
        Whether it is known what a still finer one changes beyond that.
    """
    found = [Nuisance(p.name, p.name, _number(i), least=p.low - p.nominal, prior_std=p.sigma)
             for i, p in enumerate(parameters)]
    found.append(Nuisance('robot.delay', 'late', _later, prior_std=LATE))
    if finer:
        found.append(Nuisance(STEP, 'finer', _finer, prior_std=COARSE))
    if finest:
        found.append(Nuisance(BEND, 'finest', _finest, prior_std=COARSE))
    found += [Nuisance(f'mounting.{i}', 'mounting', _mounting(i), prior_std=MOUNTING[i // 3])
              for i in range(6)]
    return found + [Nuisance(f'joint.zero.{i}', 'zeros', _zero(i), prior_std=ZERO)
                    for i in range(joints)]


def _number(index: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        assert isinstance(rig, SimulatedRobot)
        return replace(rig, numbers=_added(rig.numbers, index, x))
    return apply


def _finer(rig: Rig, x: float) -> Rig:
    assert isinstance(rig, SimulatedRobot)
    return replace(rig, finer=rig.finer + x)


def _finest(rig: Rig, x: float) -> Rig:
    assert isinstance(rig, SimulatedRobot)
    return replace(rig, finest=rig.finest + x)


def _mounting(index: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        assert isinstance(rig, SimulatedRobot)
        return replace(rig, mounting=_added(rig.mounting, index, x))
    return apply


def _zero(index: int) -> Callable[[Rig, float], Rig]:
    def apply(rig: Rig, x: float) -> Rig:
        assert isinstance(rig, SimulatedRobot)
        return replace(rig, zeros=_added(rig.zeros, index, x))
    return apply


def _later(rig: Rig, x: float) -> Rig:
    assert isinstance(rig, SimulatedRobot)
    return replace(rig, late=rig.late + x)


def _added(values: tuple[float, ...], index: int, x: float) -> tuple[float, ...]:
    return (*values[:index], values[index] + x, *values[index + 1:])
