"""Bounded Gaussian fits against a solver of another kind."""

from forcecal_ros.diagnose.model.evidence import fit, Gram, Prior
import numpy as np
import pytest
from scipy.optimize import lsq_linear


@pytest.mark.parametrize('seed', [0, 11, 119])  # at the last two, clipping goes round in circles
def test_a_bounded_fit_is_the_best_one_within_the_bounds_however_alike_the_columns_are(seed):
    rng, k = np.random.default_rng(seed), 12
    common = rng.standard_normal((400, 2))
    columns = common @ rng.standard_normal((2, k)) + 0.05 * rng.standard_normal((400, k))
    data = columns @ rng.uniform(-6.0, 6.0, k) + rng.standard_normal(400)
    gram = Gram(columns.T @ columns, columns.T @ data, float(data @ data), 400)
    low, high = np.where(rng.random(k) < 0.5, -3.0, 0.0), np.full(k, 3.0)
    prior = Prior(np.zeros(k), np.ones(k), low, high)
    best = lsq_linear(np.vstack([columns, np.eye(k)]), np.append(data, np.zeros(k)),
                      (low, high), method='bvls', tol=1e-12).x
    found = fit(gram, prior)
    assert found.x == pytest.approx(best, abs=1e-6)
    # those of a part of the columns begin it
    half = np.arange(k // 2)
    near = fit(gram.of(half), Prior(*(one[half] for one in prior)))
    assert fit(gram, prior, near).x == pytest.approx(best, abs=1e-6)


def test_beside_a_number_at_its_limit_an_alias_of_it_is_known_no_better_than_without_that_limit():
    rng = np.random.default_rng(0)
    own = rng.standard_normal((400, 3))
    columns = 5.0 * np.column_stack([own[:, 0], own[:, 0] + 0.1 * own[:, 1], own[:, 2]])
    true, every = np.array([-5.0, 0.3, 1.0]), np.full(3, 3.0)  # five of its sigma off
    data = columns @ true + rng.standard_normal(400)
    gram = Gram(columns.T @ columns, columns.T @ data, float(data @ data), 400)
    prior = Prior(np.zeros(3), np.ones(3), -every, every)
    found = fit(gram, prior)
    std = np.sqrt(np.diag(found.marginal_covariance(
        gram, prior, np.full(3, -np.inf), np.zeros((3, 3)))))
    assert found.x[0] == -3.0 and std[0] == 0.0
    assert abs(found.x[1] - true[1]) > 50.0 * np.sqrt(found.covariance[1, 1])
    assert abs(found.x[1] - true[1]) < 3.0 * std[1]
    assert abs(found.x[2] - true[2]) < 3.0 * std[2] < 0.1  # of what is no alias nothing is lost
    free = prior._replace(low=np.full(3, -np.inf), high=np.full(3, np.inf))
    unbounded = fit(gram, free)
    assert unbounded.marginal_covariance(gram, free, free.low, np.zeros((3, 3))) == pytest.approx(
        unbounded.covariance)
