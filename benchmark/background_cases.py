"""Pairs of recordings that depart from their model by an effect and by what no library has.

A case is a dictionary of what was drawn; :func:`make` turns it into recordings and the truth.
Energies are whitened: squares of what is added, over the variance of the true white noise, summed
over the samples of the held-out recording. What the nuisances, within one spread each, could take
up is projected out by columns in closed form (wrench and accelerometer: gains, biases, mass,
centre of mass, inertia; slide and wall: their static part). The motion that a background depends
on is that of the nominal rig, of which the true one hardly differs. Backgrounds are added to the
signals before the noise, and before what saturates.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import background_kinds
from background_kinds import KINDS, Motion
import background_kuka
from forcecal_ros.effects import (
    applicable,
    apply_signal_effects,
    EFFECTS,
    Quantity,
    with_effects,
)
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array, rotation_about, rotation_from_vector, rotation_vector
from forcecal_ros.recording.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.simulators.rig.file import load_rig
from forcecal_ros.simulators.rig.offline import simulate
import numpy as np

NOISE = 1.5
"""Noise of the recordings, in that of the rig's file."""

CERTAIN = 3.5
"""Spreads that an effect of a nuisance's name departs by, to which the sized part is added."""

BACKGROUND = (30.0, 1e6)
"""Energy of each discrepancy, the higher one of half a minute of 1 kHz: less for fewer samples."""

SHORTER = 0.15
"""Samples of the real arm, in those."""

RATIO = (0.3, 100.0)
"""Energy of the effect, in that of all discrepancies together."""

WITHOUT_ENERGY = ('clock_skew', 'dropouts', 'wrench_quantisation')
"""Effects of stamps and values, which no energy of the mean can size."""

LATE = ('wrench_saturation', 'accel_saturation')
"""Effects on readings, noise and background included."""

LOWEST = 1.0
"""How far a limit falls below the largest value, as a logarithm."""

STEPS = 8
"""Integration steps in 4 ms."""

CLOSE = 0.03
"""Relative error of an effect's energy that is close enough."""


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


# motion

class _Path:
    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.home = rng, np.array([1.0, 0.0, 1.0])
        self._poses = [np.concatenate([self.home, np.zeros(3)])[None]]
        self._phases: list[Phase] = []
        self._n = 0

    def _add(self, word: str, poses: Array) -> None:
        self._poses.append(poses)
        self._n += len(poses)
        self._phases.append(Phase(word, 0.004 * (self._n - len(poses)), 0.004 * self._n))

    def hold(self, word: str, seconds: float) -> None:
        self._add(word, np.repeat(self._poses[-1][-1:], round(seconds / 0.004), axis=0))

    def go(self, word: str, offset: Sequence[float], turn: Sequence[float], seconds: float
           ) -> None:
        n = round(seconds / 0.004)
        u = np.arange(1, n + 1)[:, None] / n
        way = np.concatenate([self.home + offset, turn]) - self._poses[-1][-1]
        self._add(word, self._poses[-1][-1] + way * u ** 3 * (10.0 - 15.0 * u + 6.0 * u ** 2))

    def wave(self, word: str, size: Array, band: tuple[float, float], seconds: float) -> None:
        t = 0.004 * np.arange(1, round(seconds / 0.004) + 1)
        rise = np.clip(np.minimum(t, seconds - t) / 0.5, 0.0, 1.0)
        angle = 2.0 * np.pi * (band[0] * t + 0.5 * (band[1] - band[0]) * t ** 2 / seconds)
        own = self.rng.uniform(0.8, 1.25, 6)
        rise = rise ** 2 * (3.0 - 2.0 * rise)
        self._add(word, self._poses[-1][-1] + size * rise[:, None] * np.sin(
            np.outer(angle, own)))

    def commands(self) -> tuple[PoseStream, tuple[Phase, ...]]:
        pose = np.concatenate(self._poses)
        R = rotation_about('x', np.pi) @ rotation_from_vector(pose[:, 3:])
        return PoseStream(0.004 * np.arange(len(pose)), pose[:, :3], R), tuple(self._phases)


