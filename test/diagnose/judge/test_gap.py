"""Errors of parameters in the gap."""

from forcecal_ros.diagnose.judge.gap import Errors
import numpy as np


def test_errors_of_parameters_are_drawn_as_large_as_they_are_expected():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((16, 3, 3))
    errors = Errors(root @ np.swapaxes(root, 1, 2), np.diag([1.0, 4.0, 0.25]))
    draws = np.array([errors.drawn(rng) for _ in range(2000)])
    scatter = draws.std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(draws.mean(axis=0) - errors.expected()) < 5.0 * scatter).all()
