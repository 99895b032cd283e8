"""A calibration is never wrong in silence: faulty runs, and whether each was refused or flagged.

    python benchmark/fault_calibration.py [--runs 10] [--first 0] [--fault TEXT] [--json FILE]

Every fault makes so many seeded runs, each of a rig of its own and of a strength drawn from two
or three orders of magnitude, down to what does no harm. ``refused``: no calibration. ``flagged``:
a warning. ``right``: nothing said, and no estimate is off by more than 5 of its standard errors.
``silent``: one is, and no warning names it; ``harmless``: so, but by less than what a standard
error is warned of. There is to be no silent one, and no crash.
"""

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
import json
import os
from pathlib import Path
import sys
from typing import NamedTuple
import warnings

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from calibration_runs import run, shifted
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings, Thresholds
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.geometry import rotation_from_vector, STANDARD_GRAVITY
from forcecal_ros.core.streams import Recording
from forcecal_ros.effects.library import chosen_effects
from forcecal_ros.sim.rig import faults
from forcecal_ros.sim.rig.file import true_calibration
from forcecal_ros.sim.rig.simulator import SIGNALS
from identification_coverage import draw, errors
import numpy as np

WORDS = ('refused', 'flagged', 'right', 'harmless', 'silent', 'crashed')

WORST = 5.0
"""An estimate that is off by more of its standard errors has to be called into question."""


def in_recording(recording: Recording, sensor: str, kind: str, start: float,
                 seed: int | None = None) -> Recording:
    """Return a recording in which one sensor became faulty at ``start`` [s]."""
    stream = getattr(recording, sensor)
    names = [name for name in ('values', 'position', 'R_base_sensor') if hasattr(stream, name)]
    fields = dict(zip(SIGNALS[sensor][1:], names))
    fault = faults.SensorFault(sensor, seed)
    parts = []
    for fault.kind, inside in (('none', stream.t < start), (kind, stream.t >= start)):
        block = {field: getattr(stream, name)[inside] for field, name in fields.items()}
        parts.append(fault.block(faults._Block(stream.t[inside], block)))
    t = np.concatenate([part.t for part in parts])
    values = {name: np.concatenate([part.fields[field] for part in parts])
              for field, name in fields.items()}
    return replace(recording, **{sensor: replace(stream, t=t, **values)})


