"""Blind cases: what is wrong with a rig, drawn from a seed, and two recordings of it."""

from collections.abc import Mapping
from hashlib import sha256
import math
from typing import Any, NamedTuple

from blind import effects_physics, effects_sensing, outside
from blind.effect import Effect
from blind.motion import lazy, trajectory
from blind.noise import Colour, draw_colours
from blind.rig import astray, Commands, draw_nuisances, follow, nominal, Rig, run, Truth
from blind.robot import Motion
from blind.sensors import record, Recorded
import numpy as np

LIBRARY: Mapping[str, Effect] = {
    one.name: one for one in (*effects_physics.EFFECTS, *effects_sensing.EFFECTS)}
OUTSIDE: Mapping[str, Effect] = {one.name: one for one in outside.EFFECTS}
KINDS = ('single', 'pair', 'none', 'outside', 'lazy')
MIX = (0.45, 0.15, 0.20, 0.15, 0.05)


class Part(NamedTuple):
    """One effect of a case: its name, size, and the seed of what else is drawn."""

    name: str
    size: float
    seed: int

    @property
    def effect(self) -> Effect:
        """What it is."""
        return LIBRARY[self.name] if self.name in LIBRARY else OUTSIDE[self.name]


class Case(NamedTuple):
    """
    All that makes a case.

    Attributes
    ----------
    kind : str
        One of :data:`KINDS`.
    parts : tuple of Part
        None, one or two.
    accelerometer : str
    nuisances : dict
        By how many sigma each strays.
    colours : dict
        Of the noise.
    commands : tuple of Commands
        To fit on, to judge on.
    seeds : tuple of int
        Of the two recordings' randomness.
    """

    kind: str
    parts: tuple[Part, ...]
    accelerometer: str
    nuisances: dict[str, Any]
    colours: dict[str, list[Colour]]
    commands: tuple[Commands, Commands]
    seeds: tuple[int, int]


def seed_of(master: str, index: int) -> int:
    """Return the seed of a case: nobody knows it who does not know the master."""
    return int.from_bytes(sha256(f'{master}/{index}'.encode()).digest()[:8], 'big')


def kinds(count: int, none: int | None = None) -> list[str]:
    """Return the kinds of ``count`` cases in the mix, with ``none`` of them without effect."""
    shares = dict(zip(KINDS, MIX))
    if none is not None:
        others = 1 - shares['none']
        shares = {kind: share / others * (1 - none / count) for kind, share in shares.items()}
        shares['none'] = none / count
    counts = {kind: int(share * count + 1e-9) for kind, share in shares.items()}
    order = sorted(KINDS, key=lambda kind: counts[kind] - shares[kind] * count)
    for kind in order[:count - sum(counts.values())]:
        counts[kind] += 1
    return [kind for kind in KINDS for _ in range(counts[kind])]


def _part(effect: Effect, rng: np.random.Generator, share: float) -> Part:
    low, high = math.log(effect.low), math.log(effect.high)
    return Part(effect.name, float(np.exp(low + share * (high - low))),
                int(rng.integers(2**32)))


def draw(kind: str, seed: int, seconds: float, name: str | None = None,
         share: float | None = None) -> Case:
    """
    Draw a case.

    Parameters
    ----------
    kind : str
        One of :data:`KINDS`.
    seed : int
    seconds : float
        About how long its recordings are; each is 15 % longer or shorter.
    name : str, optional
        Of its effect, where that is to be this one.
    share : float, optional
        Where in its range the size lies, from 0 to 1 in its logarithm.

    Returns
    -------
    Case
    """
    what, where, how = (np.random.default_rng(one)
                        for one in np.random.SeedSequence(seed).spawn(3))
    pool = OUTSIDE if kind == 'outside' else LIBRARY
    count = {'none': 0, 'pair': 2, 'lazy': int(what.random() < 0.5)}.get(kind, 1)
    names = list(what.choice(sorted(pool), count, replace=False))
    if name is not None and count:
        names[0] = name
    # a pair is of two that can be seen
    lowest = 0.4 if kind == 'pair' else 0.0
    parts = tuple(_part({**LIBRARY, **OUTSIDE}[one], what,
                        what.uniform(lowest, 1.0) if share is None else share)
                  for one in names)
    nuisances = draw_nuisances(how)
    for part in parts:
        if part.effect.nuisance:
            nuisances[part.effect.nuisance] = nuisances[part.effect.nuisance] * 0.0
    make = lazy if kind == 'lazy' else trajectory
    lengths = seconds * where.uniform(0.85, 1.15, 2)
    commands = (make(max(20.0, lengths[0]), where), make(max(20.0, lengths[1]), where))
    return Case(kind, parts, str(how.choice(['acc1', 'acc2'], p=[0.7, 0.3])), nuisances,
                draw_colours(how), commands,
                (int(how.integers(2**32)), int(how.integers(2**32))))


def rig_of(case: Case, parts: tuple[Part, ...] | None = None) -> Rig:
    """Return the rig of a case, with other effects where they are given."""
    rig = astray(nominal(case.accelerometer), case.nuisances)
    for part in case.parts if parts is None else parts:
        rig = part.effect.apply(rig, part.size, np.random.default_rng(part.seed))
    return rig


class Runner:
    """Recordings of one case, with and without its effects; no motion is integrated twice."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self._motions: dict[str, Motion] = {}
        self._runs: dict[str, Truth] = {}

    def _run(self, rig: Rig, which: int) -> Truth:
        commands, key = self._case.commands[which], f'{which} {rig.robot}'
        if key not in self._motions:
            self._motions[key] = follow(rig.robot, commands)
        whole = f'{key} {rig.tool} {rig.wall}'
        if whole not in self._runs:
            self._runs[whole] = run(rig, commands, self._motions[key])
        return self._runs[whole]

    def recording(self, which: int, parts: tuple[Part, ...] | None = None, noise: bool = True
                  ) -> Recorded:
        """Return one recording: 0 to fit on, 1 to judge on."""
        rig = rig_of(self._case, parts)
        return record(rig, self._run(rig, which), self._case.colours if noise else None,
                      self._case.seeds[which])

    def recordings(self, parts: tuple[Part, ...] | None = None, noise: bool = True
                   ) -> tuple[Recorded, Recorded]:
        """Return both; ``parts``: the effects, those of the case if not given."""
        return self.recording(0, parts, noise), self.recording(1, parts, noise)


def recordings(case: Case, parts: tuple[Part, ...] | None = None, noise: bool = True
               ) -> tuple[Recorded, Recorded]:
    """Return what a case records: to fit on, to judge on."""
    return Runner(case).recordings(parts, noise)
