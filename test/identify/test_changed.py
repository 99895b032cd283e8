"""What changed between static poses is named with its place, and a cable is none of it."""

from re import search

from forcecal_ros.identify.rejection import what_changed
from forcecal_ros.identify.static_readings import Statics
import numpy as np
import pytest

N = 12
TIMES = 5.0 * np.arange(N)
AFTER = (np.arange(N) >= 7)[:, None]


def said(change, seed=0):
    """Return what is said of poses whose wrench is changed by ``change(gravity)``, (n, 6)."""
    rng = np.random.default_rng(seed)
    down = rng.standard_normal((N, 3))
    g = 9.8 * down / np.linalg.norm(down, axis=1)[:, None]
    std = np.array([0.01] * 3 + [3e-4] * 3)
    wrench = load(g, 1.3, [0.01, 0.0, 0.07]) + [3, -5, 8, 0.1, -0.2, 0.05]
    wrench = wrench + change(g) + std * rng.standard_normal((N, 6))
    zeros = np.zeros(N)
    return what_changed(Statics(g, wrench, np.broadcast_to(np.diag(std**2), (N, 6, 6)), zeros,
                                zeros), TIMES)


def load(g, mass, com):
    return np.hstack([mass * g, np.cross(com, mass * g)])


def touched(g):
    off = np.zeros((N, 6))
    off[[2, 9], 0], off[[2, 9], 4] = [5.0, -3.0], [0.2, 0.4]
    return off


@pytest.mark.parametrize('change, words', [
    (lambda g: AFTER * [-2.0, 3.0, -8.0, -0.1, 0.1, 0.0],
     r'a bias that jumps between pose 7 and pose 8 \(30.0 to 35.0 s\): a sensor tared'),
    (lambda g: AFTER * load(g, 0.4, [0.0, 0.0, 0.15]),
     'a load that changes between pose 7 and pose 8'),
    (lambda g: AFTER * (load(g, 1.3, [0.01, 0.004, 0.07]) - load(g, 1.3, [0.01, 0.0, 0.07])),
     'a load that changes between pose 7 and pose 8'),
    (lambda g: 2.0 * (1.0 - np.exp(-TIMES / 60.0))[:, None] * np.ones(6), 'a bias that drifts'),
    (touched, 'without poses 3, 10 they fit one tool: a cable or a hand pulled')])
def test_the_one_change_is_named(change, words):
    for seed in range(10):
        assert search(words, said(change, seed)), said(change, seed)


def test_noise_and_a_cable_are_no_change():
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        assert not said(lambda g: np.zeros((N, 6)), seed)
        assert not said(lambda g, rng=rng: 0.5 * rng.standard_normal((N, 6)), seed)
