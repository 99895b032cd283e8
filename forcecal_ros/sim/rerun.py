"""
A simulator that can be run again, as what a diagnosis changes and compares a recording with.

Running it is expensive. So its streams are linear in the parameters about the nearest point where
it was run; the slope in each parameter is that of the nearest point at which it was changed.
Where a fit settles it is run, and parameters that went far are changed there; at the likeliest
explanation all are.
A diagnosis runs it a limited number of times.
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.core.schema import Row
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.effects import Effect, EFFECTS, physical_rig, Quantity
from forcecal_ros.effects.library import MOVING
from forcecal_ros.effects.nuisances import Nuisance, of_sensors, OF_TOOL
from forcecal_ros.effects.rig import Rig, shifted
from forcecal_ros.sim.measured_motion import (
    contact_blocks,
    CONTACT_FORCE_N,
    EXACT_RATIO,
    express_in_base,
    widen_blocks,
)
from forcecal_ros.sim.protocol import Inputs, Parameter
from forcecal_ros.sim.rigid_tool import CABLE, CarriedTool, RigidTool, wrench_of_blocks
from forcecal_ros.sim.signals import (
    accelerometer_volts,
    block_means,
    EXACT,
    JOINTS,
    KEPT,
    MOST,
    padded,
    Signals,
    UNSEEN,
)
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np
from numpy.typing import NDArray

Numbers = tuple[float, ...]

Change = Mapping[str, Array]
"""What one sigma of a parameter does: to wrench, accelerometer and joints as far as they are
there, to the position, and the rotation vector by which it turns."""

_STREAMS = ('wrench', 'accelerometer', 'joints')


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
    short : bool
        Whether it had been run too often for all to be tried about what was found.
    points : list
        Where it was run and signals are exact: all parameters were tried there, or a fit settled.
    """

    def __init__(self, simulator: ThirdParty, inputs: Inputs, measured: PoseStream) -> None:
        self.simulator, self.count, self.short = simulator, 0, False
        self._inputs, self._measured = inputs, measured
        self._exact: dict[Numbers, Recording] = {}
        self.points: list[Numbers] = []
        self._whole: list[Numbers] = []  # where all parameters were tried
        # what one sigma of each parameter does, by where it was tried
        self._lines: list[dict[Numbers, Change]] = [{} for _ in simulator.parameters]
        self._sigma = np.array([p.sigma for p in simulator.parameters])
        self._halved: dict[Numbers, Recording] = {}
        self._finer: dict[Numbers, Change] = {}

    def exact(self, numbers: Numbers) -> Recording:
        """Run the simulator, unless it was run so before."""
        if numbers not in self._exact:
            self._exact[numbers] = self._counted(self.simulator.run(self._inputs, numbers))
        return self._exact[numbers]

    def halved(self, numbers: Numbers) -> Recording:
        """Run it with half its step of integration, unless that was done before."""
        if numbers not in self._halved:
            self._halved[numbers] = self._counted(self.simulator.run_finer(self._inputs, numbers))
        return self._halved[numbers]

    def _counted(self, made: Recording) -> Recording:
        """Count a run, and bring its poses into the robot's base."""
        self.count += 1
        assert made.pose is not None
        return replace(made, pose=express_in_base(self._measured, made.pose))

    def refuse_unsteady(self) -> None:
        """Run a simulator once more; refuse one that does something else the second time."""
        numbers = self.simulator.nominal
        first, again = _arrays(self._exact.pop(numbers)), _arrays(self.exact(numbers))
        if not all(map(np.array_equal, first, again)):
            raise ConfigError(f'{self.simulator.name}: two runs with the same commands and '
                              'parameters differ; seed its noise, and begin each run from the '
                              'same state')

    def try_all(self, numbers: Numbers) -> None:
        """See what each parameter does at a point: one run for each, and one for the point."""
        here = self.exact(numbers)
        for i, lines in enumerate(self._lines):
            lines[numbers] = self._try(here, numbers, i)
        self.points = [*(one for one in self.points if one != numbers), numbers]
        self._whole.append(numbers)
        if self.simulator.has_finer:
            self._finer[numbers] = _change(*_of_one_length(here, self.halved(numbers)), 1.0)

    def _try(self, here: Recording, numbers: Numbers, i: int) -> Change:
        """Run it with another value of a parameter, so near or to that side that it acts."""
        p = self.simulator.parameters[i]
        # at first a secant, as numbers may be far; where a fit led a tangent, which shows how two
        # numbers trade; a limit acts where it is lower
        size = CLOSE * p.sigma if self._whole else p.sigma
        steps = [step for step in dict.fromkeys((size, -size, -p.sigma))
                 if p.low < numbers[i] + step <= p.high] or [-size]
        change: Change = {}
        for step in steps:
            change = self._changed(here, numbers, i, step)
            if any(rows.any() for rows in change.values()):
                break
        return change

    def _changed(self, here: Recording, numbers: Numbers, i: int, step: float) -> Change:
        """Run it with another value of a parameter, and say what one sigma of that does."""
        moved = (*numbers[:i], numbers[i] + step, *numbers[i + 1:])
        there = self._counted(self.simulator.run(self._inputs, moved))
        return _change(here, there, self.simulator.parameters[i].sigma / step)

    def try_about(self, numbers: Numbers) -> bool:
        """Try all about a point that is far from where all were tried; say whether it was run."""
        if np.abs(self._away(self.whole(numbers), numbers)).max(initial=0.0) <= BENT:
            return False
        self.short = self.count + len(numbers) + EXTRA_RUNS > MAX_RUNS
        if not self.short:
            self.try_all(numbers)
        return not self.short

    def settle(self, numbers: Numbers) -> bool:
        """
        Run it where a fit settles, unless that was done nearby, or it was run too often.

        Parameters that are far from where they were tried are tried anew; the lines of the others
        are those of the nearest point.

        Returns
        -------
        bool
            Whether it was run.
        """
        apart = np.abs(self._away(self.near(numbers), numbers)).max(initial=0.0)
        if apart < CLOSE or self.count >= MAX_RUNS:
            return False
        here = self.exact(numbers)
        self.points.append(numbers)
        for i, lines in enumerate(self._lines):
            if abs(self._away(self.tried(numbers, i), numbers)[i]) > BENT:
                lines[numbers] = self._try(here, numbers, i)
        settled = [one for one in self.points if one not in self._whole]
        for old in settled[:-MAX_POINTS]:
            self.points.remove(old)
            del self._exact[old]
        for i, lines in enumerate(self._lines):
            for old in lines.keys() - {self.tried(one, i) for one in self.points}:
                del lines[old]
        return True

    def at(self, numbers: Numbers) -> Recording:
        """Return its result with other parameters, as far as it is linear about a point."""
        if numbers in self._exact or not self.points:
            return self.exact(numbers)
        near = self.near(numbers)
        return _moved(self._exact[near], self.changes(near), self._away(near, numbers))

    def changes(self, point: Numbers) -> list[Change]:
        """Return what one sigma of each parameter does at a point, as far as that is known."""
        return [lines[self.tried(point, i)] for i, lines in enumerate(self._lines)]

    def tried(self, point: Numbers, i: int) -> Numbers:
        """Return where a parameter was tried that is nearest to a point."""
        return self._nearest(self._lines[i], point)

    def _away(self, one: Numbers, other: Numbers) -> Array:
        return np.asarray((np.array(other) - one) / self._sigma)

    def _nearest(self, points: Iterable[Numbers], numbers: Numbers) -> Numbers:
        return min(points, key=lambda one: float(np.linalg.norm(self._away(one, numbers))))

    def integrated(self, numbers: Numbers, finer: float) -> Recording:
        """Return its result if its step made so many times what half of it does."""
        made = self.at(numbers)
        if not self._finer or not finer:
            return made
        near = self._nearest(self._finer, self.near(numbers))
        return _moved(made, [self._finer[near]], np.array([finer]))

    def near(self, numbers: Numbers) -> Numbers:
        """Return the nearest point at which it was run."""
        return self._nearest(self.points, numbers)

    def whole(self, numbers: Numbers) -> Numbers:
        """Return the nearest point at which all parameters were tried."""
        return self._nearest(self._whole, numbers)


