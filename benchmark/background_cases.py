"""Pairs of recordings that depart from their model by an effect and by what no library has.

A case is a dictionary of what was drawn; :func:`make` turns it into recordings and the truth.
Energies are those of :mod:`background_energy`. The motion that a background depends on is that of
the nominal rig, of which the true one hardly differs. Backgrounds are added to the signals before
the noise, and before what saturates.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

from background_energy import (
    additions,
    clean_recording,
    Ground,
    motion_of,
    noise_of,
    Rates,
    sampled,
)
import background_kinds
from background_kinds import KINDS
import background_kuka
from background_motion import trajectory
from background_sizes import LATE, shape_of, sized, Sizes
from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.effects import applicable, EFFECTS, with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
from signal_effects import apply_signal_effects

BACKGROUND = (30.0, 1e6)
"""Energy of each discrepancy, the higher one of half a minute of 1 kHz: less for fewer samples."""

SHORTER = 0.15
"""Samples of the real arm, in those."""

RATIO = (0.3, 100.0)
"""Energy of the effect, in that of all discrepancies together."""

FORMS = 5
"""Of an effect that are tried."""

WITHOUT_ENERGY = ('clock_skew', 'dropouts', 'wrench_quantisation')
"""Effects of stamps and values, which no energy of the mean can size."""

BASES = ('rig', 'rigid', 'kuka')

RIGID_RATES = (500, 200, 125)
"""Of all streams of a rigid tool [Hz]."""

WITH_COMMANDS = 0.6
"""Share of the rigid cases whose commands are known."""


class Truth(NamedTuple):
    """
    What a case holds.

    Attributes
    ----------
    effects : dict of str to dict of str to float
    energies : dict of str to float
        Of each effect, net of the nuisances.
    background : dict of str to float
        The same of each discrepancy.
    ratio : float
        Least energy of an effect over that of all discrepancies; 0 without effect.
    aliases : frozenset of str
        Effects that a discrepancy resembles: to name them is not false.
    """

    effects: dict[str, dict[str, float]]
    energies: dict[str, float]
    background: dict[str, float]
    ratio: float
    aliases: frozenset[str]


@lru_cache(maxsize=2)
def rig_of(base: str) -> Rig:
    """Return the rig of a base: the paper's, or one with a small tool bolted on."""
    if base != 'rigid':
        return load_rig()
    rig = load_rig('rigid_tool.yaml')
    inertia = ((0.004, 0.0, 0.0), (0.0, 0.005, 0.0), (0.0, 0.0, 0.002))
    return replace(rig, tool=replace(rig.tool, mass=1.2, com=(0.012, -0.006, 0.07),
                                     inertia=inertia))


