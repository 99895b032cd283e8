"""Judges the calibration of a diagnosis on cached development cases, and a fit to them.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/posterior_cases.py -o opened.jsonl --opened 2 3 5
    python benchmark/calibrate_probabilities.py cases.jsonl opened.jsonl [--write prior|fit]

Every case is decided anew from what its search found, as a diagnosis decides it, and scored by the
logarithm of the probability that its truth is given. The fit to that score is cross-validated by
generator and effect: the cases of each, and those with none, are decided by a fit to the others.
"""

import argparse
from collections.abc import Callable, Iterable, Sequence
import json
from pathlib import Path
import sys
from types import MappingProxyType
from typing import Any, cast, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

from forcecal_ros.diagnose.search.calibration import Calibration, Features, FILE
from forcecal_ros.diagnose.search.posterior import listed_once, Posterior, weighed
from forcecal_ros.diagnose.verdict import NAMED, UNKNOWN
import numpy as np
from scipy.optimize import minimize

PRIOR = Calibration(0.0, (1.5, 2.0), (2.0, 0.002, 0.2), 0.99)
"""
Mean of what is fitted: as likely as not where an effect brings the evidence that is missing, less
likely by 2 in log odds for each effect beside it that brings as much.
"""

LEAST = 0.01
"""Probability below which the log score tells no difference."""

FOLDS = 5
"""Parts that the generators and effects are divided into for cross-validation."""


class Decided(NamedTuple):
    """Effects that a case's diagnosis names, and the probability of every candidate."""

    named: list[str]
    candidates: dict[str, float]


def decided(case: dict[str, Any], by: Calibration) -> Decided:
    """Decide a case anew from the steps of its search; a gap is what an effect is worth naming."""
    steps = case['steps']
    taken, named = (steps[0] if steps else None), False
    for step in steps:
        if not step['worth'] or min(by.probability(Features(**f))
                                    for f in step['features'].values()) < NAMED:
            break
        taken, named = step, True
    if taken is None:
        return Decided([], {})
    found = Posterior(cast(Any, None), (), (), MappingProxyType(
        {name: Features(**f) for name, f in taken['features'].items()}), taken['alternatives'],
        closest=None if named else cast(Any, 'not accepted'))
    probabilities, candidates = weighed(found, taken['worth'], True, by)
    return Decided(sorted(probabilities, key=lambda name: -probabilities[name]) if named else [],
                   dict(listed_once(candidates)))


def of_truth(case: dict[str, Any], candidates: dict[str, float]) -> float:
    """Return the probability that candidates give a case's truth."""
    if case['effect']:
        return max((p for name, p in candidates.items() if case['right'].get(name)), default=0.0)
    return 1.0 - max((p for name, p in candidates.items()
                      if case['right'].get(name) is False), default=0.0)


def scored(some: Iterable[tuple[dict[str, Any], Decided]]) -> float:
    """Return the mean logarithm of the probabilities that cases' truths are given."""
    return float(np.mean([np.log(max(LEAST, of_truth(case, one.candidates)))
                          for case, one in some]))


def _packed(by: Calibration) -> np.ndarray:
    return np.array([by.intercept, *by.weights, *np.log(by.temperature)])


def _unpacked(x: np.ndarray) -> Calibration:
    return Calibration(float(x[0]), tuple(np.maximum(x[1:3], 0.0).tolist()),
                       tuple(np.exp(x[3:]).tolist()), PRIOR.largest)


def fit(cases: Sequence[dict[str, Any]]) -> Calibration:
    """Fit a calibration to cases; the scatter of each number, or of its logarithm, is 1."""
    start = _packed(PRIOR)

    def cost(x: np.ndarray) -> float:
        by, off = _unpacked(x), x - start
        return 0.5 * float(off @ off) / len(cases) - scored(
            (case, decided(case, by)) for case in cases)

    return _unpacked(minimize(cost, start, method='Powell',
                              options={'maxiter': 6, 'xtol': 0.02, 'ftol': 1e-4}).x)


