"""What recordings show of themselves before any model."""

from types import SimpleNamespace

from forcecal_ros.diagnose.dataset import possible_effects
from forcecal_ros.effects import EFFECTS
import numpy as np
import pytest


def dataset(values):
    """Stand in for a dataset by what the library is narrowed by."""
    return SimpleNamespace(
        simulation=SimpleNamespace(library=EFFECTS), nominal=SimpleNamespace(wrench=values),
        measured=SimpleNamespace(streams=('wrench',), values=lambda stream: values))


def lowest(values, name):
    effect = possible_effects([dataset(values)])['wrench_saturation']
    return next(q.low for q in effect.parameters if q.name == name)


def test_a_load_turns_for_twice_the_width_of_a_hysteresis():
    wrench = np.zeros((100, 6))
    wrench[:, 0] = np.linspace(-10.0, 20.0, 100)
    effect = possible_effects([dataset(wrench)])['wrench_hysteresis']
    width, = (q for q in effect.parameters if q.name == 'width')
    assert (width.high, width.starts) == (15.0, (0.5, 2.0, 10.0))


def test_a_range_does_not_end_where_readings_go_on():
    """A vibrating axis (0.3 N about -0.9 N): a limit of 0.95 N had been found in it."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 6.0, 1.4e-3)
    wrench = np.zeros((len(t), 6))
    wrench[:, 1] = -0.9 + 0.42 * np.sin(2.0 * np.pi * 21.0 * t) \
        + 0.01 * rng.standard_normal(len(t))
    assert lowest(wrench, 'fy') == pytest.approx(1.25, abs=0.1)
    clipped = np.clip(wrench, -0.95, 0.95)
    assert lowest(clipped, 'fy') < 0.95
    # also if the noise comes after the limit
    assert lowest(clipped + 0.05 * rng.standard_normal(clipped.shape), 'fy') < 0.95
