"""A real arm's free motion (KUKA LBR Med), on whose measured wrench effects are laid."""

from collections.abc import Mapping
import copy
from functools import lru_cache
import os
from pathlib import Path
from typing import NamedTuple

from blind.cases import LIBRARY
from blind.effect import Effect, sign
from blind.noise import Colour
from blind.robot import Array
from blind.second.ground import Ground
from blind.second.laid import laid_on, ON_WRENCH
from blind.second.law import Added, Moved
from blind.second.numbers import each, FORCES
import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation, RotationSpline

DATA = Path(os.environ.get(
    'FORCECAL_DATA', Path(__file__).resolve().parents[4] / 'shared' / 'data')) / 'kuka_lbr_med'
SLOW = 12.0
"""Below which the wrench is the motion's, not vibration [Hz]."""
BEHIND = 0.01
"""By which the sensors' clocks may be apart, 1 sigma [s]."""
MOMENTS = ('tool_com', 'tool_mass')


def there() -> bool:
    """Say whether the recordings are there."""
    return DATA.is_dir()


class Measured(NamedTuple):
    """
    The recording, and what is known of it.

    Attributes
    ----------
    wrench_t, accel_t, pose_t : ndarray
        [s], from the first wrench on.
    wrench, accel, R : ndarray
        As measured: with bias; [m/s^2]; sensor to base.
    noise : ndarray, shape (6,)
        By which neighbouring samples of the wrench differ.
    mass, com, bias : float, ndarray, ndarray
        From the static poses, by least squares.
    felt : ndarray, shape (n, 6)
        The wrench without bias, below :data:`SLOW`.
    own : ndarray, shape (n, 6)
        What of it no linear function of acceleration, turning and time delay explains.
    """

    wrench_t: Array
    wrench: Array
    accel_t: Array
    accel: Array
    pose_t: Array
    R: Array
    noise: Array
    mass: float
    com: Array
    bias: Array
    felt: Array
    own: Array


def _table(name: str) -> Array:
    return np.asarray(np.genfromtxt(DATA / f'{name}.csv', delimiter=',', skip_header=1))


def _static() -> tuple[float, Array, Array]:
    """Fit mass, centre of mass and bias to the static poses."""
    rows = _table('0-calibration_fts-accel')
    force, torque, gravity = rows[:, :3], rows[:, 3:6], rows[:, 9:12]
    A = np.hstack([gravity.reshape(-1, 1), np.tile(np.eye(3), (len(rows), 1))])
    found = np.linalg.lstsq(A, force.reshape(-1), rcond=None)[0]
    mass = float(found[0])
    cross = np.concatenate([-np.cross(mass * g, np.eye(3)).T for g in gravity])
    B = np.hstack([cross, np.tile(np.eye(3), (len(rows), 1))])
    other = np.linalg.lstsq(B, torque.reshape(-1), rcond=None)[0]
    return mass, other[:3], np.concatenate([found[1:], other[3:]])


def _turning(t: Array, pose_t: Array, R: Array) -> tuple[Array, Array, Array]:
    """Return orientation, speed and acceleration of turning, in S, at instants."""
    way = RotationSpline(pose_t, Rotation.from_matrix(R))
    at = np.clip(t, pose_t[0], pose_t[-1])
    return way(at).as_matrix(), way(at, 1), way(at, 2)


@lru_cache(maxsize=1)
def measured() -> Measured:
    """Read the recording; stamps that do not increase are left out."""
    parts = [_table(f'1-baseline_{kind}') for kind in ('wrench', 'accel', 'orientations')]
    start = parts[0][0, 0]
    parts = [p[np.r_[True, np.diff(p[:, 0]) > 0.0]] for p in parts]
    (t, wrench), (at, accel), (when, R) = (((p[:, 0] - start) * 1e-6, p[:, 1:]) for p in parts)
    R, accel = R.reshape(-1, 3, 3), 9.8209 * accel
    mass, com, bias = _static()
    low = butter(2, SLOW, fs=1 / float(np.median(np.diff(t))), output='sos')
    felt = sosfiltfilt(low, wrench - bias, axis=0)
    turned, omega, alpha = _turning(t, when, R)
    near = np.stack([np.interp(t, at, one) for one in accel.T], axis=1)
    pushed = sosfiltfilt(low, near, axis=0)
    late = np.gradient(pushed, t, axis=0)
    squares = np.einsum('ni,nj->nij', omega, omega).reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    columns = np.hstack([np.ones((len(t), 1)), pushed, late, turned[:, 2], alpha, squares])
    own = felt - columns @ np.linalg.lstsq(columns, felt, rcond=None)[0]
    noise = np.diff(wrench, axis=0).std(axis=0) / np.sqrt(2.0)
    return Measured(t, wrench, at, accel, when, R, noise, mass, com, bias, felt, own)


