"""Fits the calibration of a diagnosis to cached development cases, with cross-validation.

    python benchmark/posterior_cases.py -o cases.jsonl
    python benchmark/posterior_cases.py -o opened.jsonl --opened 2 3
    python benchmark/calibrate_probabilities.py cases.jsonl opened.jsonl [--write]

One row an effect of a step of a search, right or not. The logistic regression is cross-validated
by generator and effect: those of each, and recordings with none, are predicted by a fit to the
others.
"""

import argparse
import json
from pathlib import Path
import sys
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parent))

from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.diagnose.search.calibration import Features, FILE
import numpy as np
from scipy.optimize import minimize

PRIOR = np.array([0.0, 1.0, 2.0])
"""Mean of intercept and weights."""

RIDGE = 1.0
"""Their prior precision, of regressors of order 1."""


class Rows(NamedTuple):
    """Effects of steps of searches: regressors, whether they are right, and the generator."""

    x: np.ndarray
    right: np.ndarray
    group: np.ndarray
    cases: int


def group_of(case: dict) -> str:
    """Return the generator and the effect of a case."""
    return f"{case['generator']}: {case['effect'] or 'none'}"


def rows_of(cases: list[dict]) -> Rows:
    """Take of each step all effects that are right or wrong."""
    x, right, group = [], [], []
    for case in cases:
        for name, found in [pair for step in case.get('steps', []) for pair in step.items()]:
            true = case['right'][kind_of(name)]
            if true is not None:
                x.append(Features(**found).row())
                right.append(true)
                group.append(group_of(case))
    return Rows(np.array(x), np.array(right, dtype=float), np.array(group), len(cases))


def fit(x: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return intercept and weights."""
    def cost(w):
        z = w[0] + x @ w[1:]
        p = 1.0 / (1.0 + np.exp(-z))
        off = w - PRIOR
        value = np.sum(np.logaddexp(0.0, z) - right * z) + 0.5 * RIDGE * off @ off
        return value, np.append(np.sum(p - right), x.T @ (p - right)) + RIDGE * off

    return minimize(cost, PRIOR.copy(), jac=True,
                    bounds=[(None, None), *[(0.0, None)] * (len(PRIOR) - 1)],
                    method='L-BFGS-B').x


def predicted(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the probability of rows by intercept and weights."""
    return np.clip(1.0 / (1.0 + np.exp(-w[0] - x @ w[1:])), 0.01, 0.99)


def cross_validated(rows: Rows) -> np.ndarray:
    """Predict each generator's rows by a fit to the others."""
    out = np.zeros(len(rows.right))
    for g in np.unique(rows.group):
        own = rows.group == g
        out[own] = predicted(fit(rows.x[~own], rows.right[~own]), rows.x[own])
    return out


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
    known = 'name', 'size', 'seed', 'beside', 'second', 'opened', 'case'
    key = [json.dumps([c.get(k) for k in known]) for c in cases]
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
        'provenance': 'benchmark/calibrate_probabilities.py on benchmark/posterior_cases.py and '
                      'parts 2 and 3 of the blind check, cross-validated by generator and effect',
        'regressors': ['gain_over_missing', 'no_other_beside'],
        'cases': rows.cases, 'intercept': round(float(w[0]), 3),
        'weights': np.round(w[1:], 3).tolist(), 'cross_validation': found}
    print(json.dumps(stored, indent=1))
    if arguments.write:
        FILE.write_text(json.dumps(stored, indent=1) + '\n')


if __name__ == '__main__':
    main()
