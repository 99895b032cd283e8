"""White noise beneath motion."""

from forcecal_ros.core.noise.white import white_covariance
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
