"""Development cases of the posterior: what the search finds, cached a line a case.

Each effect of the library alone on the simulated rig along 13 s of motion, at full size and at a
fifth; recordings without effect; both with disturbances that no library has. The cache holds the
features of the best explanation of each step, so that
``calibrate_probabilities.py`` and ``ablation.py`` judge decision rules in seconds.
"""

import argparse
from dataclasses import replace
import json
from pathlib import Path
import sys
import time
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import diagnose_cases as cases
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose import engine
from forcecal_ros.diagnose.search import posterior
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from scipy.signal import lfilter

FIFTH = 0.2
LARGEST = {'wrench_saturation': 234.2, 'accel_saturation': 17.39}
"""What these sensors show at most along the motion [N], [m/s^2]."""

DISTURBANCES = ('curved', 'drag', 'sway')


def short_motion(variant: int = 0):
    """Return poses, a step, a sweep to 6 Hz, a slow swing and a contact, in 13 s."""
    path = cases._Path(variant)
    path.hold('measure', 0.5)
    for _ in range(2):
        path.go('move', path.home + path.random.uniform(-0.05, 0.05, 3),
                path.random.uniform(-0.9, 0.9, 3), 1.0)
        path.hold('measure', 0.7)
    path.go('move', path.home, np.zeros(3), 1.0)
    for x in (0.01, 0.0):
        path.go('step', path.home + [x, 0.0, 0.0], np.zeros(3), 0.1)
        path.hold('step', 0.4)
    path.wave('sweep', (0.006, 0.005, 0.005), (0.5, 6.0), 2.5, 0.05)
    path.wave('reverse', (0.03, 0.02, 0.02), (0.35, 0.35), 2.0, 0.0)
    path.go('approach', path.home + [0.079, 0.0, 0.0], np.zeros(3), 0.7)
    path.go('contact', path.home + [0.086, 0.0, 0.0], np.zeros(3), 0.3)
    path.wave('contact', (0.002, 0.0, 0.0), (1.0, 3.0), 1.0, 0.0)
    path.go('retract', path.home, np.zeros(3), 0.7)
    return path.commands()


def effect_values(name: str, size: float) -> dict[str, float]:
    """Return an effect's parameters at a size, 1 being the full one of ``diagnose_cases``."""
    full, effect = cases.SHAPES[name], EFFECTS[name]
    if name in LARGEST:
        return {'limit': LARGEST[name] + size * full['limit']}
    sized = {q.name for q in effect.parameters if not q.shapes} - {'frequency', 'width'}
    first = abs(next(v for k, v in full.items() if k in sized))
    least = (cases.CERTAIN * getattr(load_rig().spreads, effect.nuisance) / first
             if effect.nuisance else 0.0)
    return {k: v * (size + least) if k in sized else v for k, v in full.items()}


def disturbed(recording: Recording, kind: str, seed: int) -> Recording:
    """Add a disturbance that no library has to a wrench."""
    rng, w = np.random.default_rng([seed, 5]), recording.wrench
    values, signal = w.values.copy(), w.values - w.values.mean(axis=0)
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    force = signal[:, :3]
    if kind == 'curved':
        more = np.outer((force @ direction) ** 2 / 100.0, rng.standard_normal(3))
    elif kind == 'drag':
        velocity = np.gradient(np.stack([np.interp(w.t, recording.target.t, p) for p in
                                         recording.target.position.T], 1), w.t, axis=0)
        more = 150.0 * velocity * np.linalg.norm(velocity, axis=1, keepdims=True)
    else:
        pole = 0.995 * np.exp(2j * np.pi * 4.0 * 1e-3)
        mode = lfilter([(1 - abs(pole)) * 0.05], [1.0, -2 * pole.real, abs(pole) ** 2],
                       force @ direction)
        more = np.outer(mode, 3.0 * rng.standard_normal(3))
    size = 10.0 ** rng.uniform(-0.7, 0.3)  # RMS [N]
    values[:, :3] += more * size / np.sqrt(np.mean(more ** 2))
    return replace(recording, wrench=replace(w, values=values))