def trajectory(rng: np.random.Generator, contact: bool = True
               ) -> tuple[PoseStream, tuple[Phase, ...]]:
    """Draw half a minute of poses, a step, a sweep, slow reversals and two contacts, or none."""
    path, still = _Path(rng), np.zeros(3)
    path.hold('measure', 1.5)
    for _ in range(3 if contact else 7):
        path.go('move', rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.9, 0.9, 3), 1.2)
        path.hold('settle', 0.4)
        path.hold('measure', 0.7)
    path.go('move', still, still, 1.2)
    path.hold('settle', 0.4)
    path.go('step', [0.01, 0.0, 0.0], still, 0.1)
    path.hold('step', 0.7)
    size = np.repeat([0.006, 0.06], 3) * rng.uniform(0.7, 1.3, 6)
    path.wave('sweep', size, (rng.uniform(0.4, 0.8), rng.uniform(4.5, 6.5)), 4.5)
    path.hold('settle', 0.4)
    size = np.array([0.035, 0.02, 0.02, 0.1, 0.1, 0.1]) * rng.uniform(0.7, 1.3, 6)
    path.wave('reverse', size, (0.3, 0.3), 5.0)
    path.hold('settle', 0.4)
    for depth in rng.uniform(0.0035, 0.008, 2 if contact else 0):
        path.go('approach', [0.076 + depth, 0.0, 0.0], still, 1.0)
        path.go('contact', [0.08 + depth, 0.0, 0.0], still, 0.3)
        path.hold('contact', 0.5)
        path.wave('contact', np.array([0.002, 0.004, 0.004, 0.0, 0.0, 0.0]), (1.0, 3.0), 1.4)
        path.go('retract', still, still, 1.0)
        path.hold('settle', 0.3)
    return path.commands()


# nuisances

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


# signals

class Rates(NamedTuple):
    """Every how many samples of 1 kHz each stream has one."""

    wrench: int = 1
    accelerometer: int = 1
    optidrive: int = 1
    pose: int = 4


GROUPS = (('wrench', slice(0, 6)), ('accelerometer', slice(6, 9)), ('optidrive', slice(9, 10)),
          ('pose', slice(10, 16)))
"""Columns of each stream: wrench, volts, slide, position, rotation vector in S."""


def _sampled(rig: Rig) -> Rig:
    """Let every sensor take a thousand samples a second."""
    def often(part: Any) -> Any:
        return part and replace(part, rate=1000.0)
    return replace(rig, wrench_sensor=often(rig.wrench_sensor), optidrive=often(rig.optidrive),
                   accelerometer=often(rig.accelerometer), pose_sensor=often(rig.pose_sensor))


def _clean(rig: Rig, target: PoseStream) -> Recording:
    return simulate(rig, target, noise=False, steps=STEPS)


def _departure(one: Recording, other: Recording) -> Array:
    """Return how two recordings of 1 kHz differ, (n, 16)."""
    out = np.zeros((len(one.wrench), 16))
    out[:, :6] = one.wrench.values - other.wrench.values
    out[:, 6:9] = one.accelerometer.values - other.accelerometer.values
    if one.optidrive is not None:
        out[:, 9:10] = one.optidrive.values - other.optidrive.values
    out[:, 10:13] = one.pose.position - other.pose.position
    if not np.array_equal(one.pose.R_base_sensor, other.pose.R_base_sensor):
        out[:, 13:] = rotation_vector(np.swapaxes(other.pose.R_base_sensor, 1, 2)
                                      @ one.pose.R_base_sensor)
    return out


