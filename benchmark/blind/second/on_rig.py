"""The second rig as a generator of the second edition."""

from collections.abc import Mapping
import copy
from typing import Any

from blind.cases import LIBRARY, OUTSIDE
from blind.effect import Effect, sensing
from blind.motion import trajectory
from blind.noise import SIGMA
from blind.rig import astray, Commands, follow, GRAVITY, nominal, NUISANCES, Rig, run, Truth
from blind.robot import Array, Motion
from blind.second.ground import Ground
from blind.second.law import Added, Moved
from blind.second.noise import draw_noise, quirks
from blind.second.numbers import changed_numbers
from blind.sensors import record, Recorded
import numpy as np
from scipy.spatial.transform import Rotation

RATES = {'wrench': 1000.0, 'volts': 1000.0, 'slide': 1000.0, 'position': 250.0, 'turn': 250.0}
SECONDS = 22.0
LOOKED_AT = ('wrench', 'volts', 'slide', 'position')
"""What energies count."""


def departure(one: Recorded, other: Recorded) -> dict[str, Array]:
    """Return how two recordings of the same stamps differ; ``turn``: by a rotation vector."""
    turn = Rotation.from_matrix(np.swapaxes(other.R, 1, 2) @ one.R).as_rotvec()
    return {**{topic: np.reshape(getattr(one, topic) - getattr(other, topic),
                                 (len(getattr(one, topic)), -1)) for topic in LOOKED_AT},
            'turn': turn}


