"""What each part of the decision of a diagnosis costs and buys, on cached cases, in seconds.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/posterior_cases.py -o opened.jsonl --opened 2 3
    python benchmark/ablation.py cases.jsonl opened.jsonl

Each rule is judged on the same steps of the same searches. A search ends where an effect is not
likelier than not, but not at its first step; what it named is right where all names are, and the
true effects are among them. Calibrations predict cases of each generator and effect by a fit to
the others.
"""

import argparse
from collections.abc import Callable
import json
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).parent))

from calibrate_probabilities import fit, group_of, load, predicted, Rows, rows_of, scores
from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.diagnose.search.calibration import Features, FILE
from forcecal_ros.diagnose.search.posterior import NAMED
import numpy as np

WITHOUT = {'fitted to the others': (), 'the same without what is missing': (0,),
           'the same without effects beside it': (1,)}
"""Regressors that a calibration does not use."""


def calibrated(rows: Rows, gone: tuple[int, ...]) -> Callable[[str, np.ndarray], np.ndarray]:
    """Return probabilities of rows of a group, by a fit to the others without some regressors."""
    kept = np.array([float(i not in gone) for i in range(rows.x.shape[1])])
    fits = {g: fit(rows.x[rows.group != g] * kept, rows.right[rows.group != g])
            for g in {*rows.group, ''}}

    def probability(of: str, x: np.ndarray) -> np.ndarray:
        return predicted(fits.get(of, fits['']), x * kept)

    return probability


def named(case: dict, probability: Callable[[str, np.ndarray], np.ndarray]) -> list[str]:
    """Return the effects that a search names by a rule, the likeliest first."""
    found: list[str] = []
    for number, step in enumerate(case.get('steps', [])):
        p = probability(group_of(case), np.array([Features(**f).row() for f in step.values()]))
        if p.min() >= NAMED:
            found = [list(step)[i] for i in np.argsort(-p)]
        elif number:
            break
    return [kind_of(name) for name in found]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('cases', type=Path, nargs='+')
    cases = load(parser.parse_args().cases)
    rows, stored = rows_of(cases), json.loads(FILE.read_text())
    w = np.array([stored['intercept'], *stored['weights']])
    rules = {'always named': lambda g, x: np.full(len(x), 0.99),
             'the first effect, always named': lambda g, x: np.full(
                 len(x), 0.99 if len(x) == 1 else 0.01),
             'more evidence than is missing': lambda g, x: np.where(x[:, 0] > 0.0, 0.99, 0.01),
             'as stored': lambda g, x: predicted(w, x),
             **{name: calibrated(rows, gone) for name, gone in WITHOUT.items()}}
    generators = sorted({case['generator'] for case in cases})
    print('| rule | log score | calibration error | '
          + ' | '.join(f'{g}: right, false names' for g in generators) + ' |')
    print('|---' * (3 + len(generators)) + '|')
    for rule, probability in rules.items():
        p = np.concatenate([probability(g, x[np.newaxis]) for g, x in zip(rows.group, rows.x)])
        s = scores(p, rows.right)
        cells = [f"{s['log_score']:.2f}", f"{s['calibration_error']:.2f}"]
        for generator in generators:
            some = [(c, named(c, probability)) for c in cases if c['generator'] == generator]
            false = [any(c['right'][n] is False for n in names) for c, names in some]
            right = [not wrong and (not c['effect'] or sum(
                bool(c['right'][n]) for n in names) > ('second' in c))
                for wrong, (c, names) in zip(false, some)]
            cells.append(f'{sum(right)}, {sum(false)} of {len(some)}')
        print(f'| {rule} | ' + ' | '.join(cells) + ' |')


if __name__ == '__main__':
    main()