def _noise(rig: Rig) -> Array:
    """Return the noise of every column, shape (16,)."""
    pose = rig.pose_sensor
    slide = rig.optidrive.noise if rig.optidrive else np.inf
    return NOISE * np.array(
        [rig.wrench_sensor.force_noise] * 3 + [rig.wrench_sensor.torque_noise] * 3
        + [rig.accelerometer.noise] * 3 + [slide] + [pose.position_noise] * 3
        + [pose.orientation_noise] * 3)


def motion_of(rig: Rig, clean: Recording, index: int) -> Motion:
    """
    Say how a rig's sensor moves and what it feels.

    Parameters
    ----------
    rig : Rig
    clean : Recording
        Of 1 kHz, without noise.
    index : int
        Of the recording in its case.
    """
    t, R = clean.wrench.t, clean.pose.R_base_sensor
    dt = float(np.median(np.diff(t)))
    velocity = np.gradient(clean.pose.position, dt, axis=0)
    acceleration = np.gradient(velocity, dt, axis=0)
    omega = np.zeros_like(velocity)
    omega[1:-1] = rotation_vector(np.swapaxes(R[:-2], 1, 2) @ R[2:]) / (2.0 * dt)
    force = np.einsum('nji,nj->ni', R, acceleration - np.array(rig.gravity))
    return Motion(t - t[0], R, clean.pose.position, velocity, acceleration, omega,
                  np.gradient(omega, dt, axis=0), force,
                  clean.wrench.values - rig.wrench_sensor.bias, clean.contact_truth.values,
                  rig.tool.mass, np.array(rig.tool.com), index)


def _nuisance_columns(rig: Rig, clean: Recording, m: Motion) -> tuple[Array, tuple[str, ...]]:
    """Return what one spread of each nuisance adds, (k, n, 16), and the keys of the spreads."""
    s, found, keys = rig.spreads, [], []

    def add(key: str, start: int, values: Array) -> None:
        column = np.zeros((len(m.t), 16))
        column[:, start:start + values.shape[1]] = values
        found.append(column)
        keys.append(key)

    own = m.wrench - m.contact
    add('mass', 0, s.mass * own)
    for i, axis in enumerate(np.eye(3)):
        add('com', 3, s.com * np.cross(axis, own[:, :3]))
        spin = rig.tool.inertia[i][i] * m.omega[:, i:i + 1] * axis
        turned = rig.tool.inertia[i][i] * m.alpha[:, i:i + 1] * axis
        add('inertia', 3, -s.inertia * (turned + np.cross(m.omega, spin)))
    volts = clean.accelerometer.values - rig.accelerometer.model().offset
    for i in range(6):
        add('force_bias' if i < 3 else 'torque_bias', i,
            np.full((len(m.t), 1), s.force_bias if i < 3 else s.torque_bias))
        add('wrench_gain', i, s.wrench_gain * m.wrench[:, i:i + 1])
    for i in range(3):
        add('accelerometer_gain', 6 + i, s.accelerometer_gain * volts[:, i:i + 1])
        add('accelerometer_offset', 6 + i, np.full((len(m.t), 1), s.accelerometer_offset))
    if rig.optidrive:
        add('stiffness', 9, s.stiffness * clean.optidrive.values)
    if m.contact.any():
        yielding = rig.optidrive.stiffness if rig.optidrive else np.inf
        share = 1.0 / (1.0 + rig.wall.stiffness / yielding)
        pushed = np.linalg.norm(m.contact[:, :3], axis=1, keepdims=True)
        add('wall_stiffness', 0, s.wall_stiffness * share * m.contact)
        series = rig.wall.stiffness * share if share < 1.0 else rig.wall.stiffness
        add('wall_position', 0, s.wall_position * series * m.contact / np.maximum(pushed, 1.0))
    return np.array(found), tuple(keys)


# energies

