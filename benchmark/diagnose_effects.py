"""Which effects are found, on simulated recordings whose cause is known.

Every effect of the library alone and in twelve pairs, at the size where its held-out whitened
energy under the true noise, beyond what the nuisances take up, is 250 (pairs: 1000 each);
recordings without any effect; delay and low-pass of 4 ms on the planned and on a slow motion.
Nuisances are drawn from their spreads, noise is 1.5 times nominal. Saturation, quantisation, skew
and lost samples: see diagnose_cases.py. Interrupted, it goes on where it stopped.
"""

import argparse
from pathlib import Path
import sys
import time
from typing import Any

from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.sim.rig.file import load_rig

sys.path.insert(0, str(Path(__file__).parent))

import diagnose_cases as cases
from resumable import resumed

PAIRS = (
    ('wrench_crosstalk', 'tool_friction'), ('accel_misalignment', 'tool_backlash'),
    ('robot_resonance', 'wrench_bias_drift'), ('cable_force', 'accel_delay'),
    ('tool_stiffening', 'accel_gain'), ('base_tilt', 'wrench_hysteresis'),
    ('spindle_vibration', 'wrench_gain'), ('contact_stiffness', 'accel_bias'),
    ('robot_delay', 'wrench_lowpass'), ('tool_damping', 'accel_resonance'),
    ('wall_position', 'wrench_delay'), ('accel_highpass', 'contact_damping'),
)

ALIASES = (
    {'wrench_delay', 'wrench_lowpass'}, {'accel_delay', 'accel_resonance'},
    {'base_tilt', 'cable_force'},
    {'tool_mass', 'wrench_gain', 'tool_stiffness', 'tool_damping', 'contact_stiffness'},
)
"""Effects that hardly differ at small sizes."""


def plan(seeds: int, none: int) -> list[dict[str, Any]]:
    """List the cases."""
    singles = [*cases.SHAPES, *cases.OF_STAMPS_AND_VALUES]
    out = [{'names': [n], 'seed': s, 'energy': 250.0} for s in range(1, seeds + 1)
           for n in singles]
    out += [{'names': list(p), 'seed': 50 + i, 'energy': 1000.0} for i, p in enumerate(PAIRS)]
    out += [{'names': [], 'seed': 100 + i, 'energy': 0.0} for i in range(none)]
    out += [{'names': [n], 'seed': 90, 'full': True, 'motion': motion}
            for motion in ('planned', 'slow') for n in ('wrench_delay', 'wrench_lowpass')]
    return out


def run(case: dict[str, Any]) -> dict[str, Any]:
    """Make a case and diagnose it."""
    effects, energy = {}, []
    for name in case['names']:
        if name in cases.OF_STAMPS_AND_VALUES:
            effects[name] = dict(cases.OF_STAMPS_AND_VALUES[name])
            continue
        if case.get('full'):
            effects[name] = dict(cases.SHAPES[name])
            continue
        size = cases.sized(name, case['energy'])
        effects[name] = size.values
        energy.append((round(size.raw), round(size.net)))
    first, second = cases.recordings(case['seed'], effects, motion=case.get('motion', 'quick'))
    began = time.process_time()
    d = RigSource(load_rig()).diagnose(first, second).diagnosis
    return case | {
        'effects': effects, 'raw_net': energy, 'verdict': d.verdict,
        'named': [e.name for e in d.effects], 'candidates': list(d.candidates),
        'closed': d.gap.closed if d.gap else None,
        'ci95': d.gap.closed_ci95 if d.gap else None,
        'reason': d.reason, 'seconds': time.process_time() - began}


def judged(result: dict[str, Any]) -> str:
    """Say in a word how right a result is."""
    truth, named = set(result['names']), result['named']
    if not truth:
        return 'right' if result['verdict'] == 'no_gap' else 'FALSE ALARM'
    if truth == set(named):
        return 'right'
    if len(truth) == 1 and named and any(truth | {named[0]} <= a for a in ALIASES):
        return 'alias' if truth <= {n for n, _ in result['candidates']} else 'alias only'
    return 'first' if named and named[0] in truth else 'WRONG'


def main() -> None:
    """Run what is not done yet and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('-o', '--out', type=Path, default=Path('diagnose_effects.jsonl'))
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--seeds', type=int, default=1, help='of each effect alone')
    parser.add_argument('--none', type=int, default=10, help='recordings without effect')
    arguments = parser.parse_args()
    done = resumed(run, plan(arguments.seeds, arguments.none), arguments.out, arguments.jobs,
                   lambda case, result: case.items() <= result.items())
    print('| truth | raw, net energy | verdict | named (candidates) | closed | |\n' + '|---' * 6
          + '|')
    for r in done:
        truth = ' + '.join(r['names']) + (f" ({r['motion']})" if 'motion' in r else '')
        listed = ', '.join(f'{n} {p:.2f}' for n, p in r['candidates'])
        print(f"| {truth or 'none'} | {r['raw_net']} | {r['verdict']} | "
              f"{' + '.join(r['named'])} ({listed}) | {r['closed'] or 0.0:.2f} | {judged(r)} |")
    words = [judged(r) for r in done]
    print(', '.join(f'{words.count(w)} {w}' for w in dict.fromkeys(words)))


if __name__ == '__main__':
    main()
