"""Bounded Gaussian fits against a solver of another kind."""

from forcecal_ros.diagnose.model.evidence import fit, Gram, Prior
import numpy as np
import pytest
from scipy.optimize import lsq_linear


def test_a_bounded_fit_is_the_best_one_within_the_bounds_however_alike_the_columns_are():
    rng = np.random.default_rng(3)
    for _ in range(20):
        common = rng.standard_normal((400, 1))
        columns = common + 0.3 * rng.standard_normal((400, 6))
        data = columns @ rng.uniform(-6.0, 6.0, 6) + rng.standard_normal(400)
        gram = Gram(columns.T @ columns, columns.T @ data, float(data @ data), 400)
        low, high = np.where(rng.random(6) < 0.5, -3.0, 0.0), np.full(6, 3.0)
        found = fit(gram, Prior(np.zeros(6), np.ones(6), low, high)).x
        best = lsq_linear(np.vstack([columns, np.eye(6)]), np.append(data, np.zeros(6)),
                          (low, high), tol=1e-12).x
        assert found == pytest.approx(best, abs=1e-4)