@dataclass
class Ground:
    """
    The held-out recording of the nominal rig, and what counts beside its noise.

    Attributes
    ----------
    rig : Rig
    target : PoseStream
    clean : Recording
    motion : Motion
    rates : Rates
    """

    rig: Rig
    target: PoseStream
    clean: Recording
    motion: Motion
    rates: Rates
    _columns: Array = field(default_factory=lambda: np.zeros(0))
    _keys: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        columns, self._keys = _nuisance_columns(self.rig, self.clean, self.motion)
        self._columns = np.array([self.whitened(c) for c in columns])
        self._gram = self._columns @ self._columns.T + np.eye(len(self._columns))

    def whitened(self, departure: Array) -> Array:
        """Return what of a departure (n, 16) is sampled, over the noise, in one row."""
        parts = departure / _noise(self.rig)
        return np.concatenate([parts[every - 1::every, columns].ravel() for every, (_, columns)
                               in zip(self.rates, GROUPS)])

    def net(self, departure: Array, without: str | None = None) -> float:
        """
        Return the energy of a departure that the nuisances cannot take up.

        Parameters
        ----------
        departure : ndarray, shape (n, 16)
        without : str, optional
            Key of a nuisance that is left out.
        """
        d = self.whitened(departure)
        product = self._columns @ d
        rows = np.array([key != without for key in self._keys])
        product, gram = product[rows], self._gram[np.ix_(rows, rows)]
        return float(d @ d - product @ np.linalg.solve(gram, product))

    def departure(self, values: Mapping[str, Mapping[str, float]]) -> Array:
        """Return what effects change, (n, 16)."""
        rig = with_effects(self.rig, values)
        if all(EFFECTS[name].where == 'signal' for name in values):
            return _departure(apply_signal_effects(self.clean, rig), self.clean)
        return _departure(_clean(rig, self.target), self.clean)


def additions(rig: Rig, law: background_kinds.Law, m: Motion) -> Array:
    """Return what a law adds to the signals of a recording, (n, 16)."""
    added = law(m)
    out = np.zeros((len(added), 16))
    out[:, :6] = added[:, background_kinds.WRENCH]
    out[:, 6:9] = added[:, background_kinds.ACCEL] * rig.accelerometer.model().gain
    out[:, 10:13] = added[:, background_kinds.POSITION]
    out[:, 13:] = added[:, background_kinds.TURN]
    return out


# effects

Sizes = Callable[[float], dict[str, float]]


def shape_of(name: str, rig: Rig, clean: Recording, rng: np.random.Generator) -> Sizes:
    """
    Draw the form of an effect: its values by one scale, which does nothing at 0.

    Parameters
    ----------
    name : str
    rig : Rig
    clean : Recording
    rng : numpy.random.Generator
    """
    effect = EFFECTS[name]
    if name in LATE:
        return _clipping(name, rig, clean, rng)
    shapes = {q.name: _formed(q, rng) for q in effect.parameters if q.shapes}
    sized = [q for q in effect.parameters if not q.shapes]
    chosen = [sized[i] for i in rng.permutation(len(sized))[:rng.integers(1, 4)]]
    weights = [_sign(q, rng) * rng.uniform(0.4, 1.0) for q in chosen]
    least = CERTAIN * getattr(rig.spreads, effect.nuisance) if effect.nuisance else 0.0

    def values(scale: float) -> dict[str, float]:
        return shapes | {q.name: q.nominal + w * scale * (q.typical - q.nominal)
                         + np.sign(w) * least for q, w in zip(chosen, weights)}

    return values


def _sign(q: Quantity, rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0])) if -q.low >= 0.5 * q.high or q.name == 'change' else 1.0


def _formed(q: Quantity, rng: np.random.Generator) -> float:
    """Draw a parameter that only shapes its effect, near one of its starts."""
    usual = float(rng.choice(q.starts))
    if q.name.startswith('point_'):
        return usual + 0.02 * float(rng.standard_normal())
    if q.name in ('before', 'softness', 'grounded', 'second_order'):
        return usual
    return float(np.clip(usual * np.exp(0.2 * rng.standard_normal()), q.low, q.high))