class Scene(NamedTuple):
    """What a fault works on."""

    rig: object
    accelerometer: str
    rng: np.random.Generator
    seed: int
    truth: dict
    after: dict
    """What is true after something changed half-way, where that differs."""

    def simulated(self, rig=None):
        return run(rig or self.rig, seed=self.seed, accelerometer=self.accelerometer)

    def size(self, low, high):
        """Draw a strength, every order of magnitude alike, of either sign."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high)))
                     * self.rng.choice([-1.0, 1.0]))

    def direction(self):
        v = self.rng.normal(size=3)
        return v / np.linalg.norm(v)


def spans(recording, *words):
    return [(p.start, p.end) for p in recording.phases if p.name in words]


def half(recording, rng):
    """Return a time between the poses, in the middle of the recording."""
    starts = [start for start, _ in spans(recording, 'move')]
    return float(rng.choice(starts[1:]))


def with_values(recording, name, change):
    stream = getattr(recording, name)
    values = np.array(stream.values)
    values = change(stream.t, values)
    return replace(recording, **{name: replace(stream, values=values)})


# Forces that are none of the tool's ----------------------------------------------------------


def touched(scene, phase, low, high, whole=False):
    """Push at the tip, somewhere in one part of the sequence or all along it."""
    recording = scene.simulated()
    parts = spans(recording, phase)
    start, end = parts[scene.rng.integers(len(parts))]
    force = abs(scene.size(low, high)) * scene.direction()
    wrench = np.concatenate([force, np.cross([0.2, 0.0, 0.1], force)])
    length = end - start if whole else min(end - start, float(scene.rng.uniform(0.05, 0.5)))
    begin = start + scene.rng.uniform(0, end - start - length) if not whole else start

    def change(t, values):
        inside = (t >= begin) & (t < begin + length)
        bump = np.ones(inside.sum()) if whole else np.sin(np.pi * (t[inside] - begin) / length)
        values[inside] += bump[:, None] * wrench
        return values

    return with_values(recording, 'wrench', change)


def tool_changed(scene):
    rng = scene.rng
    tool = replace(scene.rig.tool, mass=scene.rig.tool.mass * (1 + scene.size(1e-3, 0.3)),
                   com=np.array(scene.rig.tool.com) + scene.size(1e-4, 0.03) * scene.direction())
    scene.after.update(mass=np.array(tool.mass), com=tool.com)
    before, after = scene.simulated(), scene.simulated(replace(scene.rig, tool=tool))
    at = half(before, rng)
    for name in ('wrench', 'accelerometer', 'optidrive'):
        one, other = getattr(before, name), getattr(after, name)
        values = np.where((one.t < at)[:, None], one.values, other.values)
        before = replace(before, **{name: replace(one, values=values)})
    return before


def with_effect(scene, name, *values):
    """Simulate the rig with an effect of the library."""
    effects = {name: dict(values)}
    return scene.simulated(replace(scene.rig, effects=chosen_effects(effects)))


def filtered(scene):
    """Filter the wrench: to the accelerometer it is late, by no single delay."""
    scene.truth['accelerometer.delay'] = np.nan
    return with_effect(scene, 'wrench_lowpass', ('time_constant', abs(scene.size(1e-3, 0.05))))


def on_a_spring(scene):
    """Mount the accelerometer on a spring that rings: late by twice its damping over its rate."""
    frequency, damping = float(scene.rng.uniform(15, 120)), 0.05
    scene.truth['accelerometer.delay'] = damping / (np.pi * frequency)
    return with_effect(scene, 'accel_resonance', ('amplitude', 1.0), ('frequency', frequency),
                       ('damping', damping))


# The wrench sensor --------------------------------------------------------------------------


def changed(scene, name, change, **options):
    recording = scene.simulated()
    return with_values(recording, name, partial(change, scene, recording, **options))


def clip(scene, recording, t, values):
    i = scene.rng.integers(values.shape[1])
    low, high = values[:, i].min(), values[:, i].max()
    limit = low + scene.rng.uniform(0.3, 0.98) * (high - low)
    values[:, i] = np.minimum(values[:, i], limit)
    return values


def swap(scene, recording, t, values):
    i, j = scene.rng.permutation(3)[:2] + 3 * scene.rng.integers(2)
    values[:, [i, j]] = values[:, [j, i]]
    return values


def flip(scene, recording, t, values):
    values[:, scene.rng.integers(values.shape[1])] *= -1
    return values


def stick(scene, recording, t, values):
    i, at = scene.rng.integers(values.shape[1]), half(recording, scene.rng)
    late = t >= at
    values[late, i] = values[np.argmax(late), i]
    return values


def dead(scene, recording, t, values):
    values[:, scene.rng.integers(values.shape[1])] = scene.rng.choice([0.0, 1.0])
    return values


def wander(scene, recording, t, values, low, high):
    i = scene.rng.integers(values.shape[1])
    scale = 1.0 if i < 3 else 0.1
    values[:, i] += scene.size(low, high) * scale * t
    return values


def tare(scene, recording, t, values, low, high):
    late = t >= half(recording, scene.rng)
    key = 'wrench_bias' if values.shape[1] == 6 else 'accelerometer.offset'
    jump = scene.size(low, high) * scene.rng.normal(size=values.shape[1]) * (
        np.repeat([1.0, 0.1], 3) if key == 'wrench_bias' else 1.0)
    scene.after[key] = scene.truth[key] + jump
    values[late] += jump
    return values


def misgain(scene, recording, t, values):
    values[:, scene.rng.integers(values.shape[1])] *= 1 + scene.size(1e-3, 0.2)
    return values


def regain(scene, recording, t, values):
    late, factor = t >= half(recording, scene.rng), 1 + scene.size(1e-3, 0.2)
    for key in (('mass', 'wrench_bias') if values.shape[1] == 6
                else ('accelerometer.offset', 'accelerometer.gain')):
        scene.after[key] = scene.truth[key] * factor
    values[late] *= factor
    return values


def crosstalk(scene, recording, t, values):
    i, j = scene.rng.permutation(values.shape[1])[:2]
    values[:, i] += scene.size(1e-3, 0.2) * values[:, j]
    return values


def spikes(scene, recording, t, values):
    hit = scene.rng.random(len(t)) < 10 ** scene.rng.uniform(-3.5, -1.5)
    values[hit] += scene.size(5, 500) * scene.rng.normal(size=(hit.sum(), values.shape[1]))
    return values


# Time -----------------------------------------------------------------------------------------


def halved(scene, name):
    recording = scene.simulated()
    stream = getattr(recording, name)
    return replace(recording, **{
        name: replace(stream, t=stream.t[::2], values=stream.values[::2])})


def stretched(scene, name):
    """Stamp by a clock that runs at another rate."""
    recording = scene.simulated()
    stream = getattr(recording, name)
    factor = float(scene.rng.choice([2.0, 0.5, 1.05, 1.01, 1.002]))
    return replace(recording, **{name: replace(stream, t=stream.t * factor)})


def late(scene, name):
    """Let one sensor's stamps be off by more than is looked for."""
    recording, delay = scene.simulated(), scene.size(0.022, 0.3)
    scene.truth['accelerometer.delay'] = {'accelerometer': delay, 'wrench': -delay}.get(name, 0.0)
    return replace(recording, **{name: shifted(getattr(recording, name), delay)})


