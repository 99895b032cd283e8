"""Fits the calibration of a diagnosis to cached development cases, with cross-validation.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/calibrate_probabilities.py cases.jsonl [--write]

One row a step of a search: the effect that was added last, right or not. The logistic regression
has a prior about a rule that is known to work, and is cross-validated by generator: each kind of
effect, and recordings with none, are predicted by a fit to the others.
"""

import argparse
import json
from pathlib import Path
import sys
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

from forcecal_ros.diagnose.search.calibration import Features, FILE
import numpy as np
from scipy.optimize import minimize

PRIOR = np.array([0.666, 3.0, 3.0])
"""Mean of intercept and weights: as likely as not at 0.6 of the missing evidence."""

RIDGE = 1.0
"""Their prior precision, of regressors of order 1."""


class Rows(NamedTuple):
    """Steps of searches: regressors, whether the effect was right, and the generator."""

    x: np.ndarray
    right: np.ndarray
    group: np.ndarray
    cases: int


def rows_of(cases: list[dict]) -> Rows:
    """Take of each step the effect that was added last."""
    x, right, group = [], [], []
    for case in cases:
        seen: set[tuple[str, ...]] = set()
        for step in case['steps']:
            key = tuple(step['names'])
            if key in seen:
                continue
            seen.add(key)
            x.append(Features(*(step[k] for k in Features._fields)).row())
            right.append(step['added'] == case['name'])
            group.append(case['name'] or '+'.join(case.get('beside', ['none'])))
    return Rows(np.array(x), np.array(right, dtype=float), np.array(group), len(cases))


def fit(x: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return intercept and weights."""
    def cost(w):
        z = w[0] + x @ w[1:]
        p = 1.0 / (1.0 + np.exp(-z))
        off = w - PRIOR
        value = np.sum(np.logaddexp(0.0, z) - right * z) + 0.5 * RIDGE * off @ off
        return value, np.append(np.sum(p - right), x.T @ (p - right)) + RIDGE * off

    return minimize(cost, PRIOR.copy(), jac=True, bounds=[(None, None), *[(0.0, None)] * 2],
                    method='L-BFGS-B').x


def cross_validated(rows: Rows) -> np.ndarray:
    """Predict each generator's rows by a fit to the others."""
    out = np.zeros(len(rows.right))
    for g in np.unique(rows.group):
        w = fit(rows.x[rows.group != g], rows.right[rows.group != g])
        out[rows.group == g] = 1.0 / (1.0 + np.exp(-w[0] - rows.x[rows.group == g] @ w[1:]))
    return np.clip(out, 0.01, 0.99)


def scores(p: np.ndarray, right: np.ndarray) -> dict[str, float]:
    """Return log score, calibration error of five bins, and false acceptances and refusals."""
    bins = np.minimum((5 * p).astype(int), 4)
    error = sum(abs(p[bins == b].mean() - right[bins == b].mean()) * (bins == b).mean()
                for b in np.unique(bins))
    return {'log_score': float(np.mean(np.log(np.where(right > 0.5, p, 1.0 - p)))),
            'calibration_error': float(error),
            'accepted_wrong': int(np.sum((p >= 0.5) * (1 - right))),
            'refused_right': int(np.sum((p < 0.5) * right)), 'rows': len(p)}


def load(paths: list[Path]) -> list[dict]:
    """Read cached cases, each once."""
    lines = [line for path in paths for line in path.read_text().splitlines()]
    cases = [json.loads(line) for line in lines]
    key = [json.dumps([c['name'], c['size'], c['seed'], c.get('beside')]) for c in cases]
    return list(dict(zip(key, cases)).values())


def main() -> None:
    """Print the fit and its cross-validation; store it if that is wanted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('cases', type=Path, nargs='+')
    parser.add_argument('--write', action='store_true', help=f'store it as {FILE.name}')
    arguments = parser.parse_args()
    rows = rows_of(load(arguments.cases))
    w = fit(rows.x, rows.right)
    found = scores(cross_validated(rows), rows.right)
    stored = json.loads(FILE.read_text()) | {
        'provenance': 'benchmark/calibrate_probabilities.py on benchmark/posterior_cases.py, '
                      'cross-validated by generator',
        'cases': rows.cases, 'intercept': round(float(w[0]), 3),
        'weights': np.round(w[1:], 3).tolist(), 'cross_validation': found}
    print(json.dumps(stored, indent=1))
    if arguments.write:
        FILE.write_text(json.dumps(stored, indent=1) + '\n')


if __name__ == '__main__':
    main()
