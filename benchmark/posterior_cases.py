"""Development cases of the posterior: what the search finds, cached a line a case.

    python benchmark/posterior_cases.py -o cases.jsonl [--part 0 2]
    python benchmark/posterior_cases.py -o opened.jsonl --opened 2 3 [--part 0 2]

Each effect of the library alone on the simulated rig along 13 s of motion, at full size and at a
fifth; pairs of them; recordings without effect; some with disturbances that no library has. With
--opened, the cases of opened parts of the blind check on a real arm's motion and on the rig. The
cache holds what the probabilities at each step of a search follow from, also at steps that are
too unlikely to be taken, so that ``calibrate_probabilities.py`` and ``ablation.py`` judge decision
rules in seconds.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from dataclasses import replace
import json
from pathlib import Path
import sys
import time
from typing import Any, cast

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'benchmark')]

import diagnose_cases as cases
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose import engine
from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.diagnose.search import posterior
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
from scipy.signal import lfilter

FIFTH = 0.2
PAIRS = 20
HOPELESS = 0.2
"""Probability below which no step is taken further, whatever the rule."""

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
    if 'second' in case:
        effects[case['second']] = effect_values(case['second'], case['second_size'])
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
    rng = np.random.default_rng(11)
    for i in range(PAIRS):
        one, other = rng.choice(sorted(names), 2, replace=False).tolist()
        sizes = rng.choice([1.0, 2 * FIFTH], 2).tolist()
        out.append({'name': one, 'size': sizes[0], 'second': other, 'second_size': sizes[1],
                    'seed': 900 + i})
    return out


class _Found(Exception):
    """A search has ended; what follows it is not needed."""


def steps_of(diagnose) -> list[dict[str, Any]]:
    """Return what each step of a search found, until it is hopeless."""
    steps: list[dict[str, Any]] = []
    judge, walk = cast(Any, posterior), cast(Any, engine)
    inner, searched, named = judge._chosen, walk.search, judge.NAMED

    def watched(start, found, best):
        chosen, features = inner(start, found, best)
        steps.append({
            'worth': bool(chosen.evidence >= best.evidence + judge.WORTH),
            'features': {name: {k: float(v) for k, v in f._asdict().items()}
                         for name, f in features.items()},
            'alternatives': {name: judge._instead(chosen, found, name) for name in features}})
        return chosen, features

    def ended(*args):
        searched(*args)
        raise _Found

    judge._chosen, walk.search, judge.NAMED = watched, ended, HOPELESS
    try:
        diagnose()
    except _Found:
        pass
    finally:
        judge._chosen, walk.search, judge.NAMED = inner, searched, named
    return steps


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a case; keep each step of the search, and which names are right in it."""
    began = time.process_time()
    if 'opened' in case:
        generator, effect, right, diagnose = _opened(case)
    else:
        recording, effect = make(case), case['name']
        generator = 'rig, disturbed' if case.get('beside') else (
            'rig, pairs' if 'second' in case else 'rig')

        def right(name):
            return name in (effect, case.get('second'))

        def diagnose():
            RigSource(load_rig()).diagnose(recording)
    steps = steps_of(diagnose)
    names = {name for step in steps for effect, others in step['alternatives'].items()
             for name in (effect, *others)}
    return case | {'generator': generator, 'effect': effect, 'steps': steps,
                   'right': {name: right(kind_of(name)) for name in sorted(names)},
                   'seconds': time.process_time() - began}


def _opened(case):
    """Return generator, effect, a judgement of names, and how a case is diagnosed."""
    from blind.second import sealing
    from blind.second.judged import Judged
    import blind_second
    import blind_second_tool

    part, one = blind_second.part_of(case['opened']), case['case']
    generator = part.read('commitments')[one]['generator']
    truth = Judged(one, part.read('opened')['labels'][one],
                   {'document': {'verdict': ''}})

    def right(name):
        label = truth.label
        excused = {*label['excused'], *label['doubtful']}
        if truth.is_right(name):
            return True
        return None if name in excused or (label['ambiguous'] and name == truth.effect) else False

    return f'opened {generator}', truth.effect, right, lambda: blind_second_tool.ASK[generator](
        sealing.made_anew(part, one).arrays)


def opened(parts: list[int]) -> list[dict[str, Any]]:
    """List the answered cases of opened parts, but those of a simulator that is run."""
    import blind_second

    return [{'opened': number, 'case': one}
            for number in parts for part in [blind_second.part_of(number)]
            for one, bound in part.read('commitments').items()
            if one in part.read('answers') and bound['generator'] != 'arm']


def main() -> None:
    """Run what is not cached yet."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('-o', '--out', type=Path, default=Path('posterior_cases.jsonl'))
    parser.add_argument('--opened', type=int, nargs='*', help='parts of the blind check')
    parser.add_argument('--part', type=int, nargs=2, default=(0, 1), help='I of N')
    arguments = parser.parse_args()
    done = [json.loads(line) for line in arguments.out.read_text().splitlines()] \
        if arguments.out.exists() else []
    cases = opened(arguments.opened) if arguments.opened else plan()
    for case in cases[arguments.part[0]::arguments.part[1]]:
        if any(case.items() <= one.items() for one in done):
            continue
        try:
            result = run(case)
        except ForcecalError as error:
            result = case | {'error': str(error)}
        with arguments.out.open('a') as file:
            file.write(json.dumps(result) + '\n')
        print(case, [{name: (round(f['gain']), round(f['missing']))
                      for name, f in step['features'].items()}
                     for step in result.get('steps', [])], flush=True)


if __name__ == '__main__':
    main()