def _clipping(name: str, rig: Rig, clean: Recording, rng: np.random.Generator) -> Sizes:
    """Clip one axis of the forces or of the accelerometer, from its largest value down."""
    axis = int(rng.integers(0, 3))
    if name == 'wrench_saturation':
        values, word = clean.wrench.values[:, axis], ('fx', 'fy', 'fz')[axis]
    else:
        model = rig.accelerometer.model()
        volts = clean.accelerometer.values[:, axis]
        values, word = (volts - model.offset[axis]) / model.gain[axis], 'xyz'[axis]
    top = float(np.abs(values).max())
    return lambda scale: {word: top * float(np.exp(-min(scale, LOWEST)))}


def _inside(name: str, values: Mapping[str, float]) -> bool:
    """Say whether no parameter goes further than half-way to its limits."""
    for q in EFFECTS[name].parameters:
        value = values.get(q.name, q.nominal)
        limit = q.high if value > q.nominal else q.low
        if not q.shapes and name not in LATE and abs(value - q.nominal) > 0.5 * abs(
                limit - q.nominal):
            return False
    return True


def sized(name: str, shape: Sizes, ground: Any, energy: float
          ) -> tuple[dict[str, float], float]:
    """
    Find the values at which an effect has an energy, or the largest that its limits allow.

    Parameters
    ----------
    name : str
    shape : callable
        Scale -> values.
    ground : Ground or background_kuka.Arm
    energy : float

    Returns
    -------
    values : dict of str to float
    energy : float
        Theirs, net of the nuisances.
    """
    nuisance = EFFECTS[name].nuisance
    at_rest = ground.departure({name: shape(0.0)}) if nuisance else 0.0
    best, scale, slope = (shape(0.0), 0.0), 0.1, 2.0
    before: tuple[float, float] | None = None
    for _ in range(9):
        while not _inside(name, shape(scale)):
            scale *= 0.8
        with np.errstate(all='ignore'):
            found = ground.net(ground.departure({name: shape(scale)}) - at_rest, nuisance)
        if not np.isfinite(found) or found > 1e12:
            scale *= 0.3
            continue
        if abs(np.log(max(found, 1e-9) / energy)) < abs(np.log(max(best[1], 1e-9) / energy)):
            best = (shape(scale), found)
        if abs(found / energy - 1.0) < CLOSE:
            break
        if before and found > 0.0 and scale != before[0]:
            own = np.log(found / before[1]) / np.log(scale / before[0])
            slope = float(np.clip(own, 0.7, 6.0)) if np.isfinite(own) else 2.0
        if found > 0.0:
            before = (scale, found)
        factor = (energy / max(found, 1e-9)) ** (1.0 / slope)
        wanted = scale * float(np.clip(factor, 0.01, 100.0))
        if wanted > scale and not _inside(name, shape(scale * 1.02)):
            break
        scale = wanted
    return best


# cases

BASES = ('rig', 'rigid', 'kuka')

RIGID_RATES = (500, 200, 125)
"""Of all streams of a rigid tool [Hz]."""

WITH_COMMANDS = 0.6
"""Share of the rigid cases whose commands are known."""


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
    often = _sampled(rig)
    ways = [trajectory(of_motion, contact=commands) for _ in range(2)]
    cleans = [_clean(often, target) for target, _ in ways]
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
    """Size the effects; where one cannot be as large as wanted, all else shrinks with it."""
    background = dict(case['kinds'])
    effects, energies, total = {}, {}, sum(background.values())
    for _ in range(2):
        for name in case['effects']:
            own = np.random.default_rng(rng.integers(2 ** 32))
            shape = shape_of(name, rig, ground.clean, own)
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
    r = _clean(with_effects(real, early) if early else real, target)
    added = added + np.where(np.isfinite(_noise(real)), _noise(real), 0.0) \
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
