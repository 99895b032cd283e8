"""Recordings of the simulated rig whose cause is known."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_about, rotation_from_vector
from forcecal_ros.core.streams import Phase, PoseStream, Recording
from forcecal_ros.diagnose.dataset import Dataset
from forcecal_ros.diagnose.model.linearised import LinearisedModel, noise_level
from forcecal_ros.diagnose.plan import motion_for
from forcecal_ros.diagnose.sources.rig import prepare_commanded
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.nuisances import apply_all, nuisances, prior_std
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

NOISE = 1.5
"""Noise of the recordings, in that of the rig's file."""

CERTAIN = 3.5
"""Tolerances that an effect of a nuisance's name departs by, to which the sized part is added."""

SHAPES: Mapping[str, Mapping[str, float]] = {
    'wrench_delay': {'delay': 0.004}, 'wrench_lowpass': {'time_constant': 0.004},
    'wrench_bias_drift': {'fz': 0.05, 'ty': 0.002}, 'wrench_gain': {'fz': 0.05, 'fx': -0.03},
    'wrench_crosstalk': {'fx_of_fz': 0.03}, 'wrench_hysteresis': {'height': 1.0, 'width': 5.0},
    'wrench_saturation': {'limit': -10.0}, 'accel_saturation': {'limit': -1.0},
    'accel_delay': {'delay': 0.004}, 'accel_gain': {'z': 0.05},
    'accel_bias': {'x': 0.1, 'z': -0.05}, 'accel_misalignment': {'y': 0.03, 'x': -0.01},
    'accel_highpass': {'rate': 0.1, 'before': 0.0},
    'accel_resonance': {'amplitude': 1.0, 'frequency': 30.0, 'damping': 0.1},
    'tool_mass': {'change': 0.05}, 'tool_com': {'x': 0.005, 'z': 0.003},
    'tool_stiffness': {'change': 0.1}, 'tool_damping': {'change': 0.3},
    'tool_stiffening': {'cubic': 1e7}, 'tool_friction': {'force': 3.0, 'velocity_scale': 0.002},
    'tool_backlash': {'gap': 0.0005}, 'cable_force': {'x': 2.0, 'z': 2.0, 'y': 1.0},
    'spindle_vibration': {'sine_x': 2.0, 'frequency': 41.3}, 'robot_delay': {'delay': 0.004},
    'robot_resonance': {'gain': 0.2, 'frequency': 9.0, 'damping': 0.06},
    'base_tilt': {'x': 0.01, 'y': 0.005}, 'contact_stiffness': {'change': 0.3},
    'contact_damping': {'change': 1.0}, 'wall_position': {'shift': 0.001},
}
"""Each effect of the mean at full size; what only shapes it (a frequency, say) keeps its value."""

OF_STAMPS_AND_VALUES: Mapping[str, Mapping[str, float]] = {
    'clock_skew': {'wrench': 2e-4}, 'dropouts': {'wrench': 0.02, 'accelerometer': 0.01},
    'wrench_quantisation': {'step': 0.4, 'torque_step': 0.04},
}
"""Effects that have no energy in the mean, at a fixed size."""


class Sized(NamedTuple):
    """
    An effect at a given energy.

    Attributes
    ----------
    values : dict of str to float
    raw : float
        Its held-out whitened energy under the true noise.
    net : float
        What of it the nuisances, within their spreads, cannot take up; of an effect of a
        nuisance's name, what lies beyond CERTAIN spreads.
    """

    values: dict[str, float]
    raw: float
    net: float


