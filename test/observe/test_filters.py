"""Gaussian filters as mathematics: linear cases against closed forms, the others against sums."""

from forcecal_ros.observe.gaussian import (
    ALPHA,
    BETA,
    condition,
    expect,
    expect_linear,
    Function,
    Gaussian,
    mahalanobis,
    NotPositiveDefinite,
    predict,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

SUM = np.hstack([np.eye(6), np.eye(6)])
R = np.diag([0.05 ** 2] * 3 + [0.003 ** 2] * 3)


def covariance(rng, n, spread=1.0):
    root = rng.normal(size=(n, n))
    scale = np.exp(spread * rng.normal(size=n))
    return scale[:, None] * (root @ root.T + 0.1 * np.eye(n)) * scale


def square_and_product(x):
    return np.array([x[0] ** 2, x[0] * x[1], np.sin(x[1]), np.hypot(x[0], x[1])])


def by_subtraction(value):
    """Differences as they come, for functions whose digits do not matter here."""
    return Function(value, lambda x, dx: np.array([value(x + row) - value(x) for row in dx]))


def textbook(mean, cov, value):
    """Return the weighted sums as [Ukf2025] prints them, in numbers of 64 bits of mantissa."""
    n = len(mean)
    alpha, beta = np.longdouble(ALPHA), np.longdouble(BETA)
    lam = alpha ** 2 * n - n
    root = np.sqrt(n + lam) * np.linalg.cholesky(cov).astype(np.longdouble)
    x0 = mean.astype(np.longdouble)
    points = [x0, *(x0 + root.T), *(x0 - root.T)]
    wm = np.full(2 * n + 1, 0.5 / (n + lam))
    wm[0] = lam / (n + lam)
    wc = wm.copy()
    wc[0] += 1 - alpha ** 2 + beta
    y = np.array([value(p) for p in points])
    mean_y = wm @ y
    dy, dx = y - mean_y, np.array(points) - x0
    return mean_y, (wc[:, None] * dy).T @ dy, (wc[:, None] * dx).T @ dy


@pytest.mark.parametrize('size', [1.0, 1e4])
def test_twelve_states_on_a_linear_model_are_the_exact_kalman_filter(size):
    rng = np.random.default_rng(1)
    A, Q = np.diag([0.99] * 6 + [1.0] * 6), np.diag([1e-4] * 6 + [1e-9] * 6)
    belief = Gaussian(size * rng.normal(size=12), np.diag([1.0] * 3 + [0.1] * 3 + [0.01] * 6))
    exact = belief
    worst = 0.0
    for _ in range(300):
        load, y = size * rng.normal(size=6), size * rng.normal(size=6)
        belief = predict(belief, A, Q)
        belief = condition(belief, expect_linear(belief, SUM, load, R), y)
        prior = A @ exact.cov @ A.T + Q
        K = np.linalg.solve(SUM @ prior @ SUM.T + R, SUM @ prior).T
        mean = A @ exact.mean
        exact = Gaussian(mean + K @ (y - load - SUM @ mean), prior - K @ SUM @ prior)
        worst = max(worst, np.abs(belief.mean - exact.mean).max() / size,
                    np.abs(belief.cov - exact.cov).max())
    assert worst < 1e-9


@given(seed=st.integers(0, 2 ** 32 - 1))
@settings(max_examples=30, deadline=None)
def test_sums_by_pairs_are_the_textbook_sums(seed):
    rng = np.random.default_rng(seed)
    belief = Gaussian(1 + rng.normal(size=2), covariance(rng, 2, 0.1))
    got = expect(belief, by_subtraction(square_and_product), np.zeros((4, 4)))
    mean, cov, cross = textbook(*belief, square_and_product)
    # by_subtraction loses digits with 1/alpha^2, the textbook's long sums lose fewer
    assert got.mean == pytest.approx(mean.astype(float), rel=1e-6, abs=1e-6)
    assert got.cov == pytest.approx(cov.astype(float), rel=1e-5, abs=1e-5)
    assert got.cross == pytest.approx(cross.astype(float), rel=1e-5, abs=1e-5)


@given(seed=st.integers(0, 2 ** 32 - 1))
@settings(max_examples=30, deadline=None)
def test_frozen_states_stay_and_the_rest_is_schmidt_s_filter(seed):
    rng = np.random.default_rng(seed)
    belief = Gaussian(rng.normal(size=12), covariance(rng, 12, 0.2))
    y, frozen = rng.normal(size=6), slice(6, 12)
    got = condition(belief, expect_linear(belief, SUM, 0.0, R), y, frozen)
    S = SUM @ belief.cov @ SUM.T + R
    K = np.linalg.solve(S, SUM @ belief.cov).T
    K[frozen] = 0
    J = np.eye(12) - K @ SUM
    assert got.mean == pytest.approx(belief.mean + K @ (y - SUM @ belief.mean), abs=1e-8)
    assert got.cov == pytest.approx(J @ belief.cov @ J.T + K @ R @ K.T,
                                    abs=1e-10 * np.abs(belief.cov).max())
    assert (got.cov[frozen, frozen] == belief.cov[frozen, frozen]).all()
    assert np.linalg.eigvalsh(got.cov).min() > -1e-10 * np.abs(belief.cov).max()


def test_a_covariance_that_is_none_is_refused():
    with pytest.raises(NotPositiveDefinite, match='minor 2 of 2'):
        expect(Gaussian(np.zeros(2), np.diag([1.0, -1.0])), by_subtraction(np.sin), np.eye(2))
    with pytest.raises(NotPositiveDefinite):
        mahalanobis(np.zeros(2), np.full((2, 2), np.nan))
