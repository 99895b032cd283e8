"""Limits of a channel, found in noise."""

from forcecal_ros.diagnose.model.hypotheses import _best_limit
import numpy as np
import pytest


def test_a_soft_limit_under_noise_is_found_where_it_is():
    rng = np.random.default_rng(0)
    signal = 100.0 * np.sin(np.linspace(0.0, 60.0, 6000))
    measured = np.clip(signal, -80.0, 80.0) + 0.3 * rng.standard_normal(6000)
    limit, removed = _best_limit(signal, measured, 0.1, 1e4)
    assert limit == pytest.approx(80.0, abs=100.0 * 0.5 / 40)
    assert removed > 0.9 * np.sum((measured - signal) ** 2)


def test_a_limit_below_the_range_of_a_sensor_is_none():
    rng = np.random.default_rng(0)
    signal = 0.15 * np.sin(np.linspace(0.0, 60.0, 6000))
    measured = np.clip(signal, -0.08, 0.08) + 1e-3 * rng.standard_normal(6000)
    limit, removed = _best_limit(signal, measured, 0.1, 1e4)
    assert limit >= 0.1 and removed > 0.0
    assert _best_limit(signal, measured, 0.2, 1e4) == (0.0, 0.0)
