"""White noise beneath motion, and what rounding leaves of it in a mean."""

from forcecal_ros.core.noise.white import rounding_variance, white_covariance
import numpy as np
import pytest


@pytest.mark.parametrize('order', [1, 2, 3])
def test_white_noise_is_found_beneath_motion(order):
    rng = np.random.default_rng(6)
    n = 20000
    mix = np.array([[0.05, 0.0], [0.03, 0.2]])
    noise = rng.normal(size=(n, 2)) @ mix.T
    found = white_covariance(noise + np.sin(2 * np.pi * np.arange(n) / 5000)[:, None], order)
    # differences are correlated: fewer than n / 3 independent samples, five sigma
    scale = np.sqrt(np.outer(np.diag(mix @ mix.T), np.diag(mix @ mix.T)))
    np.testing.assert_allclose(found / scale, mix @ mix.T / scale, atol=5 * np.sqrt(6 / n))


@pytest.mark.parametrize('sigma', [0.0, 0.1, 0.2, 0.3, 0.5])
def test_means_of_rounded_readings_scatter_as_stated(sigma):
    rng = np.random.default_rng(4)
    levels = rng.uniform(-50.0, 50.0, 2000)
    read = np.rint(levels[:, None] + sigma * rng.standard_normal((2000, 500)))
    off = (read.mean(axis=1) - levels).var()
    white = (sigma**2 + 1.0 / 12.0 * (sigma > 0.0)) / 500
    stated = rounding_variance(0.01, 1e-4 * float(read.var(axis=1).mean())) / 1e-4
    assert off == pytest.approx(stated + white, rel=0.25, abs=2e-4)


def test_what_does_not_come_in_steps_is_not_rounded():
    assert rounding_variance(0.0, 1.0) == 0.0
