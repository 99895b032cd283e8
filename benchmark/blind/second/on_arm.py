"""The arm in MuJoCo as a generator of the second edition."""

from collections.abc import Mapping
import copy

from blind.cases import LIBRARY
from blind.effect import Effect, sign
from blind.robot import Array
from blind.second.arm import commands, Numbers, PERIOD, Ran, ran, source
from blind.second.ground import Ground
from blind.second.laid import laid_on, ON_WRENCH
from blind.second.law import Added, Moved
from blind.second.noise import draw_noise, quirks
from blind.second.numbers import each
import numpy as np
from scipy.spatial.transform import Rotation

SIGMA = {'wrench': np.repeat([0.15, 0.006], 3), 'position': np.full(3, 1e-4),
         'turn': np.full(3, 2e-4), 'joints': np.full(6, 3e-5)}
"""1 sigma of each channel, white: as of a UR's."""
RATES = dict.fromkeys(SIGMA, 1 / PERIOD)
SECONDS = 20.0
TRUTH, MODEL = (0.00025, 'implicitfast'), (0.001, 'Euler')
"""Time step and integrator."""

SPREADS = {'mass': (1, 0.014), 'com': (3, 0.001), 'friction': (6, 0.0), 'kp': (6, 0.05),
           'kv': (6, 0.10), 'tilt': (2, 0.003)}
"""How many numbers, 1 sigma of each: kg, m, relative, rad; friction 0.1 N m and a tenth."""

MECHANICAL = {  # stage, nuisance, usual size, largest
    'tool_mass': ('tool', 'mass', 0.1, 0.6), 'tool_com': ('tool', 'com', 0.01, 0.06),
    'base_tilt': ('robot', 'tilt', 0.02, 0.2), 'cable_force': ('tool', '', 5.0, 100.0),
    'joint_friction': ('robot', 'friction', 1.0, 6.0), 'joint_gain': ('robot', 'kp', 0.2, 0.7)}

ZERO = np.repeat([5.0, 0.3], 3)
"""By which nobody zeroed the sensor, 1 sigma [N], [N m]."""


def astray(sigmas: Mapping[str, Array]) -> Numbers:
    """Return the arm with each number so many sigma off."""
    n, off = Numbers(), {key: np.asarray(sigmas.get(key, np.zeros(count)))
                         for key, (count, _) in SPREADS.items()}
    friction = np.maximum(0.02, n.friction + off['friction'] * (0.1 + 0.1 * np.array(n.friction)))
    return n._replace(
        mass=n.mass + 0.014 * float(off['mass'][0]), com=_tuple(n.com + 0.001 * off['com']),
        friction=_tuple(friction), kp=_tuple(np.array(n.kp) * (1 + 0.05 * off['kp'])),
        kv=_tuple(np.array(n.kv) * (1 + 0.1 * off['kv'])), tilt=_tuple(0.003 * off['tilt']))


def _tuple(values: Array) -> tuple[float, ...]:
    return tuple(float(one) for one in values)


def changed(n: Numbers, name: str, size: float, seed: int) -> Numbers:
    """Return the arm with an effect."""
    rng = np.random.default_rng(seed)
    joint, way = int(rng.integers(1, 5)), rng.standard_normal(3)
    way = way / np.linalg.norm(way)
    if name == 'tool_mass':
        return n._replace(mass=n.mass * (1 + sign(rng) * size))
    if name == 'tool_com':
        return n._replace(com=_tuple(n.com + size * way))
    if name == 'base_tilt':
        return n._replace(tilt=_tuple(n.tilt + size * way[:2] / np.linalg.norm(way[:2])))
    if name == 'cable_force':
        return n._replace(pull=size, hook=_tuple(rng.uniform([0.2, -0.4, 1.0], [0.6, 0.4, 1.6])))
    one = np.eye(6)[joint]
    if name == 'joint_friction':
        return n._replace(friction=_tuple(n.friction + size * one))
    return n._replace(kp=_tuple(np.array(n.kp) * (1 + size * one) ** sign(rng)))


