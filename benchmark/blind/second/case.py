"""One case of the second edition: what is drawn for it, its recordings and its label."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, NamedTuple

from blind.robot import Array
from blind.second.ground import Departure, sized
from blind.second.law import Added, Kind
from blind.second.rules import DEVELOPMENT, half, Rules, rules_of
from blind.second.shrink import squares, true_shrink
import numpy as np

BACKGROUND, RATIO, ALONE = (30.0, 1e6), (0.3, 100.0), (20.0, 5000.0)
"""Energies of a background, of an effect in that of its background, of one without."""
CERTAIN, SURELY = 2.5, 3.5
"""Sigmas from and up to which an effect of a nuisance's name is ambiguous."""
DRAWS, LEFT, ALIKE = 12, 0.05, 0.05
"""How often a law is drawn at most; the share of its energy that nuisances leave, and of its peak
in the first recording that it has in the other, from which it is sound."""
ARM = 0.2
"""Lever at which a sensor's torques are as large as its forces [m]."""
NONE, OUTSIDE, LIBRARY = 'none', 'outside', 'library'
WITHOUT_EFFECT, LACKED = 0.27, 0.16
"""Shares of the cases."""
NAMES = {'mass': 'tool_mass', 'com': 'tool_com', 'stiffness': 'tool_stiffness',
         'damping': 'tool_damping', 'wall_stiffness': 'contact_stiffness',
         'wall_damping': 'contact_damping', 'wall_place': 'wall_position',
         'wrench_gain': 'wrench_gain', 'accel_gain': 'accel_gain', 'accel_offset': 'accel_bias',
         'tilt': 'base_tilt', 'friction': 'joint_friction', 'kp': 'joint_gain',
         'kv': 'joint_damping'}
"""Nuisance -> the effect of its name."""


class Plan(NamedTuple):
    """
    What is wanted of a case.

    Attributes
    ----------
    generator : str
        ``rig``, ``arm``, ``real`` or ``drake``.
    kind : str
        ``none``, ``outside`` or ``library``.
    effect : str
        Of the library or outside it; empty where there is none.
    half : str
    seed : int
    """

    generator: str
    kind: str
    effect: str
    half: str
    seed: int


def plans(generator: str, effects: Sequence[str], count: int, name: str, master: str
          ) -> list[Plan]:
    """Return the cases of a generator: kinds in their shares, effects in turn, in any order."""
    rng = np.random.default_rng(seed_of(master, f'{generator}/plan'))
    none, outside = round(WITHOUT_EFFECT * count), round(LACKED * count)
    turns = rng.permutation(list(effects)).tolist()
    wanted = [(NONE, '')] * none + [(OUTSIDE, '')] * outside
    wanted += [(LIBRARY, turns[i % len(turns)]) for i in range(count - none - outside)]
    return [Plan(generator, wanted[k][0], wanted[k][1], name,
                 seed_of(master, f'{generator}/{i}'))
            for i, k in enumerate(rng.permutation(count))]


def seed_of(master: str, of: str) -> int:
    """Return a seed that nobody knows who does not know the master."""
    return int.from_bytes(sha256(f'{master}/{of}'.encode()).digest()[:8], 'big')


class Made(NamedTuple):
    """The recordings of a case as arrays, and its label."""

    arrays: dict[str, Array]
    label: dict[str, Any]


class _Drawn(NamedTuple):
    """Wanted energies: of each background kind, and of the effect by its background's sum."""

    background: dict[str, float]
    ratio: float
    alone: float
    bare: bool
    begun: float


def _drawn(rng: np.random.Generator, names: Sequence[str], base: Any, rules: Rules) -> _Drawn:
    chosen = rng.permutation(list(names))[:rng.integers(3, 7)].tolist()
    low, high = np.log(BACKGROUND[0]), np.log(min(base.most, BACKGROUND[1]))
    energies = np.exp(rng.uniform(low, high, len(chosen)))
    bare = bool(rng.random() < rules.bare[base.name])
    begun = float(rng.uniform(0.35, 0.65)) if rng.random() < rules.begun else 0.0
    return _Drawn({} if bare else dict(zip(chosen, map(float, energies))),
                  float(np.exp(rng.uniform(*np.log(RATIO)))),
                  float(np.exp(rng.uniform(*np.log(ALONE)))), bare, begun)


