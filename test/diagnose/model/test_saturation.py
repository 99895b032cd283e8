"""Limits of a channel, found in noise."""

from forcecal_ros.diagnose.model.hypotheses import _best_limit
import numpy as np
import pytest


def found(size, limit, noise, low=0.1, seed=0):
    """Return the limit found in a sine of some size that is read up to a limit."""
    rng = np.random.default_rng(seed)
    signal = size * np.sin(np.linspace(0.0, 60.0, 6000))
    measured = np.clip(signal, -limit, limit) + noise * rng.standard_normal(6000)
    return _best_limit(signal, measured, low, 1e4, noise)


def test_a_soft_limit_under_noise_is_found_where_it_is():
    assert found(100.0, 80.0, 0.3) == pytest.approx(80.0, abs=100.0 * 0.5 / 40)


def test_a_limit_below_the_range_of_a_sensor_is_none():
    assert found(0.15, 0.08, 1e-3) >= 0.1
    assert found(0.15, 0.08, 1e-3, low=0.2) == 0.0


def test_noise_alone_makes_no_limit():
    assert not any(found(1.0, 9.0, 0.3, seed=seed) for seed in range(20))
