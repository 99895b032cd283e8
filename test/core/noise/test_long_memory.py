"""Noise with a long memory."""

from forcecal_ros.core.noise.autoregression import unpredicted
import numpy as np


def test_slow_noise_is_predicted_from_its_past_and_white_noise_is_not():
    rng = np.random.default_rng(1)
    white = rng.standard_normal(10_000)
    slow = white + np.cumsum(rng.standard_normal(10_000)) * 0.02
    rows = np.ones(10_000, dtype=bool)
    assert unpredicted(white, rows) > white @ white - 5.0 * 4.0 * np.sqrt(2.0)
    assert unpredicted(slow, rows) < 0.9 * (slow @ slow)