def make(plan: Plan, generator: Any) -> Made:
    """
    Make a case.

    Parameters
    ----------
    plan : Plan
    generator : callable
        (seed, forms of effects) -> what makes recordings; see ``on_rig``.
    """
    kinds, forms = half(plan.half)
    rules = rules_of(plan.half)
    what, how = (np.random.default_rng(one) for one in np.random.SeedSequence(plan.seed).spawn(2))
    base = generator(plan.seed, forms)
    known = sorted(name for name, kind in kinds.items() if not kind.wants & base.lacks)
    drawn = _drawn(what, known, base, rules)
    effect = _effect(plan, drawn, base, known, what)
    laws = {name: _law(base, kinds[name], how, rules)
            for name in (*drawn.background, *([effect] if effect in kinds else []))}
    onset = _onset(plan, drawn, base, effect)
    part, background = _sized(base, rules, drawn, effect, laws, onset, how)
    beside = {name: np.sqrt(energy / laws[name].energy) for name, energy in background.items()}
    scales = {**beside, **({effect: part['size']} if effect in kinds else {})}
    both = [_sum([laws[name].both[i].times(scale) for name, scale in scales.items()], moved)
            for i, moved in enumerate(base.moved)]
    given = (effect, part['size'], part['seed']) if part and effect not in kinds else None
    label = _label(plan, base, kinds, part, background, onset, drawn.bare, rules)
    if rules.mended and plan.kind == LIBRARY:
        label['aliases'] = list(rules.touchless.get(effect, ()) if 'contact' in base.lacks else ())
        label['shrink'] = _shrink(base, part, both[-1], onset, rules)
    return Made(base.recordings(given, both, onset), label)


def _effect(plan: Plan, drawn: _Drawn, base: Any, known: Sequence[str],
            rng: np.random.Generator) -> str:
    """Return the effect of a plan; draw one where it is outside the library."""
    if plan.kind != OUTSIDE:
        return plan.effect
    left = [name for name in known if name not in drawn.background]
    seen = base.outside if plan.half == DEVELOPMENT else ()
    return str(rng.choice([*left, *seen]))


def _onset(plan: Plan, drawn: _Drawn, base: Any, effect: str) -> float | None:
    """Return when the effect begins in the first recording [s], where it does half-way."""
    if plan.kind == LIBRARY and drawn.begun and base.stage(effect) in (
            'wrench_sensor', 'accelerometer'):
        return float(drawn.begun * base.duration())
    return None


def _late(base: Any, changed: Departure, onset: float | None) -> Departure:
    """Return a change from its begin on, where one recording is both fitted and judged."""
    if onset is None or len(base.moved) > 1:
        return changed
    there = base.moved[0].t[:, None] >= onset
    return {topic: np.where(there, values, 0.0) for topic, values in changed.items()}


def _shrink(base: Any, part: Mapping[str, Any], beside: Added, onset: float | None,
            rules: Rules) -> float | dict[str, list[float]]:
    """Return the share of the misfit that the effect makes, as the tool measures it."""
    changed = _late(base, base.of_effect(part['name'], part['size'], part['seed']), onset)
    laws, own = base.of_law(beside), base.own_change()
    if rules.sound:
        changed, laws = base.compared(changed), base.compared(laws)
    beside_it = {topic: values + own[topic] if topic in own else values
                 for topic, values in laws.items()}
    measure = squares if rules.sound else true_shrink
    return measure(base, changed, beside_it, base.nuisance(part['name'])[0])


class _Law(NamedTuple):
    """What a law adds to each recording, its energy at that size, and the most it may have."""

    both: list[Added]
    energy: float
    most: float


def _law(base: Any, kind: Kind, rng: np.random.Generator, rules: Rules) -> _Law:
    """
    Draw a law.

    A sound one is not an offset or a gain in disguise, which as large as wanted would be larger
    than any sensor reads, and is about as large in one recording as in the other.
    """
    best, how_sound = None, -1.0
    for _ in range(DRAWS if rules.sound else 1):
        law = kind.draw(rng)
        both = [law(moved) for moved in base.moved]
        # scaled to about the noise first, so that no sum of squares overflows
        size = 1e-3 / max(1e-12, float(np.abs(both[-1].wrench).max()
                                       + np.abs(both[-1].accel).max()))
        both = [one.times(size) for one in both]
        departure = base.of_law(both[-1])
        energy = max(1e-12, base.ground.net(departure))
        if not rules.sound:
            return _Law(both, energy, np.inf)
        whole = base.ground.whitened(departure)
        peaks = [_peak(one, moved) for one, moved in zip(both, base.moved)]
        sound = min(energy / max(1e-12, float(whole @ whole)) / LEFT,
                    peaks[-1] / max(1e-12, peaks[0]) / ALIKE)
        if sound > how_sound:
            best, how_sound = _Law(both, energy, energy / max(1e-12, *peaks)**2), sound
        if sound > 1.0:
            break
    assert best is not None
    return best