def _arrays(made: Recording) -> list[Array]:
    assert made.wrench is not None
    assert made.pose is not None
    others = [one.values for one in (made.accelerometer, made.joints) if one is not None]
    return [made.wrench.values, made.pose.position, made.pose.R_base_sensor, *others]


def _of_one_length(here: Recording, finer: Recording) -> tuple[Recording, Recording]:
    """Let the last row represent one that a finer run lacks, whose last step may end earlier."""
    def padded_as(one: Any, like: Any) -> Any:
        rows = np.minimum(np.arange(len(like)), len(one) - 1)
        return replace(one.rows(rows), t=like.t)

    return here, replace(finer, **{
        name: padded_as(getattr(finer, name), getattr(here, name))
        for name in ('wrench', 'pose', 'accelerometer', 'joints')
        if getattr(finer, name) is not None})


def _change(here: Recording, there: Recording, scale: float) -> Change:
    """Compare two recordings; ``scale`` is that of the result."""
    one, other = here.pose, there.pose
    assert one is not None
    assert other is not None
    turn = rotation_vector(np.swapaxes(one.R_base_sensor, 1, 2) @ other.R_base_sensor)
    found = {name: scale * (getattr(there, name).values - getattr(here, name).values)
             for name in _STREAMS if getattr(here, name) and getattr(there, name)}
    return {**found, 'position': scale * (other.position - one.position), 'turn': scale * turn}


