"""What each part of the decision of a diagnosis costs and buys, on cached cases, in seconds.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/posterior_cases.py -o opened.jsonl --opened 2 3 5
    python benchmark/ablation.py cases.jsonl opened.jsonl

Each rule decides the same steps of the same searches. What is named is right where all names are,
and the true effects are among them. A fitted calibration decides the cases of each generator and
effect by a fit to the others.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from calibrate_probabilities import always, cross_validated, decided, figures, load
from forcecal_ros.diagnose.search.calibration import Calibration, stored

Rule = tuple[Callable[[dict[str, Any]], Calibration], Callable[[dict[str, Any]], dict[str, Any]]]
"""The calibration of a case, and what of the case is decided."""

SURE = 1e3
"""Intercept by which everything is certain."""


def whole(case: dict[str, Any]) -> dict[str, Any]:
    """Decide a case by all steps of its search."""
    return case


def first(case: dict[str, Any]) -> dict[str, Any]:
    """Decide a case by the first step of its search."""
    return case | {'steps': case['steps'][:1]}


def rules(cases: list[dict[str, Any]]) -> dict[str, Rule]:
    """Return the rules by name."""
    now = stored()
    return {
        'always named': (always(now._replace(intercept=SURE)), whole),
        'the first effect, always named': (always(now._replace(intercept=SURE)), first),
        'as stored': (always(now), whole),
        'as stored, the first effect alone': (always(now), first),
        'without what is missing': (always(now._replace(weights=(0.0, now.weights[1]))), whole),
        'without effects beside it': (always(now._replace(weights=(now.weights[0], 0.0))), whole),
        'odds by log-evidence alone': (always(now._replace(temperature=(1.0, 0.0, 0.0))), whole),
        'fitted to the others': (cross_validated(cases), whole)}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('cases', type=Path, nargs='+')
    cases = load(parser.parse_args().cases)
    generators = sorted({case['generator'] for case in cases})
    print('| rule | log score | calibration error | first | '
          + ' | '.join(f'{g}: right, false names' for g in generators) + ' |')
    print('|---' * (4 + len(generators)) + '|')
    for rule, (by, of) in rules(cases).items():
        s = figures([of(case) for case in cases], by)
        cells = [f"{s['log_score']:.2f}", f"{s['calibration_error']:.2f}",
                 f"{s['first']} of {s['of']}"]
        for generator in generators:
            some = [(c, decided(of(c), by(c)).named) for c in cases
                    if c['generator'] == generator]
            false = [any(c['right'][n] is False for n in names) for c, names in some]
            right = [not wrong and (not c['effect'] or sum(
                bool(c['right'][n]) for n in names) > ('second' in c))
                for wrong, (c, names) in zip(false, some)]
            cells.append(f'{sum(right)}, {sum(false)} of {len(some)}')
        print(f'| {rule} | ' + ' | '.join(cells) + ' |')


if __name__ == '__main__':
    main()
