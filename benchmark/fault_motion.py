"""Motion safety: every fault in every phase over DDS, tried and survived.

    python benchmark/fault_motion.py [--fault TEXT] [--phase WORD] [--json FILE]

Simulated rig, sequencer and observer run as processes of their own. In each phase of both
sequences each fault happens once; the table says for how long commands still moved (counted in
commands, 4 ms each, from the moment the fault was confirmed), and that they never moved again.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import json
import os
from pathlib import Path
import random
import sys
import tempfile

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
os.environ.setdefault('ROS_DOMAIN_ID', str(random.randint(1, 101)))
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from fault_motion_runs import Bench, FAULTS, Outcome, PHASES


def cell(outcome: Outcome) -> str:
    """Return what the table says."""
    if outcome.end == 'stopped':
        return f'{1e3 * outcome.moving:.0f} ms'
    return outcome.end


def table(outcomes: list[Outcome], faults: Sequence[str], phases: Sequence[str]) -> str:
    """Return the table as Markdown."""
    rows = ['| fault | ' + ' | '.join(phases) + ' | the node says |',
            '|---|' + '---|' * (len(phases) + 1)]
    for fault in faults:
        found = {outcome.phase: outcome for outcome in outcomes if outcome.fault == fault}
        if found:
            reasons = [o.reason for o in found.values() if o.reason]
            rows.append(f'| {fault} | ' + ' | '.join(
                cell(found[phase]) if phase in found else '' for phase in phases)
                + f' | {max(reasons, key=reasons.count) if reasons else ""} |')
    return '\n'.join(rows)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description='faults while the robot moves')
    parser.add_argument('--fault', default='', help='only faults with this in their name')
    parser.add_argument('--phase', default='', help='only this phase')
    parser.add_argument('--json', metavar='FILE')
    args = parser.parse_args()
    outcomes: list[Outcome] = []
    os.environ.setdefault('ROS_LOG_DIR', tempfile.mkdtemp())
    for clock in (False, True):
        with Bench(clock) as bench:
            for fault in FAULTS:
                if fault.startswith('clock') != clock or args.fault not in fault:
                    continue
                for phase in PHASES:
                    if args.phase not in phase:
                        continue
                    outcomes.append(bench.tried(fault, phase))
                    print(outcomes[-1], file=sys.stderr, flush=True)
    failed = [outcome for outcome in outcomes if not outcome.survived]
    print(table(outcomes, FAULTS, PHASES))
    print(f'\n{len(outcomes)} tried, {len(outcomes) - len(failed)} survived')
    if args.json:
        Path(args.json).write_text(json.dumps([asdict(o) for o in outcomes], indent=1))
    return 1 if failed else 0


if __name__ == '__main__':
    raise SystemExit(main())