def faulty(scene, sensor, kind):
    """Let the sensor itself be faulty from some time on."""
    recording = scene.simulated()
    start = float(scene.rng.uniform(0.0, 0.9) * recording.wrench.t[-1])
    if (sensor, kind) == ('accelerometer', 'wrong'):
        key = 'accelerometer.offset'
        scene.after[key] = scene.truth[key] + faults.OFFSETS['volts']
    return in_recording(recording, sensor, kind, start, scene.seed)


# Accelerometer, pose, Optidrive -------------------------------------------------------------


def remounted(scene, recording, t, values):
    """Let the mount slip: the axes turn half-way."""
    model = getattr(scene.rig.accelerometer, scene.accelerometer)
    late = t >= half(recording, scene.rng)
    R = rotation_from_vector(scene.size(1e-3, 0.5) * scene.direction())
    scene.after['accelerometer.map'] = R
    felt = (values[late] - model.offset) / model.gain
    values[late] = felt @ R.T * model.gain + model.offset
    return values


def turned_pose(scene, left, low=0.003, high=1.5):
    """Tell the poses in a base that is tilted, or of a frame that is not the sensor's."""
    recording = scene.simulated()
    axis = scene.direction()
    if left:
        axis = np.append(axis[:2] / np.linalg.norm(axis[:2]), 0.0)
    R = rotation_from_vector(abs(scene.size(low, high)) * axis)
    return with_orientations(recording, lambda told: R @ told if left else told @ R)


def with_orientations(recording, change):
    return replace(recording, **{
        name: replace(stream, R_base_sensor=change(stream.R_base_sensor))
        for name, stream in (('pose', recording.pose), ('target', recording.target))})


def pose_late(scene):
    recording = scene.simulated()
    pose = recording.pose
    return replace(recording, pose=replace(pose, t=pose.t + scene.size(0.022, 0.3)))


def pose_slips(scene):
    """Let one joint's encoder lose its zero half-way."""
    recording = scene.simulated()
    pose, R = recording.pose, rotation_from_vector(scene.size(3e-4, 0.3) * scene.direction())
    late = pose.t >= half(recording, scene.rng)
    turned = np.where(late[:, None, None], pose.R_base_sensor @ R, pose.R_base_sensor)
    return replace(recording, pose=replace(pose, R_base_sensor=turned))


def pose_axes(scene):
    """Tell orientations transposed."""
    return with_orientations(scene.simulated(), lambda told: np.swapaxes(told, 1, 2))


@dataclass(frozen=True)
class Fault:
    """
    Something that is wrong with a run.

    Attributes
    ----------
    make : callable
        Takes a Scene, returns the Recording.
    accelerometer : str
        ``acc1``, ``acc2`` or empty: either.
    coupling : str
        What is declared; empty: what is so.
    """

    make: Callable[[Scene], Recording]
    accelerometer: str = ''
    coupling: str = ''


def _changed(name, change, mounted='', **options):
    return Fault(partial(changed, name=name, change=change, **options), mounted)