def _rates(case: Mapping[str, Any]) -> Rates:
    return Rates(*[1000 // case['rate']] * 4) if 'rate' in case else Rates()


def possible(case: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the effects that a case can have."""
    if case['base'] == 'kuka':
        return background_kuka.EFFECTS_ON_IT
    rig = rig_of(case['base'])
    names = [n for n, e in EFFECTS.items() if applicable(e, rig) and n not in WITHOUT_ENERGY]
    if not case.get('commands', True):
        names = [n for n in names if n == 'base_tilt'
                 or EFFECTS[n].stage not in ('robot', 'environment')]
    return tuple(names)


def kinds_for(case: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the kinds of discrepancy of a case's half that its recordings can show."""
    missing = {'kuka': {'contact', 'position', 'accel'}}.get(
        case['base'], set() if case.get('commands', True) else {'contact'})
    return tuple(k for k in background_kinds.half(case['half'])
                 if not missing & set(KINDS[k].wants))


def ground_of(base: str, seed: int) -> Ground:
    """Return the nominal rig of a base on one motion, all streams at 250 Hz."""
    rig = sampled(rig_of(base))
    target, _ = trajectory(np.random.default_rng(seed))
    clean = clean_recording(rig, target)
    return Ground(rig, target, clean, motion_of(rig, clean, 1), Rates(4, 4, 4, 4))


def drawn(rig: Rig, rng: np.random.Generator, still: frozenset[str]) -> Rig:
    """
    Draw a rig's numbers from its spreads.

    Parameters
    ----------
    rig : Rig
    rng : numpy.random.Generator
    still : frozenset of str
        Keys of the spreads that are left alone.
    """
    s, name = rig.spreads, rig.accelerometer.mounted

    def off(key: str, n: int, size: float | None = None) -> Array:
        spread = getattr(s, key) if size is None else size
        return np.clip(rng.standard_normal(n), -2.9, 2.9) * spread * (key not in still)

    def scaled(part: Any, **keys: str) -> Any:
        return part and replace(part, **{field: getattr(part, field) * (1.0 + off(key, 1)[0])
                                         for field, key in keys.items()})

    tool, sensor, model = rig.tool, rig.wrench_sensor, rig.accelerometer.model()
    inertia = np.array(tool.inertia) * (1.0 + np.diag(off('inertia', 3)))
    tool = replace(scaled(tool, mass='mass'), com=tuple(tool.com + off('com', 3)),
                   inertia=tuple(map(tuple, inertia.tolist())))
    bias = np.concatenate([off('force_bias', 3), off('torque_bias', 3)])
    sensor = replace(sensor, bias=tuple(sensor.bias + bias),
                     gain=tuple(sensor.gain * (1.0 + off('wrench_gain', 6))))
    model = replace(model, gain=tuple(model.gain * (1.0 + off('accelerometer_gain', 3))),
                    offset=tuple(model.offset + off('accelerometer_offset', 3)))
    wall = scaled(rig.wall, stiffness='wall_stiffness', damping='wall_damping')
    wall = replace(wall, position=wall.position + off('wall_position', 1)[0])
    return replace(
        rig, tool=tool, wrench_sensor=sensor, wall=wall,
        accelerometer=replace(rig.accelerometer, **{name: model}),
        optidrive=scaled(rig.optidrive, stiffness='stiffness', damping='damping'))


def plan(n: int, name: str, half: str, seed: int) -> list[dict[str, Any]]:
    """
    Draw cases.

    Parameters
    ----------
    n : int
    name : str
        Of the base.
    half : str
        ``development`` or ``withheld``.
    seed : int

    Returns
    -------
    list of dict
        What :func:`make` takes, and JSON can hold.
    """
    return [_drawn_case(number, name, half, seed) for number in range(n)]


def _drawn_case(number: int, name: str, half: str, seed: int) -> dict[str, Any]:
    key = [seed, background_kinds.HALVES.index(half), BASES.index(name)]
    rng = np.random.default_rng([*key, number])
    case: dict[str, Any] = {'base': name, 'half': half, 'seed': seed, 'number': number}
    if name == 'rigid':
        case |= {'rate': int(rng.choice(RIGID_RATES)),
                 'commands': bool(rng.random() < WITH_COMMANDS)}
    chosen = rng.permutation(kinds_for(case))[:rng.integers(3, 7)].tolist()
    samples = SHORTER if name == 'kuka' else case.get('rate', 1000) / 1000.0
    low, high = np.log(BACKGROUND) + np.log([1.0, samples])
    energies = [round(float(x), 1) for x in np.exp(rng.uniform(low, high, len(chosen)))]
    names = possible(case)
    turns = np.random.default_rng(key).permutation(names)
    effects = [] if number % 6 == 5 else [str(turns[(number - number // 6) % len(turns)])]
    if number % 8 == 3 and effects:
        effects.append(str(rng.choice([n for n in names if n not in effects])))
    ratio = float(np.exp(rng.uniform(*np.log(RATIO)))) if effects else 0.0
    return case | {'effects': effects, 'kinds': dict(zip(chosen, energies)),
                   'ratio': round(ratio, 3)}


def make(case: Mapping[str, Any]) -> tuple[Recording, Recording | None, Any, Truth]:
    """
    Make the recordings of a case.

    Parameters
    ----------
    case : mapping
        Of :func:`plan`.

    Returns
    -------
    first, second : Recording
        To fit on, and to judge on; of the real arm there is one only.
    rig : Rig or Calibration
        To compare with; recordings without commands are compared by their measured motion.
    truth : Truth
    """
    key = [case['seed'], case['number'], background_kinds.HALVES.index(case['half']),
           BASES.index(case['base'])]
    generators = [np.random.default_rng(s) for s in np.random.SeedSequence(key).spawn(5)]
    build = _on_the_arm if case['base'] == 'kuka' else _simulated
    recordings, compared, parts = build(case, *generators)
    effects, energies, background = parts
    total = sum(background.values())
    aliases = frozenset(a for k in background for a in KINDS[k].alias)
    ratio = min(energies.values()) / total if energies else 0.0
    return (*recordings, compared, Truth(effects, energies, background, ratio, aliases))


Parts = tuple[dict[str, dict[str, float]], dict[str, float], dict[str, float]]
Built = tuple[tuple[Recording, Recording | None], Any, Parts]


def _simulated(case: Mapping[str, Any], of_motion: np.random.Generator,
               of_rig: np.random.Generator, of_kinds: np.random.Generator,
               of_effects: np.random.Generator, of_noise: np.random.Generator) -> Built:
    rig, rates, commands = rig_of(case['base']), _rates(case), case.get('commands', True)
    often = sampled(rig)
    ways = [trajectory(of_motion, contact=commands) for _ in range(2)]
    cleans = [clean_recording(often, target) for target, _ in ways]
    motions = [motion_of(often, clean, i) for i, clean in enumerate(cleans)]
    ground = Ground(often, ways[1][0], cleans[1], motions[1], rates)
    laws = {k: KINDS[k].draw(of_kinds) for k in case['kinds']}
    parts = _scaled(case, ground, rig, of_effects)
    added = [np.zeros((len(m.t), 16)) for m in motions]
    for kind, law in laws.items():
        both = [additions(often, law, m) for m in motions]
        size = np.sqrt(parts[2][kind] / ground.net(both[1]))
        added = [a + size * b for a, b in zip(added, both)]
    still = frozenset(EFFECTS[name].nuisance or '' for name in parts[0])
    real = drawn(often, of_rig, still)
    pair = [_recorded(real, parts[0], way, a, rates, of_noise) for way, a in zip(ways, added)]
    if not commands:
        pair = [replace(one, target=None) for one in pair]
    return (pair[0], pair[1]), rig, parts


def _on_the_arm(case: Mapping[str, Any], _motion: np.random.Generator,
                _rig: np.random.Generator, of_kinds: np.random.Generator,
                of_effects: np.random.Generator, _noise: np.random.Generator) -> Built:
    arm = background_kuka.arm()
    laws = {k: KINDS[k].draw(of_kinds) for k in case['kinds']}
    parts = _scaled(case, arm, arm.rig, of_effects)
    added = np.zeros((len(arm.motion.t), 6))
    for kind, law in laws.items():
        one = law(arm.motion)[:, background_kinds.WRENCH]
        added += np.sqrt(parts[2][kind] / arm.net(one)) * one
    return (arm.recorded(parts[0], added), None), arm.calibration, parts


def _scaled(case: Mapping[str, Any], ground: Any, rig: Rig, rng: np.random.Generator) -> Parts:
    """Size the effects; forms that could not show beside the least background are drawn anew."""
    for _ in range(FORMS):
        shapes = {n: shape_of(n, rig, ground.clean, np.random.default_rng(rng.integers(2 ** 32)))
                  for n in case['effects']}
        parts = _shrunk(case, ground, shapes)
        if min(parts[1].values(), default=np.inf) > RATIO[0] * sum(parts[2].values()):
            break
    return parts


def _shrunk(case: Mapping[str, Any], ground: Any, shapes: Mapping[str, Sizes]) -> Parts:
    """Size the effects; where one cannot be as large as wanted, all else shrinks with it."""
    background = dict(case['kinds'])
    effects, energies, total = {}, {}, sum(background.values())
    for _ in range(2):
        for name, shape in shapes.items():
            effects[name], energies[name] = sized(name, shape, ground, case['ratio'] * total)
        reached = min(energies.values(), default=np.inf) / (case['ratio'] or 1.0)
        if reached > 0.8 * total:
            break
        background = {k: max(BACKGROUND[0], v * reached / total)
                      for k, v in background.items()}
        total = sum(background.values())
        if len(effects) < 2:
            break
    return effects, energies, background


def _recorded(real: Rig, effects: Mapping[str, Mapping[str, float]],
              way: tuple[PoseStream, tuple[Phase, ...]], added: Array, rates: Rates,
              rng: np.random.Generator) -> Recording:
    """Record a motion with effects, what is added, and noise."""
    target, phases = way
    early = {n: v for n, v in effects.items() if n not in LATE}
    late = {n: v for n, v in effects.items() if n in LATE}
    r = clean_recording(with_effects(real, early) if early else real, target)
    added = added + np.where(np.isfinite(noise_of(real)), noise_of(real), 0.0) \
        * rng.standard_normal(added.shape)
    R = r.pose.R_base_sensor @ rotation_from_vector(added[:, 13:])
    pose = PoseStream(r.pose.t, r.pose.position + added[:, 10:13], R)
    r = replace(
        r, wrench=Stream(r.wrench.t, r.wrench.values + added[:, :6], 'ft_sensor'), pose=pose,
        accelerometer=Stream(r.accelerometer.t, r.accelerometer.values + added[:, 6:9],
                             'accelerometer'),
        optidrive=r.optidrive and replace(r.optidrive, values=r.optidrive.values
                                          + added[:, 9:10]),
        phases=phases, contact_truth=None)
    if late:
        r = apply_signal_effects(r, with_effects(replace(real, effects=()), late))
    return _thinned(r, rates)


def _thinned(r: Recording, rates: Rates) -> Recording:
    """Take every so many samples of each stream."""
    def rarer(stream: Stream | None, every: int) -> Stream | None:
        return stream and Stream(stream.t[every - 1::every], stream.values[every - 1::every],
                                 stream.frame)
    here = slice(rates.pose - 1, None, rates.pose)
    pose = PoseStream(r.pose.t[here], r.pose.position[here], r.pose.R_base_sensor[here])
    return replace(r, wrench=rarer(r.wrench, rates.wrench), pose=pose,
                   accelerometer=rarer(r.accelerometer, rates.accelerometer),
                   optidrive=rarer(r.optidrive, rates.optidrive))
