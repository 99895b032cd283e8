"""
A simulator that can be run again: the recorded commands through it, with other parameters.

Running it is dear. So its streams are taken to be linear in the parameters about the nearest
point where all of them were tried, one after the other; where it was run itself, its own answer
counts.
"""

from collections.abc import Hashable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

from forcecal_ros.effects import AccelerometerEffects, Effect, physical_rig
from forcecal_ros.effects.nuisances import LEAST, Nuisance, of_sensors, scaled, shifted
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.recording.streams import PoseStream, Recording, Stream
from forcecal_ros.simulators.low_pass import MOST
from forcecal_ros.simulators.measured_motion import around, EXACT, FORCE, touches
from forcecal_ros.simulators.poses import in_base_of
from forcecal_ros.simulators.protocol import Inputs
from forcecal_ros.simulators.rigid_tool import CarriedTool, RigidTool
from forcecal_ros.simulators.signals import block_means, padded, RATE, Signals
from forcecal_ros.simulators.simulated_robot import (
    addable,
    library_of,
    nuisances_of,
    SimulatedRobot,
)
from forcecal_ros.simulators.third_party import ThirdParty
import numpy as np
from numpy.typing import NDArray

STEP = 1.0
"""Step by which a parameter is moved to see what it does, in its sigma."""

KEPT = 6
"""Carried tools that are kept, one for each motion."""

Numbers = tuple[float, ...]


class _Change(NamedTuple):
    """What one sigma of a parameter does: to wrench, position, turn, accelerometer, joints."""

    wrench: Array
    position: Array
    turn: Array
    accelerometer: Array | None
    joints: Array | None = None


class Runs:
    """
    A simulator under one recording's commands.

    Parameters
    ----------
    measured : PoseStream
        Of the robot, on the inputs' clock: in its base.

    Attributes
    ----------
    count : int
        How often it was run.
    """

    def __init__(self, simulator: ThirdParty, inputs: Inputs, measured: PoseStream) -> None:
        self.simulator, self.count = simulator, 0
        self._inputs, self._measured = inputs, measured
        self._exact: dict[Numbers, Recording] = {}
        self._changes: dict[Numbers, list[_Change]] = {}
        self._halved: dict[Numbers, Recording] = {}
        self._finer: dict[Numbers, _Change] = {}

    def exact(self, numbers: Numbers) -> Recording:
        """Run the simulator, unless it was run so before."""
        if numbers not in self._exact:
            self.count += 1
            made = self.simulator.run(self._inputs, numbers)
            assert made.pose is not None
            self._exact[numbers] = replace(made, pose=in_base_of(self._measured, made.pose))
        return self._exact[numbers]

    def repeats(self) -> bool:
        """Run the simulator once more with its own numbers; say whether it does the same."""
        numbers = self.simulator.nominal
        first = self._exact.pop(numbers)
        again = self.exact(numbers)
        return all(np.array_equal(a, b) for a, b in zip(_arrays(first), _arrays(again)))

    def try_all(self, numbers: Numbers) -> None:
        """See what each parameter does at a point: one run for each, and one for the point."""
        here, changes = self.exact(numbers), []
        for i, p in enumerate(self.simulator.parameters):
            step = STEP * p.sigma
            if numbers[i] + step > p.high:
                step = -step
            change = self._changed(here, numbers, i, step)
            if _is_nothing(change) and numbers[i] - step > p.low:  # a limit acts where it is lower
                change = self._changed(here, numbers, i, -step)
            changes.append(change)
        self._changes[numbers] = changes
        if self.simulator.has_finer:
            self._finer[numbers] = _change(*_of_one_length(here, self.halved(numbers)), 1.0)

    def halved(self, numbers: Numbers) -> Recording:
        """Run it with half its step of integration, unless that was done before."""
        if numbers not in self._halved:
            self.count += 1
            made = self.simulator.run_finer(self._inputs, numbers)
            assert made.pose is not None
            self._halved[numbers] = replace(made, pose=in_base_of(self._measured, made.pose))
        return self._halved[numbers]

    def changes(self, numbers: Numbers) -> Sequence['_Change']:
        """Return what one sigma of each parameter does at a point that was tried."""
        return self._changes[numbers]

    def _changed(self, here: Recording, numbers: Numbers, i: int, step: float) -> _Change:
        """Run it with another value of a parameter, and say what one sigma of that does."""
        moved = (*numbers[:i], numbers[i] + step, *numbers[i + 1:])
        return _change(here, self._passing(moved), self.simulator.parameters[i].sigma / step)

    def _passing(self, numbers: Numbers) -> Recording:
        made = self.exact(numbers)
        del self._exact[numbers]
        return made

    def otherwise(self, numbers: Numbers, beside: Mapping[str, float]) -> 'Runs':
        """Run the simulator with something beside its parameters; what is near stays as it is."""
        made = self.simulator.run(self._inputs, numbers, beside)
        assert made.pose is not None
        self.count += 1
        other = copy(self)
        other.keep(numbers, replace(made, pose=in_base_of(self._measured, made.pose)))
        return other

    def keep(self, numbers: Numbers, made: Recording) -> None:
        """Take this for what it says there."""
        self._exact = {**self._exact, numbers: made}

    def at(self, numbers: Numbers) -> Recording:
        """Return what it says with other parameters, as far as that is linear in them."""
        if numbers in self._exact or not self._changes:
            return self.exact(numbers)
        near = self.near(numbers)
        away = (np.array(numbers) - near) / self._sigma
        return _moved(self._exact[near], self._changes[near], away)

    def integrated(self, numbers: Numbers, finer: float) -> Recording:
        """Return what it says if its step made so many times what halving it makes."""
        made = self.at(numbers)
        if not finer or not self._finer:
            return made
        return _moved(made, [self._finer[self.near(numbers)]], np.array([finer]))

    @property
    def _sigma(self) -> Array:
        return np.array([p.sigma for p in self.simulator.parameters])

    def near(self, numbers: Numbers) -> Numbers:
        """Return the nearest point at which all parameters were tried."""
        return min(self._changes, key=lambda one: float(
            np.linalg.norm((np.array(numbers) - one) / self._sigma)))