FAULTS = {
    'none': Fault(lambda scene: scene.simulated()),
    'collision while measuring': Fault(partial(touched, phase='measure', low=0.3, high=100)),
    'collision on the way': Fault(partial(touched, phase='move', low=3, high=200)),
    'collision in the step': Fault(partial(touched, phase='step', low=1, high=100)),
    'contact in one pose': Fault(partial(touched, phase='measure', low=0.05, high=50,
                                         whole=True)),
    'tool changed half-way': Fault(tool_changed),
    'cable that pulls': Fault(lambda s: with_effect(
        s, 'cable_force', ('stiffness', abs(s.size(1, 300))), ('point_z', 0.3),
        *((axis, s.size(0.1, 20)) for axis in 'xyz'))),
    'tool friction': Fault(lambda s: with_effect(s, 'tool_friction',
                                                 ('force', abs(s.size(0.3, 30))))),
    'wrench saturates': _changed('wrench', clip),
    'wrench axes swapped': _changed('wrench', swap),
    'wrench axis of wrong sign': _changed('wrench', flip),
    'wrench of wrong sign': _changed('wrench', lambda s, r, t, v: -v),
    'wrench channel stuck half-way': _changed('wrench', stick),
    'wrench channel dead': _changed('wrench', dead),
    'wrench drifts': _changed('wrench', wander, low=1e-3, high=3),
    'wrench tared half-way': _changed('wrench', tare, low=0.02, high=10),
    'wrench axis of wrong gain': _changed('wrench', misgain),
    'wrench gain changes half-way': _changed('wrench', regain),
    'wrench crosstalk': _changed('wrench', crosstalk),
    'wrench spikes': _changed('wrench', spikes),
    'wrench hysteresis': Fault(lambda s: with_effect(
        s, 'wrench_hysteresis', ('height', abs(s.size(0.05, 5))), ('width', 20.0))),
    'wrench filtered': Fault(filtered),
    'wrench at half the rate': Fault(partial(halved, name='wrench')),
    'wrench of another clock': Fault(partial(stretched, name='wrench')),
    'wrench late': Fault(partial(late, name='wrench')),
    **{f'wrench {kind}': Fault(partial(faulty, sensor='wrench', kind=kind))
       for kind in ('off', 'stuck', 'garbage', 'wrong', 'slow', 'intermittent')},
    'ac accelerometer declared dc': Fault(lambda s: s.simulated(), 'acc2', 'dc'),
    'dc accelerometer declared ac': Fault(lambda s: s.simulated(), 'acc1', 'ac'),
    'accelerometer saturates': _changed('accelerometer', clip),
    'accelerometer axis stuck half-way': _changed('accelerometer', stick),
    'accelerometer axis dead': _changed('accelerometer', dead),
    'accelerometer drifts': _changed('accelerometer', wander, 'acc1', low=1e-4, high=0.3),
    'accelerometer jumps half-way': _changed('accelerometer', tare, low=2e-3, high=1),
    'accelerometer slips half-way': _changed('accelerometer', remounted),
    'accelerometer gain changes half-way': _changed('accelerometer', regain),
    'accelerometer spikes': _changed('accelerometer', spikes),
    'accelerometer on a spring': Fault(on_a_spring),
    'accelerometer at half the rate': Fault(partial(halved, name='accelerometer')),
    'accelerometer of another clock': Fault(partial(stretched, name='accelerometer')),
    'accelerometer late': Fault(partial(late, name='accelerometer')),
    **{f'accelerometer {kind}': Fault(partial(faulty, sensor='accelerometer', kind=kind))
       for kind in ('off', 'stuck', 'garbage', 'wrong', 'slow', 'intermittent')},
    'gravity not down': Fault(partial(turned_pose, left=True)),
    'pose of another frame': Fault(partial(turned_pose, left=False)),
    'pose late': Fault(pose_late),
    'pose slips half-way': Fault(pose_slips),
    'pose transposed': Fault(pose_axes),
    **{f'pose {kind}': Fault(partial(faulty, sensor='pose', kind=kind))
       for kind in ('off', 'stuck', 'garbage', 'slow', 'intermittent')},
    'optidrive of wrong sign': _changed('optidrive', lambda s, r, t, v: -v),
    'optidrive in millimetres': _changed('optidrive', lambda s, r, t, v: 1e3 * v),
    'optidrive stuck half-way': _changed('optidrive', stick),
    'optidrive late': Fault(partial(late, name='optidrive')),
    **{f'optidrive {kind}': Fault(partial(faulty, sensor='optidrive', kind=kind))
       for kind in ('off', 'stuck', 'garbage', 'wrong', 'slow', 'intermittent')},
}
"""What can be wrong with a run; ``none`` counts false alarms."""


@dataclass(frozen=True)
class Verdict:
    """
    What became of one run.

    Attributes
    ----------
    fault : str
    seed : int
    word : str
        ``refused``, ``flagged``, ``right`` (nothing said, nothing wrong), ``harmless`` (off by
        less than what is called into question where a standard error is as large), ``silent``
        (wrong and not said of that estimate), ``crashed``.
    worst : str
        The estimate that is farthest off among those not called into question.
    sigmas : float
        By how many of its standard errors.
    said : tuple of str
        Warnings, or the refusal.
    """

    fault: str
    seed: int
    word: str
    worst: str = ''
    sigmas: float = 0.0
    said: tuple[str, ...] = ()


def truth_of(rig, name):
    return true_calibration(rig, name) | {
        'accelerometer.position': np.array(rig.accelerometer.position),
        'accelerometer.cutoff': np.array(getattr(rig.accelerometer, name).highpass)}