class OnArm:
    """One case of the arm; see :class:`blind.second.on_rig.OnRig`."""

    name, most, lacks = 'arm', 1.5e5, frozenset(('contact', 'accel'))
    effects = tuple(sorted((*MECHANICAL, *ON_WRENCH)))
    outside: tuple[str, ...] = ()

    def __init__(self, seed: int, forms: Mapping[str, Effect]) -> None:
        where, how = (np.random.default_rng(one) for one in np.random.SeedSequence(seed).spawn(2))
        self._known = {**LIBRARY, **forms}
        self._told = commands(SECONDS, where)
        self.strays = {key: how.standard_normal(count) for key, (count, _) in SPREADS.items()}
        self._noise, self._zero = draw_noise(how, SIGMA, RATES), ZERO * how.standard_normal(6)
        self._gain = 1 + 0.002 * how.standard_normal(6)
        self._seed = int(how.integers(2**32))
        self._clean = ran(Numbers(), self._told, *MODEL)
        looked_at = ('wrench', 'position', 'joints')
        self.ground = Ground({key: self._noise[key] for key in looked_at}, SIGMA, self._columns())
        self.moved = [self._moved()]
        self._own = _between(self._truth(Numbers()), self._clean)
        self.own = self.ground.net(self._own)

    def _truth(self, n: Numbers) -> Ran:
        return ran(n, self._told, *TRUTH)

    @property
    def quirks(self) -> dict[str, float]:
        """What is odd about its noise."""
        return quirks(self._noise)

    @property
    def levels(self) -> dict[str, Array]:
        """Root mean square of the noise of one sample, by topic."""
        return {topic: np.array([one.colour.level for one in self._noise[topic]]) * SIGMA[topic]
                for topic in ('wrench', 'position', 'joints')}

    @property
    def nominal_levels(self) -> dict[str, Array]:
        """Noise of one sample as one takes it to be."""
        return {topic: SIGMA[topic] for topic in ('wrench', 'position', 'joints')}

    def knowing(self, forms: Mapping[str, Effect]) -> 'OnArm':
        """Return the same case with other forms of effects."""
        other = copy.copy(self)
        vars(other)['_known'] = {**LIBRARY, **forms}
        return other

    def measured(self, arrays: Mapping[str, Array]) -> dict[str, Array]:
        """Return by how much the recording differs from nominal."""
        return {topic: arrays[topic] - getattr(self._clean, topic)
                for topic in ('wrench', 'position', 'joints')}

    @property
    def judged_seconds(self) -> float:
        """Return the length of the recording [s]."""
        return SECONDS

    def compared(self, change: dict[str, Array]) -> dict[str, Array]:
        """Return what of a change is compared: all."""
        return change

    def own_change(self) -> dict[str, Array]:
        """Return what the nominal model leaves without any effect."""
        return self._own

    def _columns(self) -> list[tuple[str, dict[str, Array]]]:
        found = []
        for key, (count, _) in SPREADS.items():
            for one in np.eye(count):
                off = ran(astray({key: one}), self._told, *MODEL)
                found.append((key, _between(off, self._clean)))
        for i in range(6):
            one = np.eye(6)[i]
            found += [('zero', self._of_wrench(np.tile(ZERO * one, (len(self._told), 1)))),
                      ('wrench_gain', self._of_wrench(0.002 * one * self._clean.wrench))]
        return found

    def _of_wrench(self, change: Array) -> dict[str, Array]:
        return {'wrench': change, 'position': np.zeros((len(change), 3)),
                'joints': np.zeros((len(change), 6)), 'turn': np.zeros((len(change), 3))}

    def _moved(self) -> Moved:
        n, at = Numbers(), self._clean
        t = PERIOD * np.arange(len(self._told), dtype=float)
        velocity = np.gradient(at.position, PERIOD, axis=0)
        acceleration = np.gradient(velocity, PERIOD, axis=0)
        step = Rotation.from_matrix(np.swapaxes(at.R[:-2], 1, 2) @ at.R[2:]).as_rotvec()
        omega = np.pad(step / (2 * PERIOD), ((1, 1), (0, 0)), mode='edge')
        force = np.einsum('nji,nj->ni', at.R, acceleration - np.array([0.0, 0.0, -9.80665]))
        return Moved(t, at.R, at.position, velocity, acceleration, omega,
                     np.gradient(omega, PERIOD, axis=0), force, at.wrench, 0.0 * velocity, n.mass,
                     np.array(n.com), 0)

    def nuisance(self, name: str) -> tuple[str, float]:
        """Return the nuisance of an effect's name and its sigma, in sizes of the effect."""
        key = MECHANICAL[name][1] if name in MECHANICAL else self._known[name].nuisance
        sigma = {'mass': 0.01, 'friction': 0.2, 'wrench_gain': 0.002}.get(key)
        return key, 0.0 if not key else SPREADS[key][1] if sigma is None else sigma

    def start(self, name: str) -> tuple[float, float]:
        """Return a usual and the largest size of an effect."""
        if name in MECHANICAL:
            return MECHANICAL[name][2:]
        one = self._known[name]
        return float(np.sqrt(one.low * one.high)), 3.0 * one.high

    def stage(self, name: str) -> str:
        """Return where an effect sits."""
        return MECHANICAL[name][0] if name in MECHANICAL else self._known[name].stage

    def of_effect(self, name: str, size: float, seed: int) -> dict[str, Array]:
        """Return what an effect changes."""
        if name in MECHANICAL:
            return _between(ran(changed(Numbers(), name, size, seed), self._told, *MODEL),
                            self._clean)
        return self._of_wrench(laid_on(self._known[name], size, seed, self.moved[0].t,
                                       self._clean.wrench))

    def of_law(self, what: Added) -> dict[str, Array]:
        """Return what a discrepancy changes."""
        return {**self._of_wrench(what.wrench), 'position': what.position}

    def numbers(self, name: str, size: float, seed: int) -> dict[str, float]:
        """Return the numbers of an effect as the library calls them."""
        was, now = Numbers(), changed(Numbers(), name, size, seed)
        return {'tool_mass': lambda: {'value': now.mass, 'change': now.mass / was.mass - 1},
                'tool_com': lambda: each('xyz', np.subtract(now.com, was.com)),
                'base_tilt': lambda: each('xy', np.array(now.tilt)),
                'wrench_delay': lambda: {'delay': size},
                'joint_friction': lambda: {'value': max(
                    b for a, b in zip(was.friction, now.friction) if a != b)},
                'joint_gain': lambda: {'value': max(
                    b for a, b in zip(was.kp, now.kp) if a != b)},
                }.get(name, dict)()

    def recordings(self, effect: tuple[str, float, int] | None, laws: list[Added],
                   onset: float | None) -> dict[str, Array]:
        """Record it; an effect of the sensor may begin at ``onset``."""
        strays, t = dict(self.strays), self.moved[0].t
        if effect and self.nuisance(effect[0])[0] in strays:
            strays[self.nuisance(effect[0])[0]] *= 0.0
        n = astray(strays)
        if effect and effect[0] in MECHANICAL:
            n = changed(n, *effect)
        made, rng = self._truth(n), np.random.default_rng(self._seed)
        loud = np.linalg.norm(self.moved[0].acceleration, axis=1)
        wrench = made.wrench + laws[0].wrench
        if effect and effect[0] not in MECHANICAL:
            change = laid_on(self._known[effect[0]], effect[1], effect[2], t, wrench)
            wrench = wrench + np.where(t[:, None] >= (onset or 0.0), change, 0.0)
        noise = {key: np.stack([one.draw(len(t), s, rng, loud) for one, s in zip(
            self._noise[key], SIGMA[key])], axis=1) for key in SIGMA}
        R = made.R @ Rotation.from_rotvec(noise['turn']).as_matrix()
        return {'t': t, 'wrench': wrench * self._gain + self._zero + noise['wrench'],
                'position': made.position + laws[0].position + noise['position'], 'R': R,
                'joints': made.joints + noise['joints'], 'told': self._told,
                'model': np.array(source(Numbers(), *MODEL))}

    def duration(self) -> float:
        """Return the length of the recording [s]."""
        return SECONDS


def _between(one: Ran, other: Ran) -> dict[str, Array]:
    turn = Rotation.from_matrix(np.swapaxes(other.R, 1, 2) @ one.R).as_rotvec()
    return {**{key: getattr(one, key) - getattr(other, key) for key in (
        'wrench', 'position', 'joints')}, 'turn': turn}
