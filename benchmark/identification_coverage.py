"""Do the intervals hold? Seeded calibration runs with redrawn truths, estimates against truth.

    python benchmark/identification_coverage.py [--runs 400] [--first 0] [-o RUNS] [--json FILE]

With ``-o`` each run is kept (a line of JSON), and an interrupted benchmark goes on there.

Every run draws its own mass, centre of mass, inertia, biases, spring, damper, accelerometer
(gains, offsets, a misaligned map, DC or AC-coupled, cutoff), noise levels, how long it settles
before it measures, and up to 10 ms between the sensors, either of which may be the late one.
Each parameter counts how often the truth lies within 1 and within 1.96 standard errors; pooled
these are to be 68.3 and 95 % within two points, and no parameter is to lie outside its binomial
bounds at 99.9 %. Coverage sees neither a bias of half a standard error nor a few estimates that
are far off, so the mean of each parameter's errors in standard errors is tested, too, and how
many lie beyond 3 and 4, both such that sound intervals fail somewhere once in a hundred times.
Standard errors are estimates: noise is measured on the blocks at rest of each recording, so that
errors over them follow Student's t, whose tails are a little heavier than Gauss's.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
import json
import os
from pathlib import Path
import sys
from typing import Any

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
sys.path[:0] = [str(Path(__file__).parent),
                str(Path(__file__).resolve().parents[1] / 'test' / 'helpers')]

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array, rotation_from_vector
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.effects.rig import Rig
from forcecal_ros.report.rows import table
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
from resumable import Case, resumed
from scipy.stats import binom, t

Truth = dict[str, Array]
SETTLE = (0.3, 1.0)
"""Time between motion and measuring, in which the sequencer is satisfied: the tool still rings
[s]."""

FAR = (3.0, 4.0)
DEGREES = 141
"""Of the noise: 145 to 147 blocks of 20 ms in the poses, less the means of four."""

ONCE = 0.01
"""How often all parameters together may be called biased, or heavy-tailed, by chance."""
LEVELS = {'68': (1.0, 0.6827), '95': (1.959964, 0.95)}


def draw(rng: np.random.Generator) -> tuple[Rig, str]:
    """Return a rig that departs from the nominal one, and which accelerometer it carries."""
    rig = load_rig()
    level = np.exp(rng.uniform(-np.log(2), np.log(2), 3))
    inertia = np.array(rig.tool.inertia) * np.diag(rng.normal(1, 0.05, 3))
    inertia[np.triu_indices(3, 1)] = rng.normal(0, 0.005, 3)
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    name = str(rng.choice(['acc1', 'acc2']))
    model = getattr(rig.accelerometer, name)
    model = replace(
        model, gain=np.array(model.gain) * rng.normal(1, 0.01, 3),
        offset=np.array(model.offset) + rng.normal(0, 0.1, 3),
        highpass=model.highpass * float(np.exp(rng.uniform(-0.5, 0.5))))
    return replace(
        rig,
        tool=replace(rig.tool, mass=13.0 * rng.normal(1, 0.05), inertia=inertia,
                     com=np.array(rig.tool.com) + rng.normal(0, 0.005, 3)),
        optidrive=replace(rig.optidrive, stiffness=5000 * rng.normal(1, 0.05),
                          damping=130 * rng.normal(1, 0.1), noise=20e-6 * level[0]),
        wrench_sensor=replace(
            rig.wrench_sensor, force_noise=0.25 * level[1], torque_noise=0.02 * level[1],
            bias=np.array(rig.wrench_sensor.bias)
            + rng.normal(0, [3, 3, 3, 0.2, 0.2, 0.2])),
        accelerometer=replace(
            rig.accelerometer, noise=0.01 * level[2], **{name: model},
            position=np.array(rig.accelerometer.position) + rng.normal(0, 0.01, 3)),
    ), name


def misalign(recording: Recording, rig: Rig, name: str, rng: np.random.Generator
             ) -> tuple[Recording, Array]:
    """Turn the accelerometer's axes; return what it would have shown, and its map."""
    model = getattr(rig.accelerometer, name)
    gain, offset = np.array(model.gain), np.array(model.offset)
    R = rotation_from_vector(rng.normal(0, 0.02, 3)) + rng.normal(0, 0.005, (3, 3))
    R /= np.linalg.norm(R, axis=1, keepdims=True)
    assert recording.accelerometer is not None
    felt = (recording.accelerometer.values - offset) / gain
    values = offset + gain * (felt @ R.T)
    return replace(recording, accelerometer=Stream(recording.accelerometer.t, values)), R