def make(case: dict[str, Any]) -> Recording:
    """Simulate a case."""
    name, seed = case['name'], case['seed']
    effects = {name: case.get('values') or effect_values(name, case['size'])} if name else {}
    if case.get('nominal'):
        real = with_effects(load_rig(), effects)
    else:
        real = cases.real_rig(seed, effects)
    target, phases = short_motion(case.get('variant', 0))
    recorded = simulate(real, target, seed=2 * seed + 1000, steps=16)
    recorded = replace(recorded, phases=phases, contact_truth=None)
    for i, kind in enumerate(case.get('beside', ())):
        recorded = disturbed(recorded, kind, seed + i)
    return recorded


def plan() -> list[dict[str, Any]]:
    """List the cases, those that failed before first."""
    out = [{'name': n, 'size': 1.0, 'seed': 1, 'nominal': True, 'values': v} for n, v in (
        ('wrench_crosstalk', {'fx_of_fz': 0.03}),
        ('robot_resonance', {'gain': 0.2, 'frequency': 9.0, 'damping': 0.06}),
        ('accel_saturation', {'limit': 16.39}),
        ('accel_resonance', {'amplitude': 1.0, 'frequency': 60.0, 'damping': 0.1}))]
    names = [n for n in cases.SHAPES if n not in cases.OF_STAMPS_AND_VALUES]
    mixed = np.random.default_rng(3).permutation(names).tolist()
    out += [{'name': '', 'size': 0.0, 'seed': 201 + i} for i in range(2)]
    out += [{'name': '', 'size': 0.0, 'seed': 301 + i, 'beside': [k]}
            for i, k in enumerate(DISTURBANCES)]
    out += [{'name': n, 'size': 1.0, 'seed': 2 + i} for i, n in enumerate(mixed)]
    out += [{'name': n, 'size': FIFTH, 'seed': 101 + i} for i, n in enumerate(mixed)]
    out += [{'name': n, 'size': 1.0, 'seed': 401 + i, 'beside': [DISTURBANCES[i % 3]]}
            for i, n in enumerate(mixed)]
    out += [{'name': '', 'size': 0.0, 'seed': 501 + i, 'beside': [k, DISTURBANCES[(i + 1) % 3]]}
            for i, k in enumerate(DISTURBANCES * 2)]
    return out


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a case; keep each step of the search."""
    recording, steps, timing = make(case), [], {}
    inner = posterior.features_of

    def watched(full, less):
        f = inner(full, less)
        added, = full.names - less.names
        steps.append({'added': added, 'names': sorted(full.names), **f._asdict()})
        return f

    posterior.features_of = watched
    module: Any = engine
    searched = module.search

    def timed(*args):
        began = time.process_time()
        out = searched(*args)
        timing['search'] = time.process_time() - began
        return out

    module.search = timed
    try:
        began = time.process_time()
        outcome = RigSource(load_rig()).diagnose(recording).outcome
        d = outcome.diagnosis
    finally:
        posterior.features_of, module.search = inner, searched
    return case | {'steps': steps, 'verdict': d.verdict, 'named': [e.name for e in d.effects],
                   'candidates': list(d.candidates), 'reason': d.reason,
                   'closed': d.gap.closed if d.gap else None,
                   'seconds': time.process_time() - began, **timing}


def main() -> None:
    """Run what is not cached yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('-o', '--out', type=Path, default=Path('posterior_cases.jsonl'))
    parser.add_argument('--part', type=int, nargs=2, default=(0, 1), help='I of N')
    parser.add_argument('--seconds', type=float, default=500.0)
    arguments = parser.parse_args()
    done = [json.loads(line) for line in arguments.out.read_text().splitlines()] \
        if arguments.out.exists() else []
    began = time.time()
    for case in plan()[arguments.part[0]::arguments.part[1]]:
        if any(case.items() <= one.items() for one in done):
            continue
        if time.time() - began > arguments.seconds:
            break
        try:
            result = run(case)
        except Exception as error:
            import traceback
            traceback.print_exc()
            result = case | {'error': repr(error)}
            print(case['name'], error, file=sys.stderr)
            continue
        with arguments.out.open('a') as file:
            file.write(json.dumps(result) + '\n')
        print(case['name'] or 'none', case['size'], case.get('beside', ''), '->',
              result['verdict'], result['named'],
              [(s['added'], round(s['gain']), round(s['missing']))
               for s in result['steps']][:4], round(result.get('search', 0), 1),
              round(result['seconds'], 1), flush=True)


if __name__ == '__main__':
    main()
