"""How much of a noisy pose is motion."""

from forcecal_ros.sim.signals import clear_band, LEAST, MOST
import numpy as np
import pytest

RATE = 250.0
T = np.arange(0.0, 30.0, 1.0 / RATE)


def waved(frequency, noise, seed=0):
    rng = np.random.default_rng(seed)
    return np.outer(np.sin(2 * np.pi * frequency * T), [1e-2, 0.0, 5e-3]) \
        + noise * rng.normal(size=(len(T), 3))


@pytest.mark.parametrize('frequency', [2.0, 5.0, 9.0])
def test_it_ends_where_the_motion_ends(frequency):
    assert clear_band(waved(frequency, 1e-4), RATE) == pytest.approx(frequency, abs=1.0)


def test_noise_alone_has_the_least_and_what_is_too_slow_to_tell_the_most():
    assert clear_band(waved(2.0, 1e-4) * [0, 1, 0], RATE) == LEAST
    assert clear_band(waved(2.0, 1e-4)[::5], RATE / 5) == MOST
    assert clear_band(waved(2.0, 1e-4)[:500], RATE) == MOST
