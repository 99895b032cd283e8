"""Gaussian filters as mathematics: linear cases against closed forms, the others against sums."""

from forcecal_ros.observe.gaussian import (
    ALPHA,
    BETA,
    condition,
    expect,
    expect_linear,
    Expected,
    Function,
    Gaussian,
    mahalanobis,
    NotPositiveDefinite,
    predict,
    transform,
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


SUMS = Function(lambda x: SUM @ x, lambda x, dx: dx @ SUM.T)


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


def test_sigma_points_of_a_linear_model_are_the_same_filter():
    rng = np.random.default_rng(2)
    belief = Gaussian(rng.normal(size=12), covariance(rng, 12))
    y = rng.normal(size=6)
    one, other = (condition(belief, expected, y) for expected in (
        expect(belief, SUMS, R), expect_linear(belief, SUM, 0.0, R)))
    assert one.mean == pytest.approx(other.mean, abs=1e-9)
    assert one.cov == pytest.approx(other.cov, abs=1e-9)


@given(seed=st.integers(0, 2 ** 32 - 1))
@settings(max_examples=30, deadline=None)
def test_sums_by_pairs_are_the_textbook_sums(seed):
    rng = np.random.default_rng(seed)
    belief = Gaussian(1 + rng.normal(size=2), covariance(rng, 2, 0.1))
    got = transform(belief, by_subtraction(square_and_product))
    mean, cov, cross = textbook(*belief, square_and_product)
    # by_subtraction loses digits with 1/alpha^2, the textbook's long sums lose fewer
    assert got.mean == pytest.approx(mean.astype(float), rel=1e-6, abs=1e-6)
    assert got.cov == pytest.approx(cov.astype(float), rel=1e-5, abs=1e-5)
    assert got.cross == pytest.approx(cross.astype(float), rel=1e-5, abs=1e-5)


def test_the_mean_of_a_square_is_exact():
    square = Function(lambda x: x ** 2, lambda x, dx: 2 * x * dx + dx ** 2)
    got = transform(Gaussian(np.array([3.0]), np.array([[0.5]])), square)
    assert got.mean[0] == pytest.approx(9.5, abs=1e-12)
    # 4 m^2 P + 2 P^2, with beta = 2 exact for Gaussians
    assert got.cov[0, 0] == pytest.approx(4 * 9 * 0.5 + 2 * 0.25, rel=1e-5)


@given(seed=st.integers(0, 2 ** 32 - 1))
@settings(max_examples=30, deadline=None)
def test_conditioning_is_the_posterior_of_the_joint_precision(seed):
    rng = np.random.default_rng(seed)
    joint = covariance(rng, 7, 0.3)
    belief = Gaussian(rng.normal(size=4), joint[:4, :4])
    expected = Expected(rng.normal(size=3), joint[4:, 4:], joint[:4, 4:])
    reading = rng.normal(size=3)
    precision = np.linalg.inv(joint)
    cov = np.linalg.inv(precision[:4, :4])
    mean = belief.mean - cov @ precision[:4, 4:] @ (reading - expected.mean)
    got = condition(belief, expected, reading)
    scale = np.abs(joint).max() * np.linalg.cond(joint) * 1e-14
    assert got.mean == pytest.approx(mean, abs=scale)
    assert got.cov == pytest.approx(cov, abs=scale)


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


def test_mahalanobis_distance_counts_standard_deviations():
    assert mahalanobis(np.array([3.0, 0.0]), np.diag([9.0, 1.0])) == pytest.approx(1.0)


def test_a_covariance_that_is_none_is_refused():
    with pytest.raises(NotPositiveDefinite, match='minor 2 of 2'):
        transform(Gaussian(np.zeros(2), np.diag([1.0, -1.0])), by_subtraction(np.sin))
    with pytest.raises(NotPositiveDefinite):
        mahalanobis(np.zeros(2), np.full((2, 2), np.nan))
