"""A simulator that can be run again, as what a diagnosis changes and compares a recording with."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, NamedTuple

from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.core.schema import Row
from forcecal_ros.effects import AccelerometerEffects, Effect, EFFECTS, physical_rig, Quantity
from forcecal_ros.effects.library import MOVING
from forcecal_ros.effects.nuisances import LEAST, Nuisance, of_sensors
from forcecal_ros.effects.rig import Rig, scaled, shifted
from forcecal_ros.sim.measured_motion import (
    contact_blocks,
    CONTACT_FORCE_N,
    EXACT_RATIO,
    widen_blocks,
)
from forcecal_ros.sim.protocol import Parameter
from forcecal_ros.sim.rigid_tool import CABLE, CarriedTool, RigidTool
from forcecal_ros.sim.runs import Numbers, Runs
from forcecal_ros.sim.signals import block_means, JOINTS, MOST, padded, RATE, Signals, UNSEEN
import numpy as np
from numpy.typing import NDArray

INTEGRATION_STEP, INTEGRATION_STD = 'integration.step', 1.0
"""
What is wrong with a step of integration, 1 sigma, in what half the step changes: a robot is no
simulation, and of an integrator of first order, as Euler, all of its error is twice that.
"""

ADDABLE = frozenset({'robot_delay', 'tool_mass', 'tool_com', 'base_tilt', CABLE})
"""Effects of robot and tool that are added to any simulator's signals."""


@dataclass(frozen=True)
class SimulatedRobot(RigidTool):
    """
    A tool and sensors behind a third-party simulator.

    Attributes
    ----------
    numbers : tuple of float
        A value of each of the simulator's parameters.
    mounting : tuple of float
        Of the measured pose against the simulated: position in base [m], turn in ft_sensor [rad].
    zeros : tuple of float
        Of the measured joints against the simulated [rad].
    late : float
        How much later than its simulation the robot does what it is commanded [s].
    finer : float
        What an integration of endless patience changes, in what half the step does.
    """

    numbers: Annotated[tuple[float, ...], Row('of the parameters')] = ()
    mounting: Annotated[tuple[float, ...], Row('position and turn')] = (0.0,) * 6
    zeros: Annotated[tuple[float, ...], Row('of the joints')] = (0.0,) * JOINTS
    late: Annotated[float, Row('robot behind its simulation', 's')] = 0.0
    finer: Annotated[float, Row('of what half the step of integration changes')] = 0.0


def simulated_robot(rigid_tool: RigidTool, parameters: tuple[Parameter, ...]) -> SimulatedRobot:
    """Put a tool and sensors behind a simulator with its nominal parameters."""
    own = {f.name: getattr(rigid_tool, f.name) for f in fields(RigidTool)}
    return SimulatedRobot(**own, numbers=tuple(p.nominal for p in parameters))


def library_of(parameters: tuple[Parameter, ...]) -> dict[str, Effect]:
    """
    List what a robot may have beside what is simulated: parameters that are off, and effects.

    A parameter's effect exceeds the nuisance of its name, and takes the place of the effects that
    it represents.
    """
    made = {name for p in parameters for name in p.stands_for}
    own = {p.name: _effect(p) for p in parameters}
    late = EFFECTS['robot_delay']._replace(nuisance='late')
    known = {**EFFECTS, late.name: late}
    return {**own, **{name: e for name, e in known.items() if name not in made | set(own)}}


def is_addable(effect: Effect, accelerated: bool) -> bool:
    """Say whether an effect is a parameter's, or can be added to a simulator's signals."""
    if effect.nuisance == effect.name or effect.name in ADDABLE:
        return True
    return effect.where == 'signal' and effect.name not in UNSEEN and (
        accelerated or effect.stage != 'accelerometer')


def _effect(p: Parameter) -> Effect:
    # a clearly visible change of a parameter, in its sigma: beyond what a nuisance may take
    visible = p.nominal + 10.0 * p.sigma
    value = Quantity('value', p.unit, p.nominal, p.low, p.high, visible)
    return Effect(p.name, p.stage, (value,), MOVING, True, 'rig', p.name)


