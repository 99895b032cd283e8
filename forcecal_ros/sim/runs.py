"""
A third-party simulator under one recording's commands, run with as few sets of numbers as will do.

Running it is expensive. So its streams are linear in the parameters about the nearest point where
all of them were tried, one after the other; where it was run itself, its own answer is used. A
diagnosis runs it a limited number of times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.sim.measured_motion import express_in_base
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np

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
    """

    def __init__(self, simulator: ThirdParty, inputs: Inputs, measured: PoseStream) -> None:
        self.simulator, self.count = simulator, 0
        self._inputs, self._measured = inputs, measured
        self._exact: dict[Numbers, Recording] = {}
        self._changes: dict[Numbers, list[Change]] = {}
        self._halved: dict[Numbers, Recording] = {}
        self._finer: dict[Numbers, Change] = {}

    def exact(self, numbers: Numbers) -> Recording:
        """Run the simulator, unless it was run so before."""
        if numbers not in self._exact:
            self._exact[numbers] = self._counted(self.simulator.run(self._inputs, numbers))
        return self._exact[numbers]

    def _counted(self, made: Recording) -> Recording:
        """Count a run, and bring its poses into the robot's base."""
        self.count += 1
        assert made.pose is not None
        return replace(made, pose=express_in_base(self._measured, made.pose))

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
            step = p.sigma  # small enough for a straight line, large enough to be seen
            if numbers[i] + step > p.high:
                step = -step
            change = self._changed(here, numbers, i, step)
            nothing = not any(rows.any() for rows in change.values())
            if nothing and numbers[i] - step > p.low:  # a limit acts where it is lower
                change = self._changed(here, numbers, i, -step)
            changes.append(change)
        self._changes[numbers] = changes
        if self.simulator.has_finer:
            self._finer[numbers] = _change(*_of_one_length(here, self.halved(numbers)), 1.0)

    def halved(self, numbers: Numbers) -> Recording:
        """Run it with half its step of integration, unless that was done before."""
        if numbers not in self._halved:
            self._halved[numbers] = self._counted(self.simulator.run_finer(self._inputs, numbers))
        return self._halved[numbers]

    def changes(self, numbers: Numbers) -> Sequence[Change]:
        """Return what one sigma of each parameter does at a point that was tried."""
        return self._changes[numbers]

    def _changed(self, here: Recording, numbers: Numbers, i: int, step: float) -> Change:
        """Run it with another value of a parameter, and say what one sigma of that does."""
        moved = (*numbers[:i], numbers[i] + step, *numbers[i + 1:])
        return _change(here, self._passing(moved), self.simulator.parameters[i].sigma / step)

    def _passing(self, numbers: Numbers) -> Recording:
        made = self.exact(numbers)
        del self._exact[numbers]
        return made

    def at(self, numbers: Numbers) -> Recording:
        """Return its result with other parameters, as far as that is linear in them."""
        if numbers in self._exact or not self._changes:
            return self.exact(numbers)
        near = self.near(numbers)
        away = (np.array(numbers) - near) / self._sigma
        return _moved(self._exact[near], self._changes[near], away)

    def integrated(self, numbers: Numbers, finer: float) -> Recording:
        """Return its result if its step made so many times what half of it does."""
        made = self.at(numbers)
        if not self._finer or not finer:
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


def refuse_unsteady(runs: Runs) -> None:
    """Refuse a simulator that does something else the second time."""
    if not runs.repeats():
        raise ConfigError(f'{runs.simulator.name}: the same commands and parameters gave another '
                          'answer the second time; seed its noise, and begin '
                          'each run from the same state')


MAX_RUNS = 150
"""
Runs of a simulator in one diagnosis: two recordings with 30 parameters that are tried twice take
129, and a simulator of a second a run then takes two minutes.
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
            f'{simulator.name}: to try its {n} parameters on {recordings} recording'
            f'{"s" if recordings > 1 else ""} it would be run more than {MAX_RUNS} times; let '
            f'parameters() list at most {most}, those that are least certain{alone}')


def runs_short(simulator: ThirdParty, runs: Sequence[Runs]) -> str:
    """Say so where all parameters cannot be tried once more, else nothing."""
    done, n = sum(one.count for one in runs), len(simulator.parameters)
    each = n + EXTRA_RUNS + simulator.has_finer - 1
    if done + len(runs) * each <= MAX_RUNS:
        return ''
    return (f'the simulator was run {done} times, of at most {MAX_RUNS}, so its {n} parameters '
            'were not tried again at the numbers found, where its signals are not those of a '
            'straight line: change it as proposed and diagnose again')