def one_run(seed: int) -> tuple[Calibration, Truth]:
    """Simulate and identify one run; return the result and the truth."""
    rng = np.random.default_rng([seed, 2005])
    rig, name = draw(rng)
    delay = float(rng.uniform(-0.01, 0.01))
    settle = float(np.random.default_rng([seed, 16]).uniform(*SETTLE))
    recording = run(rig, seed=seed, accelerometer=name, delay=delay, settle=settle)
    recording, R = misalign(recording, rig, name, rng)
    coupling = 'ac' if name == 'acc2' else 'dc'
    model = getattr(rig.accelerometer, name)
    truth = {
        'mass': rig.tool.mass, 'com': rig.tool.com, 'wrench_bias': rig.wrench_sensor.bias,
        'inertia': rig.tool.inertia, 'accelerometer.offset': model.offset,
        'accelerometer.gain': model.gain, 'accelerometer.map': R, 'accelerometer.delay': delay,
        'accelerometer.position': rig.accelerometer.position,
        'accelerometer.cutoff': model.highpass,
        'tool.stiffness': rig.optidrive.stiffness, 'tool.damping': rig.optidrive.damping}
    return (identify(recording, IdentificationSettings(coupling=coupling)),
            {key: np.asarray(value, dtype=float) for key, value in truth.items()})


def errors(calibration: Calibration, truth: Truth) -> Iterator[tuple[str, float, float]]:
    """Yield name, error and standard error of every estimate, each inertia element once."""
    for row in table(calibration, truth):
        if row.key in ('inertia.yx', 'inertia.zx', 'inertia.zy') or row.truth is None:
            continue
        yield row.key, row.value - row.truth, row.std
    a = calibration.accelerometer
    assert a is not None
    for name, estimate in (('position', a.position), ('cutoff', a.cutoff)):
        if estimate is not None:
            for i, (value, std) in enumerate(zip(estimate.value.ravel(), estimate.std.ravel())):
                yield (f'accelerometer.{name}.{i}',
                       value - truth[f'accelerometer.{name}'].ravel()[i], std)


def biased(z: Array, parameters: int) -> bool:
    """Say whether the mean of errors in standard errors is not 0, one of so many parameters."""
    mean_std = float(z.std(ddof=1)) / np.sqrt(len(z))
    return bool(abs(z.mean()) > t.isf(ONCE / 2 / parameters, len(z) - 1) * mean_std)


def heavy(z: Array, parameters: int = 1) -> dict[str, int]:
    """Return how many errors lie beyond 3 and 4 standard errors, where these are too many."""
    return {f'beyond {k:g}': far for k in FAR if (far := int((np.abs(z) > k).sum()))
            > binom.isf(ONCE / len(FAR) / parameters, len(z), 2 * t.sf(k, DEGREES))}