def nuisances_of(parameters: tuple[Parameter, ...], joints: int = 0, *, finer: bool = False
                 ) -> list[Nuisance]:
    """
    List the simulator's parameters, and where base, sensor and joints are, as nuisances.

    Parameters
    ----------
    finer : bool
        Whether it is known what a finer integration changes.
    """
    change = partial(shifted, '')
    found = [Nuisance(p.name, p.name, change('numbers', i), least=p.low - p.nominal,
                      prior_std=p.sigma) for i, p in enumerate(parameters)]
    # delay of the robot beyond its simulator's, 1 sigma [s]: a cycle of a fast driver
    found.append(Nuisance('robot.delay', 'late', change('late'), prior_std=0.001))
    if finer:
        found.append(Nuisance(INTEGRATION_STEP, 'finer', change('finer'),
                              prior_std=INTEGRATION_STD))
    # place of sensor and base, 1 sigma [m], [rad]: as far as a drawing and an arm are apart
    found += [Nuisance(f'mounting.{i}', 'mounting', change('mounting', i),
                       prior_std=(0.005, 0.01)[i // 3]) for i in range(6)]
    # joint bias std: of a joint's encoder against its simulation, 1 sigma [rad]: as exactly as
    # arms are mastered
    return found + [Nuisance(f'joint.zero.{i}', 'zeros', change('zeros', i),
                             prior_std=2e-4) for i in range(joints)]


class _Carried(NamedTuple):
    """A tool along one motion, what an accelerometer feels there, and where the joints are."""

    tool: CarriedTool
    accel: Array | None
    joints: Array | None


class Rerun:
    """
    One recording's commands, simulated by a third-party simulator as often as needed.

    Parameters
    ----------
    start : float
        When block 0 begins [s].
    rigid_tool : RigidTool
        The simulator's tool, as its wrench and motion tell it.
    """

    band, exact, accelerometer = MOST, EXACT_RATIO, 'acc1'
    starts_white, from_accelerometer = True, False

    def __init__(self, runs: Runs, start: float, n_blocks: int, rigid_tool: RigidTool) -> None:
        self.runs, self.start, self.n_blocks, self._rigid_tool = runs, start, n_blocks, rigid_tool
        nominal = runs.exact(runs.simulator.nominal)
        self.accelerated = nominal.accelerometer is not None
        self.joints = () if nominal.joints is None else nominal.joints.names
        self.library: Mapping[str, Effect] = library_of(runs.simulator.parameters)
        self._carried: dict[tuple[Numbers, float, float], _Carried] = {}

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
        return is_addable(self.library[effect], self.accelerated)

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List the nuisance parameters: those of the simulator, tool, mounting and sensors."""
        found = nuisances_of(self.runs.simulator.parameters, len(self.joints),
                             finer=self.runs.simulator.has_finer)
        if 'tool_mass' in self.library:
            found.append(Nuisance('tool.mass', 'mass', scaled('tool', 'mass'), least=LEAST))
        if 'tool_com' in self.library:
            found += [Nuisance(f'tool.com.{a}', 'com', shifted('tool', 'com', i))
                      for i, a in enumerate('xyz')]
        found += of_sensors(self.accelerometer, streams)
        return tuple(n for n in found if n.prior_std or getattr(rig.spreads, n.key) > 0.0)

    def tangent(self, rig: Rig) -> Hashable:
        """Return where all parameters were tried, and the effects that act beside them."""
        assert isinstance(rig, SimulatedRobot)
        return self.runs.near(rig.numbers), rig.effects

    def smooth(self, signals: Signals) -> Signals:
        """Return signals as a discrepancy may follow them: these have no noise."""
        return signals

    def knocking(self, rig: Rig) -> NDArray[np.bool_]:
        """
        Tell blocks in which the tool touches something, and half the step changes how.

        What knocks, or sticks and slips, does so otherwise with every number.
        """
        assert isinstance(rig, SimulatedRobot)
        tool = self._along(rig).tool
        if not self.runs.simulator.has_finer:
            return np.zeros(self.n_blocks, dtype=bool)
        changed = (tool.recorded_wrench(self.runs.halved(rig.numbers))
                   - tool.recorded_wrench(self.runs.exact(rig.numbers)))
        force = np.linalg.norm(block_means(changed)[:, :3], axis=1)
        return contact_blocks(block_means(tool.beyond)) & widen_blocks(force > CONTACT_FORCE_N)

    def forget(self) -> None:
        """Let what was predicted be requested anew, where the simulator was run meanwhile."""
        self._carried = {}

    def signals(self, rig: Rig) -> Signals:
        """
        Simulate.

        Parameters
        ----------
        rig : Rig
            A SimulatedRobot.
        """
        assert isinstance(rig, SimulatedRobot)
        carried, accel, joints = self._along(rig)
        place, turn = np.array(rig.mounting[:3]), np.array(rig.mounting[3:])
        n = len(carried.t)
        volts = np.zeros((n, 3)) if accel is None else self._volts(rig, carried, accel)
        if joints is not None:
            joints = padded(joints + rig.zeros[:len(self.joints)])
        return Signals(
            self.start, carried.wire(rig), volts, carried.slide, carried.position + place,
            carried.R_base_sensor @ rotation_from_vector(turn), carried.velocity,
            carried.acceleration, carried.omega, carried.alpha, np.zeros(n), np.zeros((n, 6)),
            carried.specific_force(rig), joints)

    def _volts(self, rig: Rig, carried: CarriedTool, readings: Array) -> Array:
        rigid_tool = physical_rig(rig)
        model = rigid_tool.accelerometer.model(self.accelerometer)
        readings = readings + carried.weight(rigid_tool) - carried.weight(self._rigid_tool)
        on_volts = AccelerometerEffects(rig, self.accelerometer, 1.0 / RATE)
        return on_volts.after_noise(on_volts.before_noise(readings * model.gain + model.offset))

    def _along(self, rig: SimulatedRobot) -> '_Carried':
        """Carry the simulator's tool along its own motion, so much later; the last are kept."""
        key = rig.numbers, rig.late, rig.finer
        if key not in self._carried:
            # carried tools that are kept, one for each motion
            if len(self._carried) >= 6:
                self._carried.pop(next(iter(self._carried)))
            made = self.runs.integrated(rig.numbers, rig.finer)
            motion = replace(made, accelerometer=None)
            carried = CarriedTool(motion, self.start - rig.late, self.n_blocks,
                                  self.accelerometer)
            carried.beyond = carried.recorded_wrench(made) - carried.wire(self._rigid_tool)
            accel, joints = (None if one is None else one.at(carried.t)
                            for one in (made.accelerometer, made.joints))
            self._carried[key] = _Carried(carried, accel, joints)
        # the point that all others are compared with is requested most, and is not to go first
        found = self._carried.pop(key)
        self._carried[key] = found
        return found