class OnReal:
    """One case of the real arm; see :class:`blind.second.on_rig.OnRig`."""

    name, most, lacks = 'real', 1.5e5, frozenset(('contact', 'accel', 'position'))
    effects = tuple(sorted((*MOMENTS, *(one for one in ON_WRENCH if one not in (
        'wrench_delay', 'wrench_lowpass')))))
    outside: tuple[str, ...] = ()
    strays: Mapping[str, Array] = {}
    quirks: Mapping[str, float] = {}

    def __init__(self, seed: int, forms: Mapping[str, Effect]) -> None:
        self._known, m = {**LIBRARY, **forms}, measured()
        R, omega, alpha = _turning(m.wrench_t, m.pose_t, m.R)
        still, t = np.zeros((len(m.wrench_t), 3)), m.wrench_t
        even = Moved(np.linspace(0.0, t[-1], len(t)), R, still, still, still, omega, alpha,
                     -m.felt[:, :3] / m.mass, m.felt, still, m.mass, m.com, 0)
        self.moved = [even]
        plain = Colour(1.0, np.ones(1), np.ones(1))
        columns = [('zero', self._low(np.tile(one, (len(t), 1))))
                   for one in np.diag(np.repeat([1.0, 0.1], 3))]
        columns += [('mass', self._low(0.02 * m.felt)),
                    ('behind', self._low(BEHIND * np.gradient(m.felt, t, axis=0)))]
        columns += [('com', self._low(_moment(0.001 * one, m.felt))) for one in np.eye(3)]
        self.ground = Ground({'wrench': [plain] * 6}, {'wrench': m.noise}, columns)
        self.own = self.ground.net(self._low(m.own))
        # what is faster than the motion is noise to who compares with it
        self.levels = {'wrench': np.std(m.wrench - m.bias - m.felt, axis=0)}
        self.nominal_levels = {'wrench': m.noise}
        self.judged_seconds = self.duration()

    def knowing(self, forms: Mapping[str, Effect]) -> 'OnReal':
        """Return the same case with other forms of effects."""
        other = copy.copy(self)
        vars(other)['_known'] = {**LIBRARY, **forms}
        return other

    def measured(self, arrays: Mapping[str, Array]) -> dict[str, Array]:
        """Return by how much the recording differs from a rigid tool, as far as that is slow."""
        return self._low(measured().own + arrays['change'])

    def compared(self, change: dict[str, Array]) -> dict[str, Array]:
        """Return what of a change is slow enough to be compared with the motion."""
        return self._low(change['wrench'])

    def own_change(self) -> dict[str, Array]:
        """Return what the recording leaves beside a rigid tool."""
        return self._low(measured().own)

    def _low(self, change: Array) -> dict[str, Array]:
        """Keep what is slow enough to be compared with the motion."""
        low = butter(2, SLOW, fs=1 / self.moved[0].dt, output='sos')
        return {'wrench': sosfiltfilt(low, change, axis=0)}

    def nuisance(self, name: str) -> tuple[str, float]:
        """Return the nuisance of an effect's name and its sigma, in sizes of the effect."""
        return {'tool_mass': ('mass', 0.002), 'tool_com': ('com', 0.001),
                'wrench_gain': ('', 0.0)}.get(name, ('', 0.0))

    def start(self, name: str) -> tuple[float, float]:
        """Return a usual and the largest size of an effect."""
        if name in MOMENTS:
            return {'tool_mass': (0.1, 2.0), 'tool_com': (0.01, 0.2)}[name]
        one = self._known[name]
        return float(np.sqrt(one.low * one.high)), 5.0 * one.high

    def stage(self, name: str) -> str:
        """Return where an effect sits."""
        return 'tool' if name in MOMENTS else self._known[name].stage

    def _change(self, name: str, size: float, seed: int) -> Array:
        m, rng = measured(), np.random.default_rng(seed)
        if name == 'tool_mass':
            return sign(rng) * size * m.felt
        if name == 'tool_com':
            way = rng.standard_normal(3)
            return _moment(size * way / np.linalg.norm(way), m.felt)
        return laid_on(self._known[name], size, seed, self.moved[0].t, m.felt)

    def of_effect(self, name: str, size: float, seed: int) -> dict[str, Array]:
        """Return what an effect changes."""
        return self._low(self._change(name, size, seed))

    def of_law(self, what: Added) -> dict[str, Array]:
        """Return what a discrepancy changes, fast or slow."""
        return {'wrench': what.wrench}

    def numbers(self, name: str, size: float, seed: int) -> dict[str, float]:
        """Return the numbers of an effect as the library calls them."""
        rng = np.random.default_rng(seed)
        if name == 'tool_mass':
            return {'change': sign(rng) * size}
        if name == 'tool_com':
            way = rng.standard_normal(3)
            return each('xyz', size * way / np.linalg.norm(way))
        if name == 'wrench_gain':
            unit = laid_on(self._known[name], size, seed, np.arange(3.0), np.ones((3, 6)))[0]
            return each(FORCES, unit)
        return {}

    def recordings(self, effect: tuple[str, float, int] | None, laws: list[Added],
                   onset: float | None) -> dict[str, Array]:
        """Lay it on the measured wrench, from ``onset`` on."""
        change = laws[0].wrench
        if effect:
            late = measured().wrench_t[:, None] >= (onset or 0.0)
            change = change + np.where(late, self._change(*effect), 0.0)
        return {'change': change}

    def duration(self) -> float:
        """Return the length of the recording [s]."""
        return float(self.moved[0].t[-1])


def _moment(shift: Array, wrench: Array) -> Array:
    """Return the torques of forces that act elsewhere."""
    return np.hstack([np.zeros((len(wrench), 3)), np.cross(shift, wrench[:, :3])])
