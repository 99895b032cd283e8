"""The variance of means and of weighted sums over coloured noise."""

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.noise.autocovariance import (
    andrews_lags,
    last_correlated_lag,
    noise_of_residuals,
    noise_of_windows,
)
from longer import first
import numpy as np
import pytest


def ar1(rng, rho, n, k=1):
    noise = rng.standard_normal((n, k))
    for i in range(1, n):
        noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho**2) * noise[i]
    return noise


@pytest.mark.parametrize('rho', first([-0.4, 0.6, 0.0, 0.3]))
def test_the_variance_of_a_mean_is_found_for_coloured_noise(rho):
    rng = np.random.default_rng(8)
    found = [noise_of_windows([ar1(rng, rho, 100) for _ in range(3)]).long_run[0, 0]
             for _ in range(100)]
    true = (1 + rho) / (1 - rho)
    # a tenth falls short where correlation fades into what 300 blocks can show
    assert np.mean(found) == pytest.approx(true, rel=0.12, abs=4 * np.std(found) / 10)


def test_too_short_a_standstill_is_refused():
    with pytest.raises(DataError, match='hold each pose'):
        noise_of_windows([np.zeros((4, 1))])


def newey_west(scores, lags):
    """Write the estimate of Newey and West as they print it, term by term."""
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        for t in range(lag, len(scores)):
            part = np.outer(scores[t], scores[t - lag])
            total = total + (1 - lag / (lags + 1)) * (part + part.T)
    return total


def test_the_long_run_covariance_of_residuals_is_that_of_newey_and_west():
    e = ar1(np.random.default_rng(13), 0.7, 200, 2)
    np.testing.assert_allclose(200 * noise_of_residuals(e, 6).long_run, newey_west(e, 6),
                               rtol=1e-12)


def test_the_covariance_of_scores_is_the_sum_over_all_pairs():
    rng = np.random.default_rng(15)
    x, noise = rng.standard_normal((150, 2)), noise_of_residuals(ar1(rng, 0.5, 400, 3), 7)
    expected = np.zeros((6, 6))
    for i in range(150):
        for lag, weight in enumerate([1.0, *noise.weights]):
            if i + lag < 150:
                part = weight * np.kron(np.outer(x[i], x[i + lag]), noise.lags[lag])
                expected += part + (part.T if lag else 0.0)
    np.testing.assert_allclose(noise.covariance_of_products(x), expected, rtol=1e-9, atol=1e-9)


def test_lags_grow_with_persistence_and_stay_within_the_series():
    rng = np.random.default_rng(17)
    few, many = (andrews_lags(ar1(rng, rho, 2000), 2000) for rho in (0.1, 0.9))
    assert few < many <= 500
    assert andrews_lags(np.ones((40, 1)), 40) == 10


@pytest.mark.parametrize('last', [0, 3])
def test_the_last_correlated_lag_of_a_moving_average_is_its_order(last):
    lags = np.zeros((25, 1, 1))
    lags[:last + 1, 0, 0] = np.linspace(1.0, 0.5, last + 1)
    # one more is kept where anything is: what fades goes on below what can be told from nothing
    assert last_correlated_lag(lags, 300) == (last + 1 if last else 0)


@pytest.mark.parametrize('channels', first([6, 1, 3]))
def test_white_noise_of_many_channels_seldom_seems_correlated(channels):
    rng = np.random.default_rng(5)
    found = [noise_of_windows([rng.normal(size=(50, channels)) for _ in range(3)])
             for _ in range(300)]
    assert sum(len(one.weights) > 0 for one in found) <= 12  # 1 % each, binomial 99.9 %: 10
    halved = [np.linalg.eigvalsh(one.long_run).min() < 0.5 for one in found]
    assert sum(halved) <= 12


@pytest.mark.long
def test_a_mean_of_white_noise_is_never_known_better_than_white_noise_tells():
    rng = np.random.default_rng(21)
    chi_square = []
    for _ in range(300):
        windows = [rng.standard_normal((50, 3)) for _ in range(3)]
        noise = noise_of_windows(windows)
        least = np.linalg.eigvalsh(noise.at_least_white - noise.covariance).min()
        assert least > -1e-9
        precision = np.linalg.inv(noise.at_least_white)
        chi_square += [50 * w.mean(axis=0) @ precision @ w.mean(axis=0) for w in windows]
    # three plus what 147 degrees of freedom add, and three standard errors; of 900 the largest
    assert np.mean(chi_square) < 3.08 + 3 * 0.08 and np.max(chi_square) < 22


def test_a_channel_without_noise_is_no_obstacle():
    values = np.random.default_rng(6).standard_normal((200, 2)) * [1.0, 0.0]
    assert np.isfinite(noise_of_windows([values]).at_least_white).all()
