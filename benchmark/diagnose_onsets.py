"""Effects that begin or end half-way: which are named, and when they are said to begin or end.

Each case is a recording of the simulated rig with one effect from a drawn instant on, or until
one, its nuisances drawn within their tolerances, its noise 1.5 times nominal; each fourth has
none. The instant counts as found within max(0.1 s, 15 T / E), where T is the time that the effect
acts and E its whitened energy. Interrupted, it goes on where it stopped.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
import sys
import time
from typing import Any

from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.effects import with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import diagnose_cases as cases
from resumable import resumed

SIZES: Mapping[str, Mapping[str, float]] = {
    'tool_mass': {'change': 0.1}, 'tool_com': {'x': 0.01, 'z': 0.005}, 'wrench_gain': {'fz': 0.08},
    'wrench_crosstalk': {'fx_of_fz': 0.05}, 'cable_force': {'x': 2.0, 'z': 3.0},
    'base_tilt': {'x': 0.02}, 'wrench_delay': {'delay': 0.004}, 'accel_bias': {'x': 0.15},
    'accel_gain': {'z': 0.1}, 'accel_misalignment': {'y': 0.04}, 'tool_friction': {
        'force': 3.0, 'velocity_scale': 0.002},
    'wrench_lowpass': {'time_constant': 0.005}, 'robot_delay': {'delay': 0.004},
    'accel_delay': {'delay': 0.005},
}
"""Effects that begin or end, at a size that is seen within some seconds."""


def plan(count: int, seed: int) -> list[dict[str, Any]]:
    """Draw cases: effect, instant, whether it begins or ends, and a factor of its size."""
    rng = np.random.default_rng(seed)
    names = rng.permutation(list(SIZES)).tolist()
    out = []
    for i in range(count):
        name = '' if i % 4 == 3 else names[(i - i // 4) % len(names)]
        out.append({'number': i, 'seed': seed, 'name': name,
                    'share': round(float(rng.uniform(0.2, 0.8)), 3),
                    'ends': bool(rng.random() < 0.3),
                    'factor': round(float(np.exp(rng.uniform(-0.7, 0.7))), 3)})
    return out


def switched(before: Recording, after: Recording, at: float) -> Recording:
    """Return one recording up to an instant, and the other from there on."""
    def stream(a: Stream | None, b: Stream | None) -> Stream | None:
        if a is None or b is None:
            return a
        return replace(a, values=np.where(a.t[:, np.newaxis] < at, a.values, b.values))

    a, b = before.pose, after.pose
    assert a is not None and b is not None
    early = a.t < at
    pose = PoseStream(a.t, np.where(early[:, np.newaxis], a.position, b.position),
                      np.where(early[:, np.newaxis, np.newaxis], a.R_base_sensor,
                               b.R_base_sensor))
    return replace(before, wrench=stream(before.wrench, after.wrench), pose=pose,
                   accelerometer=stream(before.accelerometer, after.accelerometer),
                   optidrive=stream(before.optidrive, after.optidrive))


def made(case: Mapping[str, Any]) -> tuple[Recording, float, float]:
    """Make a case's recording; with its instant [s] and the whitened energy of its effect."""
    key = 1000 * case['seed'] + case['number']
    target, phases = cases.trajectory(key % 5)
    effects = {case['name']: {k: v * (case['factor'] if k not in (
        'velocity_scale', 'second_order') else 1.0) for k, v in SIZES[case['name']].items()}
               } if case['name'] else {}
    ways = [simulate(rig, target, seed=key, steps=16) for rig in (
        _with(key, {}), _with(key, effects))]
    at = float(target.t[0] + case['share'] * (target.t[-1] - target.t[0]))
    pair = ways[::-1] if case['ends'] else ways
    r = replace(switched(pair[0], pair[1], at), phases=phases, contact_truth=None)
    energy = sum(_energy(getattr(a, s), getattr(b, s), at, case['ends'])
                 for a, b in [ways] for s in ('wrench', 'accelerometer', 'optidrive'))
    return r, at, energy


