"""Errors of parameters in the gap."""

from types import SimpleNamespace

from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.gap import Arms, gap, OFF, SECOND, unpredictable
from forcecal_ros.diagnose.judge.parameter_errors import Errors
from forcecal_ros.diagnose.localise import BIN_SIGMA, TimeFrequencyBin
import numpy as np
import pytest


def test_errors_of_parameters_are_drawn_as_large_as_they_are_expected():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((16, 3, 3))
    errors = Errors(root @ np.swapaxes(root, 1, 2), np.diag([1.0, 4.0, 0.25]))
    draws = np.array([errors.of_parameters(rng) for _ in range(2000)])
    scatter = draws.std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(draws.mean(axis=0) - errors.of_parameters()) < 5.0 * scatter).all()


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


def test_what_was_taken_for_an_effect_counts_as_left_and_widens_the_interval():
    n, k = 8 * SECOND, len(CHANNELS)
    rng = np.random.default_rng(4)
    held = SimpleNamespace(held=np.ones(n, dtype=bool))
    effect, left = 2.0 * rng.standard_normal((n, k)), 0.3 * rng.standard_normal((n, k))
    arms = [Arms(effect + left, np.zeros((n, k)), effect, left)]
    grams, covariance = np.full((k, 1, 1), 4.0), np.full((1, 1), 1e-4)
    noise, nothing = np.ones(k), np.zeros(k)
    own = [left], np.full(k, 0.02)
    found = [gap((held,), arms, noise, nothing, errors) for errors in (
        Errors(grams, covariance), Errors(grams, covariance, np.full((1, 1), 0.01), *own))]
    small, large = (one.closed_ci95[1] - one.closed_ci95[0] for one in found)
    share = [1.0 - one.closed for one in found]
    # 0.3^2 + 4 * 1e-4 without, 4 * 0.01 + 0.02 more with it, all in 2^2 and what was left
    assert share[1] / share[0] == pytest.approx(np.sqrt(0.1504 / 0.0904), rel=0.05)
    assert large > 2.0 * small
    # at least as wide as what is left is uncertain beside any discrepancy
    assert large > share[1] * (np.exp(1.9 * OFF) - np.exp(-1.9 * OFF))
    assert found[1].recalibrated == found[0].recalibrated


def test_no_more_is_taken_for_an_effect_than_it_explains():
    n, k = 8 * SECOND, len(CHANNELS)
    held = SimpleNamespace(held=np.ones(n, dtype=bool))
    effect = np.random.default_rng(6).standard_normal((n, k))
    arms = [Arms(effect, np.zeros((n, k)), effect, np.zeros((n, k)))]
    errors = Errors(np.ones((k, 1, 1)), np.zeros((1, 1)), np.full((1, 1), 100.0),
                    [np.zeros((n, k))], np.zeros(k))
    assert gap((held,), arms, np.ones(k), np.zeros(k), errors).closed == pytest.approx(0.0)


def test_no_more_is_missed_than_effects_leave():
    n, k = 8 * SECOND, len(CHANNELS)
    rng = np.random.default_rng(7)
    held = SimpleNamespace(held=np.ones(n, dtype=bool))
    effect, left = rng.standard_normal((n, k)), 0.1 * rng.standard_normal((n, k))
    arms = [Arms(effect + left, np.zeros((n, k)), effect, np.zeros((n, k)))]
    # of a channel whose discrepancy may be anything, blocks that were not fitted to say how much
    errors = Errors(np.ones((k, 1, 1)), np.zeros((1, 1)), np.zeros((1, 1)),
                    [np.zeros((n, k))], np.full(k, 50.0))
    found = gap((held,), arms, np.ones(k), np.zeros(k), errors)
    assert found.closed == pytest.approx(0.9, abs=0.01)


@pytest.mark.parametrize('share', [0.0, 1.0, 10.0])
def test_what_a_bin_shows_counts_once_however_well_it_is_predicted(share):
    n, k = 8 * SECOND, len(CHANNELS)
    rng = np.random.default_rng(5)
    held = SimpleNamespace(held=np.ones(n, dtype=bool))
    effect, left = rng.standard_normal((n, k)), 0.3 * rng.standard_normal((n, k))
    noise = 0.1 * rng.standard_normal((n, k))
    level = SimpleNamespace(rms=lambda group: np.full(k, 0.1))
    model = SimpleNamespace(residuals=[left + noise], datasets=(held,), noise=[level])
    bins = [TimeFrequencyBin(c, 'move', (8.0, 16.0), 3.0, 2.0 * BIN_SIGMA) for c in range(k)]
    energy = unpredictable(model, bins, [share * left])
    arms = [Arms(effect + left + noise, np.zeros((n, k)), effect, share * left)]
    found = gap((held,), arms, np.ones(k), energy)
    assert found.explained == pytest.approx(0.3, rel=0.02)
