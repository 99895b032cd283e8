"""Errors of parameters in the gap."""

from types import SimpleNamespace

from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.judge.gap import Arms, Errors, gap, SECOND
import numpy as np


def test_errors_of_parameters_are_drawn_as_large_as_they_are_expected():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((16, 3, 3))
    errors = Errors(root @ np.swapaxes(root, 1, 2), np.diag([1.0, 4.0, 0.25]))
    draws = np.array([errors.drawn(rng) for _ in range(2000)])
    scatter = draws.std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(draws.mean(axis=0) - errors.expected()) < 5.0 * scatter).all()


def test_the_interval_of_few_blocks_is_wider_than_their_bootstrap():
    rng = np.random.default_rng(3)
    widths = []
    for seconds in (6, 60):
        n = seconds * SECOND
        held = SimpleNamespace(held=np.ones(n, dtype=bool))
        effect = rng.standard_normal((n, len(CHANNELS)))
        left = 0.3 * np.repeat(rng.standard_normal((seconds, len(CHANNELS))), SECOND, axis=0)
        arms = Arms(effect + left, np.zeros_like(effect), effect, left)
        noise, nothing = np.ones(len(CHANNELS)), np.zeros(len(CHANNELS))
        found = gap((held,), [arms], noise, nothing)
        assert found.closed_ci95[0] < found.closed < found.closed_ci95[1] <= 1.0
        widths.append(found.closed_ci95[1] - found.closed_ci95[0])
    # ten times the blocks: root of ten, and 1.44 against 1.03 for their number
    assert widths[0] > 1.1 * np.sqrt(10.0) * widths[1]