def _moved(base: Recording, changes: Sequence[Change], away: Array) -> Recording:
    """Add changes, each so many times, to a recording."""
    pose = base.pose
    assert pose is not None

    def added(name: str, start: Array) -> Array:
        return sum((x * change[name] for change, x in zip(changes, away) if name in change), start)

    streams = {name: replace(stream, values=added(name, np.array(stream.values)))
               for name in _STREAMS if (stream := getattr(base, name)) is not None}
    turn = added('turn', np.zeros_like(pose.position))
    return replace(base, **streams, pose=replace(
        pose, position=added('position', np.array(pose.position)),
        R_base_sensor=pose.R_base_sensor @ rotation_from_vector(turn)))


BENT = 1.0
"""
How far from where it was tried a parameter is tried anew where a fit settles [sigma]: beyond the
step by which it was tried, that does not show how it bends.
"""

CLOSE = 0.1
"""
How near to where it was run a line is as good as another run [sigma]: it is bent by a hundredth of
what one sigma is.
"""

MAX_POINTS = 12
"""
Points that are kept where fits settled, beside those at which all parameters were tried: each
holds a recording, and one for every parameter that went far. Those of a minute take 80 MB.
"""

MAX_RUNS = 200
"""
Runs of a simulator on one recording: 30 parameters that are tried three times take 95, and fits
that settle as many. A simulator of a second a run then takes three minutes.
"""

EXTRA_RUNS = 3
"""
Runs of each recording beside those of its parameters: as it is, once found, as proposed. With half
its step of integration, where it can be run so, it is run once more.
"""


def refuse_too_many(simulator: ThirdParty, recordings: int) -> None:
    """
    Refuse a simulator whose parameters cannot all be tried.

    Raises
    ------
    ConfigError
        With how many there may be.
    """
    n = len(simulator.parameters)
    beside = EXTRA_RUNS + simulator.has_finer
    most = (MAX_RUNS - 1) // recordings - beside
    if n > most:
        enough = recordings > 1 and n <= MAX_RUNS - 1 - beside
        alone = ', or diagnose without --heldout' if enough else ''
        raise ConfigError(
            f'{simulator.name}: {n} parameters on {recordings} recording'
            f'{"s" if recordings > 1 else ""} require more than {MAX_RUNS} runs; let '
            f'parameters() return only the {most} that are least certain{alone}')