def cross_validated(cases: Sequence[dict[str, Any]]) -> Callable[[dict[str, Any]], Calibration]:
    """Return what gives each case a calibration that was fitted to the others."""
    groups = sorted({group_of(case) for case in cases})
    fold = {g: i % FOLDS for i, g in enumerate(np.random.default_rng(1).permutation(groups))}
    fits = [fit([c for c in cases if fold[group_of(c)] != i]) for i in range(FOLDS)]
    return lambda case: fits[fold[group_of(case)]]


def group_of(case: dict[str, Any]) -> str:
    """Return the generator and the effect of a case; without one, each is its own group."""
    other = case.get('case', case.get('seed'))
    return f"{case['generator']}: {case['effect'] or other}"


def always(by: Calibration) -> Callable[[dict[str, Any]], Calibration]:
    """Return what gives every case the same calibration."""
    return lambda case: by


def figures(cases: Sequence[dict[str, Any]], of: Callable[[dict[str, Any]], Calibration]
            ) -> dict[str, float]:
    """Return log score, calibration error of five bins, and how often is what first and named."""
    some = [(case, decided(case, of(case))) for case in cases]
    stated = [(p, case['right'][name]) for case, one in some
              for name, p in one.candidates.items() if name != UNKNOWN]
    pairs = np.array([x for x in stated if x[1] is not None], dtype=float).reshape(-1, 2)
    bins = np.minimum((5 * pairs[:, 0]).astype(int), 4)
    error = sum(abs(pairs[bins == b].mean(axis=0) @ (1.0, -1.0)) * (bins == b).mean()
                for b in np.unique(bins))
    first = [next((bool(case['right'].get(name)) for name in one.candidates
                   if name == UNKNOWN or case['right'][name] is not None), False)
             for case, one in some if case['effect']]
    false = [any(p > NAMED and name != UNKNOWN and case['right'][name] is False
                 for name, p in one.candidates.items()) for case, one in some]
    return {'log_score': round(scored(some), 3), 'calibration_error': round(float(error), 3),
            'first': int(sum(first)), 'of': len(first),
            'false_names': int(sum(false)), 'cases': len(cases)}


def of_frequencies(cases: Sequence[dict[str, Any]]) -> float:
    """Return the log score of who knows how frequent each effect is, and nothing else."""
    effects = [case['effect'] for case in cases]
    return float(np.mean([np.log(effects.count(effect) / len(effects)) for effect in effects]))


def load(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Read cached cases, each once."""
    lines = [line for path in paths for line in path.read_text().splitlines()]
    cases = [json.loads(line) for line in lines]
    known = 'name', 'size', 'seed', 'beside', 'second', 'opened', 'case'
    key = [json.dumps([c.get(k) for k in known]) for c in cases]
    return [case for case in dict(zip(key, cases)).values() if 'steps' in case]


def main() -> None:
    """Print the fit and its cross-validation; store it if that is wanted."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('cases', type=Path, nargs='+')
    parser.add_argument('--write', choices=('prior', 'fit'), help=f'store it as {FILE.name}')
    arguments = parser.parse_args()
    cases = load(arguments.cases)
    validated = figures(cases, cross_validated(cases))
    for name, by in (('fit', fit(cases)), ('prior', PRIOR)):
        document = {
            'provenance': f'{"a" if name == "fit" else "the mean of the prior of a"} fit by '
                          'benchmark/calibrate_probabilities.py, judged on '
                          'benchmark/posterior_cases.py and opened parts of the blind check',
            'regressors': ['gain_over_missing', 'no_other_beside'],
            'intercept': round(by.intercept, 2), 'weights': np.round(by.weights, 2).tolist(),
            'temperature': [float(f'{x:.2g}') for x in by.temperature], 'largest': by.largest,
            'figures': figures(cases, always(by)), 'fit_cross_validated': validated,
            'log_score_of_frequencies': round(of_frequencies(cases), 3)}
        print(json.dumps(document, indent=1))
        if arguments.write == name:
            FILE.write_text(json.dumps(document, indent=1) + '\n')


if __name__ == '__main__':
    main()