def _peak(one: Added, moved: Any) -> float:
    """Return the largest change in what a sensor carries: a load and a half, as much as weight."""
    carried = 1.5 * float(moved.load)
    return max(float(np.abs(one.wrench[:, :3]).max()) / carried,
               float(np.abs(one.wrench[:, 3:]).max()) / (ARM * carried),
               float(np.abs(one.accel).max()) / 9.81,
               float(np.abs(one.position).max()) / 0.1)


def _sum(parts: Sequence[Added], moved: Any) -> Added:
    zero = np.zeros((len(moved.t), 3))
    total = Added(np.hstack([zero, zero]), zero, zero)
    for one in parts:
        total = total.plus(one)
    return total


def _sized(base: Any, rules: Rules, drawn: _Drawn, effect: str,
           laws: Mapping[str, _Law], onset: float | None,
           rng: np.random.Generator) -> tuple[dict[str, Any], dict[str, float]]:
    """Size the effect; where it cannot be as large as wanted, its background shrinks."""
    background = {name: min(energy, laws[name].most) for name, energy in drawn.background.items()
                  if laws[name].most >= BACKGROUND[0]}
    total = sum(background.values()) + base.own
    if not effect:
        return {}, background
    alone = drawn.bare and base.own < drawn.alone
    wanted = drawn.alone if alone else drawn.ratio * total
    seed = int(rng.integers(2**32))
    if effect in laws:
        energy = min(wanted, laws[effect].most)
        size = float(np.sqrt(energy / laws[effect].energy))
    else:
        size, energy = _size(base, effect, wanted, seed, rules, onset)
        least = RATIO[0] * (len(background) * BACKGROUND[0] + base.own)
        for other in rng.integers(2**32, size=DRAWS if rules.sound else 0).tolist():
            if energy >= least:
                break  # else of axes that the motion does not load
            seed = int(other)
            size, energy = _size(base, effect, wanted, seed, rules, onset)
    if background and energy < 0.8 * wanted:
        shrink = max(0.0, energy / drawn.ratio - base.own) / sum(background.values())
        background = {name: max(BACKGROUND[0], shrink * one) for name, one in background.items()}
    return {'name': effect, 'size': size, 'seed': seed, 'energy': energy}, background


def _size(base: Any, effect: str, wanted: float, seed: int, rules: Rules,
          onset: float | None = None) -> tuple[float, float]:
    """Return size and energy; of a nuisance's name, beyond 2.5 of its sigma."""
    key, sigma = base.nuisance(effect)
    usual, largest = base.start(effect)
    least = CERTAIN * sigma
    largest = min(largest, rules.limits.get((base.name, effect), np.inf) - least)
    rest = base.of_effect(effect, least, seed) if least else None

    def energy_of(size: float) -> float:
        changed = base.of_effect(effect, least + size, seed)
        if rest:
            changed = {topic: values - rest[topic] for topic, values in changed.items()}
        if rules.mended:
            changed = _late(base, changed, onset)
        return float(base.ground.net(changed, key))

    size, energy = sized(energy_of, wanted, usual, largest)
    return least + size, energy


def _label(plan: Plan, base: Any, kinds: Mapping[str, Kind], part: dict[str, Any],
           background: dict[str, float], onset: float | None, bare: bool, rules: Rules
           ) -> dict[str, Any]:
    total = sum(background.values()) + base.own
    excused = {name for kind in (*background, *([part['name']] if part else []))
               if kind in kinds for name in kinds[kind].alias}
    if rules.sound and 'contact' in base.lacks:
        excused.update(*(rules.touchless.get(name, ()) for name in tuple(excused)))
    if onset is not None:  # a gain that sets in is a step of a constant load
        excused.add('wrench_bias_step')
    doubtful = sorted(NAMES[key] for key, z in base.strays.items()
                      if key in NAMES and np.abs(z).max() > CERTAIN)
    label: dict[str, Any] = {
        **plan._asdict(), 'background': background, 'own': base.own, 'bare': bare,
        'quirks': dict(base.quirks), 'excused': sorted(excused), 'doubtful': doubtful,
        'energy': 0.0, 'ratio': 0.0, 'onset': onset, 'ambiguous': False, 'numbers': {}}
    if not part:
        return label
    if plan.kind == LIBRARY:
        sigma = base.nuisance(part['name'])[1]
        label['ambiguous'] = bool(sigma) and part['size'] < SURELY * sigma
        label['numbers'] = base.numbers(part['name'], part['size'], part['seed'])
        label['stage'] = base.stage(part['name'])
    return {**label, 'effect': part['name'], 'size': part['size'], 'energy': part['energy'],
            'part_seed': part['seed'], 'ratio': part['energy'] / total if total else None}