def runs_short(runs: Sequence[Runs]) -> str:
    """Say so where all parameters could not be tried once more, else nothing."""
    if not any(one.short for one in runs):
        return ''
    done, n = sum(one.count for one in runs), len(runs[0].simulator.parameters)
    return (f'the simulator was run {done} times, so often that its {n} parameters were not '
            'linearised again at the values found, although it is not linear there: change it as '
            'proposed and diagnose again')


INTEGRATION_STEP = 'integration.step'
"""What a step of integration does wrong, in what half the step changes."""

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
    if finer:  # of an integrator of first order, as Euler, all of its error is twice 1 sigma
        found.append(Nuisance(INTEGRATION_STEP, 'finer', change('finer'), prior_std=1.0))
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

    No simulation is right above its band. That part of the wrench stays as it was in the first
    run: otherwise a parameter would be named that only reduces it.

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
        fast, slower = (wrench_of_blocks(nominal, start, n_blocks, wide * MOST)
                        for wide in (EXACT, KEPT))
        self._above_band = fast - slower
        self._carried: dict[tuple[Numbers, float, float], _Carried] = {}

    def can_show(self, effect: str, rig: Rig) -> bool:
        """Say whether an effect could be there and be seen."""
        return is_addable(self.library[effect], self.accelerated)

    def nuisances(self, rig: Rig, streams: tuple[str, ...]) -> tuple[Nuisance, ...]:
        """List the nuisance parameters: those of the simulator, tool, mounting and sensors."""
        found = nuisances_of(self.runs.simulator.parameters, len(self.joints),
                             finer=self.runs.simulator.has_finer)
        found += [one for one in OF_TOOL if f'tool_{one.key}' in self.library]
        found += of_sensors(self.accelerometer, streams)
        return tuple(n for n in found if n.prior_std or getattr(rig.spreads, n.key) > 0.0)

    def tangent(self, rig: Rig, nuisance: str) -> Hashable:
        """Return where a parameter was tried, or all were."""
        assert isinstance(rig, SimulatedRobot)
        near = self.runs.near(rig.numbers)
        names = [p.name for p in self.runs.simulator.parameters]
        return (self.runs.tried(near, names.index(nuisance)) if nuisance in names
                else self.runs.whole(near))

    def clear(self, signals: Signals) -> Signals:
        """Return signals without noise: these have none."""
        return signals

    smooth = clear

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

    def settle(self, rig: Rig, *, whole: bool = False) -> bool:
        """Run the simulator as a rig has it, unless it was; say whether it was run."""
        assert isinstance(rig, SimulatedRobot)
        ran = (self.runs.try_about if whole else self.runs.settle)(rig.numbers)
        if ran:
            self.forget()
        return ran

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
        volts = np.zeros((len(carried.t), 3))
        if accel is not None:
            tilted = carried.weight(physical_rig(rig)) - carried.weight(self._rigid_tool)
            volts = accelerometer_volts(rig, self.accelerometer, accel + tilted)
        if joints is not None:
            joints = padded(joints + rig.zeros[:len(self.joints)])
        return carried.signals(rig, carried.wire(rig), volts)._replace(
            start=self.start, position=carried.position + place,
            R_base_sensor=carried.R_base_sensor @ rotation_from_vector(turn), joints=joints)

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
                                  self.accelerometer, clear=True)
            carried.beyond = self._above_band + carried.recorded_wrench(
                made, KEPT * MOST) - carried.wire(self._rigid_tool)
            accel, joints = (None if one is None else one.at(carried.t)
                            for one in (made.accelerometer, made.joints))
            self._carried[key] = _Carried(carried, accel, joints)
        # the point that all others are compared with is requested most, and is not to go first
        found = self._carried.pop(key)
        self._carried[key] = found
        return found