def _arrays(made: Recording) -> list[Array]:
    assert made.wrench is not None
    assert made.pose is not None
    others = [one.values for one in (made.accelerometer, made.joints) if one is not None]
    return [made.wrench.values, made.pose.position, made.pose.R_base_sensor, *others]


def _of_one_length(here: Recording, finer: Recording) -> tuple[Recording, Recording]:
    """Let the last row stand for one that a finer run lacks, whose last step may end earlier."""
    def padded_as(one: Any, like: Any) -> Any:
        rows = np.minimum(np.arange(len(like)), len(one) - 1)
        return replace(one.rows(rows), t=like.t)

    return here, replace(finer, **{
        name: padded_as(getattr(finer, name), getattr(here, name))
        for name in ('wrench', 'pose', 'accelerometer', 'joints')
        if getattr(finer, name) is not None})


def _change(here: Recording, there: Recording, scale: float) -> _Change:
    one, other = here.pose, there.pose
    assert one is not None
    assert other is not None
    turn = rotation_vector(np.swapaxes(one.R_base_sensor, 1, 2) @ other.R_base_sensor)
    wrench = _less(there.wrench, here.wrench, scale)
    assert wrench is not None
    return _Change(wrench, scale * (other.position - one.position), scale * turn,
                   _less(there.accelerometer, here.accelerometer, scale),
                   _less(there.joints, here.joints, scale))


def _is_nothing(change: _Change) -> bool:
    return not any(rows is not None and rows.any() for rows in change)


def _less(one: Stream | None, other: Stream | None, scale: float) -> Array | None:
    if one is None or other is None:
        return None
    return np.asarray(scale * (one.values - other.values))


def _moved(base: Recording, changes: Sequence[_Change], away: Array) -> Recording:
    wrench, pose, accel, joints = base.wrench, base.pose, base.accelerometer, base.joints
    assert wrench is not None
    assert pose is not None
    turn = sum((x * c.turn for c, x in zip(changes, away)), np.zeros_like(pose.position))
    position = sum((x * c.position for c, x in zip(changes, away)), np.array(pose.position))
    values = sum((x * c.wrench for c, x in zip(changes, away)), np.array(wrench.values))
    if accel is not None:
        accel = replace(accel, values=sum(
            (x * c.accelerometer for c, x in zip(changes, away) if c.accelerometer is not None),
            np.array(accel.values)))
    if joints is not None:
        joints = replace(joints, values=sum(
            (x * c.joints for c, x in zip(changes, away) if c.joints is not None),
            np.array(joints.values)))
    return replace(base, wrench=replace(wrench, values=values), accelerometer=accel, joints=joints,
                   pose=replace(pose, position=position,
                                R_base_sensor=pose.R_base_sensor @ rotation_from_vector(turn)))


def refuse_unsteady(runs: Runs) -> None:
    """Refuse a simulator that does something else the second time."""
    if not runs.repeats():
        raise ConfigError(f'{runs.simulator.name}: the same commands and parameters gave another '
                          'answer the second time; seed its noise, and begin '
                          'each run from the same state')


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

    band, exact, starts_white, accelerometer = MOST, EXACT, True, 'acc1'

    def __init__(self, runs: Runs, start: float, n_blocks: int, rigid_tool: RigidTool) -> None:
        self.runs, self.start, self.n_blocks, self._rigid_tool = runs, start, n_blocks, rigid_tool
        nominal = runs.exact(runs.simulator.nominal)
        self.accelerated = nominal.accelerometer is not None
        self.joints = () if nominal.joints is None else nominal.joints.names
        self.library: Mapping[str, Effect] = library_of(runs.simulator.parameters)
        self._carried: dict[tuple[Numbers, float, float], _Carried] = {}

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
        return addable(self.library[effect], self.accelerated)

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
        tool = self._along(rig.numbers, rig.late, rig.finer).tool
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
        carried, accel, joints = self._along(rig.numbers, rig.late, rig.finer)
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

    def _along(self, numbers: Numbers, late: float, finer: float) -> '_Carried':
        """Carry the simulator's tool along its own motion, so much later; the last are kept."""
        if (numbers, late, finer) not in self._carried:
            if len(self._carried) >= KEPT:
                self._carried.pop(next(iter(self._carried)))
            made = self.runs.integrated(numbers, finer)
            motion = replace(made, accelerometer=None)
            carried = CarriedTool(motion, self.start - late, self.n_blocks, self.accelerometer)
            carried.beyond = carried.recorded_wrench(made) - carried.wire(self._rigid_tool)
            accel, joints = (None if one is None else one.at(carried.t)
                            for one in (made.accelerometer, made.joints))
            self._carried[numbers, late, finer] = _Carried(carried, accel, joints)
        # the point that all others are compared with is asked for most, and is not to go first
        found = self._carried.pop((numbers, late, finer))
        self._carried[numbers, late, finer] = found
        return found
