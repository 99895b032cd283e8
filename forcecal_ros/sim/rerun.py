"""A simulator that can be run again, as what a diagnosis compares a recording with."""

from collections.abc import Hashable, Mapping
from copy import copy
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.effects import AccelerometerEffects, Effect, physical_rig
from forcecal_ros.effects.nuisances import LEAST, Nuisance, of_sensors, scaled, shifted
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.low_pass import MOST
from forcecal_ros.sim.measured_motion import around, EXACT, FORCE, touches
from forcecal_ros.sim.rigid_tool import CarriedTool, RigidTool
from forcecal_ros.sim.runs import Numbers, Runs
from forcecal_ros.sim.signals import block_means, padded, RATE, Signals
from forcecal_ros.sim.simulated_robot import (
    addable,
    library_of,
    nuisances_of,
    SimulatedRobot,
)
import numpy as np
from numpy.typing import NDArray

KEPT = 6
"""Carried tools that are kept, one for each motion."""

class _Carried(NamedTuple):
    """A tool along one motion, what an accelerometer feels there, and where the joints are."""

    tool: CarriedTool
    accel: Array | None
    joints: Array | None


class Rerun:
    """
    One recording's commands, simulated by somebody's simulator as often as needed.

    Parameters
    ----------
    start : float
        When block 0 begins [s].
    rigid_tool : RigidTool
        The simulator's tool, as its wrench and motion tell it.
    """

    band, exact, starts_white, usual_tolerances, accelerometer = MOST, EXACT, True, True, 'acc1'

    def __init__(self, runs: Runs, start: float, n_blocks: int, rigid_tool: RigidTool) -> None:
        self.runs, self.start, self.n_blocks, self._rigid_tool = runs, start, n_blocks, rigid_tool
        nominal = runs.exact(runs.simulator.nominal)
        self.accelerated = nominal.accelerometer is not None
        self.joints = () if nominal.joints is None else nominal.joints.names
        self.library: Mapping[str, Effect] = library_of(runs.simulator.parameters)
        self._carried: dict[tuple[Numbers, float, float, float], _Carried] = {}

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
        return addable(self.library[effect], self.accelerated)

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List the nuisance parameters: those of the simulator, tool, mounting and sensors."""
        found = nuisances_of(self.runs.simulator.parameters, len(self.joints),
                             finer=self.runs.simulator.has_finer, finest=self.runs.is_coarse)
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
        return touches(block_means(tool.beyond)) & around(force > FORCE)

    def otherwise(self, numbers: Numbers, beside: Mapping[str, float]) -> 'Rerun':
        """Return the same with the simulator run with something beside its parameters."""
        other = copy(self)
        other.runs = self.runs.otherwise(numbers, beside)
        other.forget()
        return other

    def forget(self) -> None:
        """Let what was predicted be asked for anew, where the simulator was run meanwhile."""
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
        key = rig.numbers, rig.late, rig.finer, rig.finest
        if key not in self._carried:
            if len(self._carried) >= KEPT:
                self._carried.pop(next(iter(self._carried)))
            made = self.runs.integrated(rig.numbers, rig.finer, rig.finest)
            motion = replace(made, accelerometer=None)
            carried = CarriedTool(motion, self.start - rig.late, self.n_blocks,
                                  self.accelerometer)
            carried.beyond = carried.recorded_wrench(made) - carried.wire(self._rigid_tool)
            accel, joints = (None if one is None else one.at(carried.t)
                            for one in (made.accelerometer, made.joints))
            self._carried[key] = _Carried(carried, accel, joints)
        # the point that all others are compared with is asked for most, and is not to go first
        found = self._carried.pop(key)
        self._carried[key] = found
        return found