def trajectory(variant: int, motion: str = 'quick') -> tuple[PoseStream, tuple[Phase, ...]]:
    """Return commands and their phases: ``quick``, ``slow`` (below 0.3 Hz) or as ``planned``."""
    if motion == 'planned':
        planned = motion_for(load_rig(), contact=False)
        return planned.target, planned.phases
    path = _Path(variant)
    path.hold('measure', 1.6)
    for _ in range(3):
        path.go('move', path.home + path.random.uniform(-0.05, 0.05, 3),
                path.random.uniform(-0.9, 0.9, 3), 1.4)
        path.hold('settle', 0.4)
        path.hold('measure', 1.0)
    path.go('move', path.home, np.zeros(3), 1.4)
    path.hold('settle', 0.4)
    if motion == 'slow':
        path.wave('sweep', (0.02, 0.015, 0.015), (0.1, 0.3), 24.0, 0.1)
        return path.commands()
    for x in (0.01, 0.0):
        path.go('step', path.home + [x, 0.0, 0.0], np.zeros(3), 0.1)
        path.hold('step', 0.9)
    path.wave('sweep', (0.006, 0.005, 0.005), ((0.5, 6.0), (0.7, 5.0))[variant % 2], 6.0,
              0.05 * (1.0 + 0.3 * variant))
    path.hold('settle', 0.4)
    path.wave('reverse', (0.03 + 0.01 * variant, 0.02, 0.02), (0.25, 0.25), 8.0, 0.0)
    path.hold('settle', 0.4)
    for depth in ((0.004, 0.007) if variant % 2 == 0 else (0.007, 0.004)):
        path.go('approach', path.home + [0.076 + depth, 0.0, 0.0], np.zeros(3), 1.2)
        path.go('contact', path.home + [0.08 + depth, 0.0, 0.0], np.zeros(3), 0.4)
        path.hold('contact', 0.8)
        path.wave('contact', (0.002, 0.0, 0.0), (1.0, 3.0), 1.6, 0.0)
        path.go('retract', path.home, np.zeros(3), 1.2)
        path.hold('settle', 0.4)
    return path.commands()


class _Path:
    def __init__(self, variant: int) -> None:
        self.random = np.random.default_rng(100 + variant)
        self.home = np.array([1.0, 0.0, 1.0])
        self._pose = [np.concatenate([self.home, np.zeros(3)])]
        self._phases: list[Phase] = []

    def _add(self, word: str, poses: Array) -> None:
        start = 0.004 * (len(self._pose) - 1)
        self._pose.extend(poses)
        self._phases.append(Phase(word, start, 0.004 * (len(self._pose) - 1)))

    def hold(self, word: str, seconds: float) -> None:
        self._add(word, np.repeat(self._pose[-1][np.newaxis], round(seconds / 0.004), axis=0))

    def go(self, word: str, position: Array, turn: Array, seconds: float) -> None:
        n = round(seconds / 0.004)
        u = np.arange(1, n + 1)[:, np.newaxis] / n
        way = np.concatenate([position, turn]) - self._pose[-1]
        self._add(word, self._pose[-1] + way * (10.0 * u ** 3 - 15.0 * u ** 4 + 6.0 * u ** 5))

    def wave(self, word: str, size: tuple[float, ...], band: tuple[float, float],
             seconds: float, turn: float) -> None:
        t = 0.004 * np.arange(1, round(seconds / 0.004) + 1)
        rise = np.clip(np.minimum(t, seconds - t) / 0.5, 0.0, 1.0)
        angle = 2.0 * np.pi * (band[0] * t + 0.5 * (band[1] - band[0]) * t ** 2 / seconds)
        ways = [s * np.sin(angle * (1.0 + 0.13 * i)) for i, s in enumerate(size)]
        ways += [turn * np.sin(np.pi * (1.0 + 0.2 * i) * t) for i in range(3)]
        self._add(word, self._pose[-1] + (rise ** 2 * (3.0 - 2.0 * rise) * ways).T)

    def commands(self) -> tuple[PoseStream, tuple[Phase, ...]]:
        pose = np.array(self._pose)
        R = rotation_about('x', np.pi) @ rotation_from_vector(pose[:, 3:])
        return PoseStream(0.004 * np.arange(len(pose)), pose[:, :3], R), tuple(self._phases)


def drawn(rig: Rig, seed: int, still: set[str]) -> Rig:
    """Draw a rig's nuisances from their spreads, some of them left alone."""
    rng = np.random.default_rng(seed)
    found = nuisances(rig, 'acc1', ('wrench', 'accelerometer'))
    return apply_all(rig, found, {
        n.name: size * float(np.clip(rng.standard_normal(), -2.9, 2.9)) * (n.key not in still)
        for n, size in zip(found, prior_std(rig, found))})


def noisy(rig: Rig, factor: float) -> Rig:
    """Scale a rig's noise."""
    wrench, pose, slide = rig.wrench_sensor, rig.pose_sensor, rig.optidrive
    return replace(
        rig,
        wrench_sensor=replace(wrench, force_noise=factor * wrench.force_noise,
                              torque_noise=factor * wrench.torque_noise),
        accelerometer=replace(rig.accelerometer, noise=factor * rig.accelerometer.noise),
        optidrive=slide and replace(slide, noise=factor * slide.noise),
        pose_sensor=replace(pose, position_noise=factor * pose.position_noise,
                            orientation_noise=factor * pose.orientation_noise))


