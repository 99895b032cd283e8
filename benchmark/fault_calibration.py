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
from dataclasses import asdict
import json
import os
from pathlib import Path
import sys
import warnings

for _name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_name, '1')
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from fault_calibration_runs import FAULTS, judged, Verdict

WORDS = ('refused', 'flagged', 'right', 'harmless', 'silent', 'crashed')


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
