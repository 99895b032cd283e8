"""What each part of the decision of a diagnosis costs and buys, on cached cases, in seconds.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/ablation.py cases.jsonl

Each rule is judged on the same steps of the same searches; calibrations are cross-validated by
generator.
"""

import argparse
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).parent))

from calibrate_probabilities import cross_validated, load, rows_of, scores
import numpy as np


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('cases', type=Path, nargs='+')
    arguments = parser.parse_args()
    cases = load(arguments.cases)
    rows = rows_of(cases)
    ratio = 10.0 ** rows.x[:, 0]
    rules = {'evidence alone, always named': np.full(len(ratio), 0.99),
             'evidence at least 0.6 of what is missing': np.where(ratio > 0.6, 0.99, 0.01),
             'calibration': cross_validated(rows)}
    print('| rule | wrong accepted | right refused | log score | calibration error |')
    print('|---|---|---|---|---|')
    for name, p in rules.items():
        s = scores(p, rows.right)
        print(f"| {name} | {s['accepted_wrong']} | {s['refused_right']} | {s['log_score']:.2f} | "
              f"{s['calibration_error']:.2f} |")
    for size in sorted({c['size'] for c in cases}, reverse=True):
        for beside in (False, True):
            some = [c for c in cases if c['size'] == size and bool(c.get('beside')) == beside]
            if some:
                first = sum(c['named'][:1] == [c['name']] if c['name'] else
                            not set(c['named']) - {'unknown'} for c in some)
                print(f'size {size}{", beside disturbances" if beside else ""}: right first '
                      f'(nothing named if there is none) {first} of {len(some)}')


if __name__ == '__main__':
    main()