def of_account(key, truth):
    """By how much an estimate may be off until a standard error of that size is warned of."""
    limits, gain = Thresholds(), np.abs(truth['accelerometer.gain']).max()
    return next(limit for name, limit in {
        'mass': limits.mass * truth['mass'], 'com': limits.com,
        'wrench_bias.force': limits.force_bias, 'wrench_bias.torque': limits.torque_bias,
        'inertia': limits.inertia * np.abs(truth['inertia']).max(),
        'accelerometer.offset': limits.offset * gain, 'accelerometer.gain': limits.gain * gain,
        'accelerometer.map': limits.offset / STANDARD_GRAVITY,
        'accelerometer.delay': limits.delay, 'accelerometer.position': limits.position,
        'accelerometer.cutoff': 0.0, 'tool.stiffness': limits.stiffness * truth['tool.stiffness'],
        'tool.damping': limits.damping * truth['tool.damping']}.items() if key.startswith(name))


def farthest(found, truth, suspect):
    """
    Return the worst of the estimates not suspect: off by how many standard errors, and which.

    The last of the three says whether any that is too far off is off by what is of account.
    """
    off = [(abs(error / std) if std > 0 else (np.inf if error else 0.0), key,
            abs(error) > of_account(key, truth))
           for key, error, std in errors(found, truth) if np.isfinite(error)
           and not any(key.startswith(estimate) for estimate in suspect)]
    sigmas, worst, _ = max(off, default=(0.0, '', False))
    return sigmas, worst, any(matters for z, _, matters in off if z > WORST)


def judged(name, seed):
    """Carry out one faulty run and say what became of it."""
    fault, rng = FAULTS[name], np.random.default_rng([seed, 5, *name.encode()])
    rig, accelerometer = draw(rng)
    accelerometer = fault.accelerometer or accelerometer
    truth, after = truth_of(rig, accelerometer), {}
    recording = fault.make(Scene(rig, accelerometer, rng, seed, truth, after))
    coupling = fault.coupling or ('ac' if accelerometer == 'acc2' else 'dc')
    try:
        found = identify(recording, IdentificationSettings(coupling=coupling))
    except ForcecalError as error:
        return Verdict(name, seed, 'refused', said=(str(error),))
    except Exception as error:
        return Verdict(name, seed, 'crashed', said=(f'{type(error).__name__}: {error}',))
    warnings, suspect = tuple(found.quality['warnings']), set(found.quality.get('suspect', ()))
    sigmas, worst, matters = min(farthest(found, truth, suspect),
                                 farthest(found, {**truth, **after}, suspect))
    word = ('flagged' if warnings else 'right') if sigmas <= WORST else (
        'silent' if matters else 'harmless')
    return Verdict(name, seed, word, worst, float(sigmas), warnings)


def table(verdicts: list[Verdict]) -> str:
    """Return the matrix fault x verdict as Markdown."""
    rows = ['| fault | ' + ' | '.join(WORDS) + ' | worst that was not called into question |',
            '|---|' + '---|' * (len(WORDS) + 1)]
    for fault in FAULTS:
        found = [verdict for verdict in verdicts if verdict.fault == fault]
        if found:
            count = Counter(verdict.word for verdict in found)
            worst = max(found, key=lambda verdict: verdict.sigmas)
            rows.append(f'| {fault} | ' + ' | '.join(str(count[word] or '') for word in WORDS)
                        + (f' | {worst.sigmas:.1f} sigma, {worst.worst} |' if worst.worst
                           else ' | |'))
    return '\n'.join(rows)


def main() -> int:
    """Print the matrix."""
    parser = argparse.ArgumentParser(description='faulty calibration runs')
    parser.add_argument('--runs', type=int, default=10, help='of each fault')
    parser.add_argument('--first', type=int, default=0, help='first seed')
    parser.add_argument('--fault', default='', help='only faults with this in their name')
    parser.add_argument('--json', metavar='FILE')
    args = parser.parse_args()
    warnings.simplefilter('ignore')
    verdicts = []
    for fault in FAULTS:
        if args.fault in fault:
            verdicts += [judged(fault, seed)
                         for seed in range(args.first, args.first + args.runs)]
            print(fault, file=sys.stderr, flush=True)
    print(table(verdicts))
    faulty = [verdict for verdict in verdicts if verdict.fault != 'none']
    count = Counter(verdict.word for verdict in faulty)
    print(f'\n{len(faulty)} faulty runs: '
          + ', '.join(f'{count[word]} {word}' for word in WORDS))
    for verdict in verdicts:
        if verdict.word in ('silent', 'crashed'):
            print(verdict)
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(v) for v in verdicts], indent=1))
    return 1 if count['silent'] or count['crashed'] else 0


if __name__ == '__main__':
    raise SystemExit(main())