def judge(found: dict[str, list[tuple[float, float]]]) -> dict[str, Any]:
    """Count how often the truth lay inside, by parameter and pooled."""
    rows, pooled = {}, {level: [0, 0] for level in LEVELS}
    for key, pairs in sorted(found.items()):
        error, std = np.array(pairs).T
        row: dict[str, Any] = {'n': len(error), 'rms_sigmas': float(np.sqrt(
            np.mean((error / std)**2))), 'rms_error': float(np.sqrt(np.mean(error**2))),
            'mean_sigmas': float(np.mean(error / std)),
            'most_sigmas': float(np.abs(error / std).max()),
            'biased': biased(error / std, len(found)), 'heavy': heavy(error / std, len(found))}
        for level, (width, nominal) in LEVELS.items():
            inside = int((np.abs(error) <= width * std).sum())
            low, high = binom.interval(0.999, len(error), nominal)
            row[level] = inside / len(error)
            row[f'{level}_ok'] = bool(low <= inside <= high)
            pooled[level][0] += inside
            pooled[level][1] += len(error)
        rows[key] = row
    return {'pooled': {level: inside / n for level, (inside, n) in pooled.items()},
            'outside': [key for key, row in rows.items()
                        if not (row['68_ok'] and row['95_ok'])],
            'biased': [key for key, row in rows.items() if row['biased']],
            'heavy': {key: row['heavy'] for key, row in rows.items() if row['heavy']},
            'far': {f'beyond {k:g}': [
                sum(int((np.abs(np.divide(*np.array(pairs).T)) > k).sum())
                    for pairs in found.values()),
                2 * float(t.sf(k, DEGREES)) * sum(map(len, found.values()))] for k in FAR},
            'parameters': rows}


def coverage(runs: int, first: int = 0, show: Any = None) -> dict[str, Any]:
    """Carry out the runs and judge them."""
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(first, first + runs):
        for key, error, std in errors(*one_run(seed)):
            found.setdefault(key, []).append((error, std))
        if show:
            show(seed)
    return judge(found)


def case(wanted: Case) -> Case:
    """Carry out one run, to be kept."""
    return {**wanted, 'errors': list(errors(*one_run(wanted['seed'])))}


def kept(runs: int, first: int, out: Path) -> dict[str, Any]:
    """Judge runs of which a file holds those that were carried out before."""
    wanted = [{'seed': seed} for seed in range(first, first + runs)]
    done = resumed(case, wanted, out, 1, lambda one, other: one['seed'] == other['seed'])
    found: dict[str, list[tuple[float, float]]] = {}
    for one in done:
        for key, error, std in one['errors'] if first <= one['seed'] < first + runs else ():
            found.setdefault(key, []).append((error, std))
    return judge(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="coverage of the identification's intervals")
    parser.add_argument('--runs', type=int, default=400)
    parser.add_argument('--first', type=int, default=0, help='first seed')
    parser.add_argument('-o', '--out', metavar='RUNS', type=Path, help='keep the runs here')
    parser.add_argument('--json', metavar='FILE')
    args = parser.parse_args()
    result = kept(args.runs, args.first, args.out) if args.out else coverage(
        args.runs, args.first, lambda seed: print(f'\rrun {seed}', end='', file=sys.stderr,
                                                  flush=True) if sys.stderr.isatty() else None)
    print(f'{"parameter":30s} {"n":>4s} {"68 %":>6s} {"95 %":>6s} {"rms z":>6s} {"mean z":>6s} '
          f'{"most":>5s} {"rms error":>10s}')
    for key, row in result['parameters'].items():
        flag = '' if key not in result['outside'] else '  outside'
        print(f'{key:30s} {row["n"]:4d} {row["68"]:6.3f} {row["95"]:6.3f} '
              f'{row["rms_sigmas"]:6.2f} {row["mean_sigmas"]:+6.2f} '
              f'{row["most_sigmas"]:5.1f} {row["rms_error"]:10.3g}'
              f'{flag}')
    print(f'pooled: {result["pooled"]["68"]:.4f} within 68.3 %, '
          f'{result["pooled"]["95"]:.4f} within 95 %; '
          f'outside the binomial bounds: {", ".join(result["outside"]) or "none"}')
    print(f'mean not 0: {", ".join(result["biased"]) or "none"}; too many far off: '
          f'{result["heavy"] or "none"}')
    for name, (far, expected) in result['far'].items():
        print(f'{name} standard errors: {far}, expected {expected:.1f}')
    if args.json:
        Path(args.json).write_text(json.dumps(result, indent=1))


if __name__ == '__main__':
    main()