def _with(key: int, effects: Mapping[str, Mapping[str, float]]) -> Rig:
    rig = cases.real_rig(key, {})
    return with_effects(rig, effects) if effects else rig


def _energy(a: Stream, b: Stream, at: float, ends: bool) -> float:
    """Whitened energy of what an effect does to one stream while it acts, in white noise."""
    acts = (a.t < at) == ends
    d = (b.values - a.values)[acts]
    noise = np.diff(a.values - np.roll(a.values, 1, axis=0), axis=0).std(axis=0) / np.sqrt(6.0)
    return float(np.sum((d / np.maximum(noise, 1e-12)) ** 2))


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Make a case and diagnose it."""
    recording, at, energy = made(case)
    began = time.process_time()
    d = RigSource(load_rig()).diagnose(recording).diagnosis
    return case | {
        'at': at, 'energy': energy, 'verdict': d.verdict, 'reason': d.reason,
        'candidates': list(d.candidates), 'seconds': time.process_time() - began,
        'effects': [{'name': e.name, 'from': e.begin, 'from_ci95': e.begin_ci95, 'to': e.end,
                     'to_ci95': e.end_ci95, 'p': e.probability,
                     'numbers': {k: (p.value, p.std) for k, p in e.parameters.items()}}
                    for e in d.effects],
        'length': float(recording.wrench.t[-1] - recording.wrench.t[0])}


def judged(r: Mapping[str, Any]) -> dict[str, Any]:
    """Say of one result what of it is right."""
    named = {e['name']: e for e in r['effects']}
    sudden = [n for n, e in named.items() if e['from'] is not None or e['to'] is not None]
    if not r['name']:
        return {'false': bool(sudden)}
    e = named.get(r['name'])
    key = 'to' if r['ends'] else 'from'
    first = r['candidates'][0][0] if r['candidates'] else ''
    out = {'named': e is not None and e[key] is not None, 'first': first == r['name'],
           'listed': r['name'] in dict(map(tuple, r['candidates']))}
    if out['named']:
        length = r['at'] if r['ends'] else r['length'] - r['at']
        least = max(0.1, 15.0 * length / max(r['energy'], 1e-9))
        off, (low, high) = e[key] - r['at'], e[f'{key}_ci95']
        out |= {'off': off, 'near': abs(off) <= least, 'covered': low <= r['at'] <= high}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--seed', type=int, default=1, help='of the cases (default 1)')
    parser.add_argument('--count', type=int, default=24, help='cases (default 24)')
    parser.add_argument('--jobs', type=int, default=1, help='processes (default 1)')
    parser.add_argument('-o', '--out', type=Path, default=Path('diagnose_onsets.jsonl'),
                        help='results, a line a case (default diagnose_onsets.jsonl)')
    arguments = parser.parse_args()
    results = resumed(run, plan(arguments.count, arguments.seed), arguments.out, arguments.jobs,
                      lambda c, r: (c['seed'], c['number']) == (r['seed'], r['number']))
    verdicts = [(r, judged(r)) for r in results]
    for r, v in verdicts:
        said = ', '.join(f'{e["name"]} {e["p"]:.2f}' for e in r['effects'])
        print(f'{r["number"]:3d} {r["name"] or "none":20s} {r["verdict"]:12s} {said:50s} '
              f'{ {k: round(x, 3) if isinstance(x, float) else x for k, x in v.items()} } '
              f'{r["seconds"]:.0f} s')
    real = [v for _, v in verdicts if 'named' in v]
    for word in ('named', 'first', 'listed', 'near', 'covered'):
        chosen = [v[word] for v in real if word in v]
        print(f'{word}: {sum(chosen)} of {len(chosen)}')
    none = [v['false'] for _, v in verdicts if 'false' in v]
    print(f'false onsets: {sum(none)} of {len(none)} recordings without effect')


if __name__ == '__main__':
    main()