def real_rig(seed: int, effects: Mapping[str, Mapping[str, float]]) -> Rig:
    """Return a rig with its nuisances drawn, its noise, and effects."""
    still = {EFFECTS[name].nuisance or '' for name in effects}
    real = noisy(drawn(load_rig(), seed, still), NOISE)
    return with_effects(real, effects) if effects else real


def recordings(seed: int, effects: Mapping[str, Mapping[str, float]], *,
               motion: str = 'quick') -> tuple[Recording, Recording | None]:
    """Simulate a pair, the first to fit on, the second to judge on; one as planned."""
    real = real_rig(seed, effects)
    pair: list[Recording] = []
    for variant in (0,) if motion == 'planned' else (0, 1):
        target, phases = trajectory(variant, motion)
        recorded = simulate(real, target, seed=2 * seed + 1000 + variant, steps=16)
        pair.append(replace(recorded, phases=phases, contact_truth=None))
    return pair[0], pair[1] if len(pair) > 1 else None


@lru_cache(maxsize=1)
def _reference() -> tuple[Rig, Dataset, Array, tuple[str, ...]]:
    """Nominal rig, the held-out motion without noise, whitened columns of its nuisances."""
    rig = load_rig()
    target, phases = trajectory(1)
    case = prepare_commanded(replace(simulate(rig, target, noise=False), phases=phases), rig)
    found = nuisances(rig, 'acc1', case.measured.streams)
    level = NOISE * noise_level(rig, case.measured.streams, 'acc1')
    p = LinearisedModel(rig, (case,), found, np.array(prior_std(rig, found)), level,
                        centre=np.zeros(len(found)))
    p.linearise()
    columns = np.zeros((len(found), len(case.groups), len(level)))
    for i, column in enumerate(p.jacobian[0]):
        for channel, rows in column.items():
            columns[i, :, channel] = rows.values() / level[channel]
    return rig, case, columns.reshape(len(found), -1), tuple(n.key for n in found)


def _values(name: str, scale: float) -> dict[str, float]:
    rig, case, _, _ = _reference()
    effect, full = EFFECTS[name], SHAPES[name]
    if name.endswith('saturation'):
        model = rig.accelerometer.acc1
        force = (case.nominal.volts - model.offset) / model.gain
        signal = case.nominal.wrench[:, :3] if name.startswith('wrench') else force
        return {'limit': float(np.abs(signal).max()) + scale * full['limit']}
    sized = {q.name for q in effect.parameters if not q.shapes}
    free = [n for n in full if n in sized and n not in ('frequency', 'damping', 'width')]
    first = abs(full[free[0]])
    least = CERTAIN * getattr(rig.spreads, effect.nuisance) / first if effect.nuisance else 0.0
    return {k: v * (scale + least) if k in free else v for k, v in full.items()}


def _energies(name: str, scale: float) -> tuple[float, float]:
    rig, case, columns, keys = _reference()
    level = NOISE * noise_level(rig, case.measured.streams, 'acc1')

    def whitened(values: dict[str, float]) -> Array:
        signals = case.simulation.signals(with_effects(rig, {name: values}))
        both = case.measured.residual(signals) - case.measured.residual(case.nominal)
        return np.asarray((both / level).ravel())

    d, nuisance = whitened(_values(name, scale)), EFFECTS[name].nuisance
    raw = float(d @ d)
    if nuisance:
        d = d - whitened(_values(name, 0.0))
    rows = columns[[key != nuisance for key in keys]]
    product = rows @ d
    inner = rows @ rows.T + np.eye(len(rows))
    return raw, float(d @ d - product @ np.linalg.solve(inner, product))


def sized(name: str, energy: float) -> Sized:
    """Find the size of an effect at which its net energy is as given."""
    low, high = -4.0, 0.6
    for _ in range(14):
        middle = 0.5 * (low + high)
        enough = _energies(name, 10.0 ** middle)[1] > energy
        low, high = (low, middle) if enough else (middle, high)
    return Sized(_values(name, 10.0 ** low), *_energies(name, 10.0 ** low))
