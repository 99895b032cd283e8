"""What recordings show of themselves before any model."""

from types import SimpleNamespace
from typing import Any

from forcecal_ros.diagnose.dataset import possible_effects
from forcecal_ros.effects import EFFECTS
import numpy as np


def test_a_load_turns_for_twice_the_width_of_a_hysteresis():
    wrench = np.zeros((100, 6))
    wrench[:, 0] = np.linspace(-10.0, 20.0, 100)
    dataset: Any = SimpleNamespace(simulation=SimpleNamespace(library=EFFECTS),
                              nominal=SimpleNamespace(wrench=wrench))
    effect = possible_effects([dataset])['wrench_hysteresis']
    width, = (q for q in effect.parameters if q.name == 'width')
    assert (width.high, width.starts) == (15.0, (0.5, 2.0, 10.0))