class OnRig:
    """One case of the rig: its motions, noise and nuisances, and what effects do to it."""

    name, most, own, lacks = 'rig', 1e6, 0.0, frozenset[str]()
    effects = tuple(sorted(name for name, one in LIBRARY.items() if not one.random))
    outside = tuple(sorted(name for name, one in OUTSIDE.items() if not one.random))

    def __init__(self, seed: int, forms: Mapping[str, Effect]) -> None:
        where, how = (np.random.default_rng(one) for one in np.random.SeedSequence(seed).spawn(2))
        self._known = {**LIBRARY, **OUTSIDE, **forms}
        self._base = nominal(str(how.choice(['acc1', 'acc2'], p=[0.7, 0.3])))
        self.strays = {name: how.standard_normal(count) for name, (count, _) in NUISANCES.items()}
        self._noise = draw_noise(how, SIGMA, RATES)
        self._seeds = [int(one) for one in how.integers(2**32, size=2)]
        self._commands: list[Commands] = [
            trajectory(max(20.0, SECONDS * where.uniform(0.85, 1.15)), where) for _ in range(2)]
        self._motions: dict[tuple[int, str], Motion] = {}
        self._truths: dict[tuple[int, str], Truth] = {}
        self.clean = self._recorded(self._base, 1)
        self.ground = Ground({name: self._noise[name] for name in LOOKED_AT}, SIGMA,
                             self._columns())
        self.moved = [self._moved(which) for which in range(2)]

    @property
    def quirks(self) -> dict[str, float]:
        """What is odd about its noise."""
        return quirks(self._noise)

    @property
    def levels(self) -> dict[str, Array]:
        """Root mean square of the noise of one sample, by topic."""
        return {topic: np.array([one.colour.level for one in self._noise[topic]]) * SIGMA[topic]
                for topic in LOOKED_AT}

    @property
    def nominal_levels(self) -> dict[str, Array]:
        """Noise of one sample as one takes it to be."""
        return {topic: SIGMA[topic] for topic in LOOKED_AT}

    def knowing(self, forms: Mapping[str, Effect]) -> 'OnRig':
        """Return the same case with other forms of effects."""
        other = copy.copy(self)
        vars(other)['_known'] = {**LIBRARY, **OUTSIDE, **forms}
        return other

    def measured(self, arrays: Mapping[str, Array]) -> dict[str, Array]:
        """Return by how much the recording that judges differs from nominal."""
        return {topic: arrays[f'1.{topic}'].reshape(len(arrays[f'1.{topic}']), -1)
                - getattr(self.clean, topic).reshape(len(arrays[f'1.{topic}']), -1)
                for topic in LOOKED_AT}

    @property
    def judged_seconds(self) -> float:
        """Return the length of the recording that judges [s]."""
        return 0.004 * len(self._commands[1].position)

    def compared(self, change: dict[str, Array]) -> dict[str, Array]:
        """Return what of a change is compared: all."""
        return change

    def own_change(self) -> dict[str, Array]:
        """Return what is beside all that was drawn: nothing."""
        return {}

    def _truth(self, rig: Rig, which: int) -> Truth:
        robot = (which, f'{rig.robot}')
        if robot not in self._motions:
            self._motions[robot] = follow(rig.robot, self._commands[which])
        whole = (which, f'{rig.robot} {rig.tool} {rig.wall}')
        if whole not in self._truths:
            if len(self._truths) > 4:  # a run is 40 MB
                self._truths.pop(next(one for one in list(self._truths)[2:]))
            self._truths[whole] = run(rig, self._commands[which], self._motions[robot])
        return self._truths[whole]

    def _recorded(self, rig: Rig, which: int, noise: Any = None) -> Recorded:
        return record(rig, self._truth(rig, which), noise, self._seeds[which])

    def _columns(self) -> list[tuple[str, dict[str, Array]]]:
        found = []
        for name, (count, _) in NUISANCES.items():
            for one in np.eye(count):
                rig = astray(self._base, {name: one})
                found.append((name, departure(self._recorded(rig, 1), self.clean)))
        return found

    def _moved(self, which: int) -> Moved:
        truth, tool = self._truth(self._base, which), self._base.tool
        m = truth.motion
        force = np.einsum('nji,nj->ni', m.R, m.acceleration - np.array([0.0, 0.0, -GRAVITY]))
        return Moved(truth.t, m.R, m.position, m.velocity, m.acceleration, m.omega, m.alpha, force,
                     truth.felt.wrench, truth.felt.contact, tool.mass, tool.com, which)

    def nuisance(self, name: str) -> tuple[str, float]:
        """Return the nuisance of an effect's name and its sigma; nothing where it has none."""
        key = self._known[name].nuisance
        return key, (NUISANCES[key][1] if key else 0.0)

    def start(self, name: str) -> tuple[float, float]:
        """Return a usual and the largest size of an effect."""
        one = self._known[name]
        return float(np.sqrt(one.low * one.high)), 1.5 * one.high

    def stage(self, name: str) -> str:
        """Return where an effect sits."""
        return self._known[name].stage

    def of_effect(self, name: str, size: float, seed: int) -> dict[str, Array]:
        """Return what an effect changes in the recording that judges."""
        rig = self._known[name].apply(self._base, size, np.random.default_rng(seed))
        return departure(self._recorded(rig, 1), self.clean)

    def of_law(self, what: Added) -> dict[str, Array]:
        """Return what a discrepancy changes in the recording that judges."""
        rig = _beside(self._base, what)
        return departure(self._recorded(rig, 1), self.clean)

    def numbers(self, name: str, size: float, seed: int) -> dict[str, float]:
        """Return the numbers of an effect as the library calls them."""
        rig = self._known[name].apply(self._base, size, np.random.default_rng(seed))
        return changed_numbers(name, size, self._base, rig)

    def recordings(self, effect: tuple[str, float, int] | None, laws: list[Added],
                   onset: float | None) -> dict[str, Array]:
        """Record it: an effect (name, size, seed) from ``onset`` of the first on, and laws."""
        strays = dict(self.strays)
        key = self.nuisance(effect[0])[0] if effect else ''
        if key:
            strays[key] = strays[key] * 0.0
        pair = []
        for which in range(2):
            rig = _beside(astray(self._base, strays), laws[which])
            without, here = rig, onset if which == 0 else None
            if effect:
                rig = self._known[effect[0]].apply(rig, effect[1],
                                                   np.random.default_rng(effect[2]))
            one = self._recorded(rig, which, self._noise)
            if here is not None:
                one = _joined(self._recorded(without, which, self._noise), one, here)
            pair.append(one)
        return {f'{i}.{key}': np.asarray(value) for i, one in enumerate(pair)
                for key, value in one._asdict().items() if key != 'phases'} | {
                f'{i}.phases': np.array([f'{name} {start!r} {end!r}' for name, start, end
                                         in one.phases]) for i, one in enumerate(pair)}

    def duration(self) -> float:
        """Return the length of the first recording [s]."""
        return 0.004 * len(self._commands[0].position)


def _beside(rig: Rig, what: Added) -> Rig:
    """Let a discrepancy add to what the sensors feel."""
    return sensing(
        rig, wrench=lambda truth, u, _: u + what.wrench,
        specific=lambda truth, f, _: f + what.accel,
        pose=lambda truth, pose, _: (pose[0] + what.position, pose[1]))


def _joined(before: Recorded, after: Recorded, at: float) -> Recorded:
    """Return one recording up to an instant and another from then on; stamps are the same."""
    def of(topic: str) -> Array:
        late = getattr(after, f'{topic}_t') >= at
        old, new = getattr(before, topic), getattr(after, topic)
        return np.asarray(np.where(late.reshape(-1, *[1] * (new.ndim - 1)), new, old))

    return after._replace(wrench=of('wrench'), volts=of('volts'), slide=of('slide'))
