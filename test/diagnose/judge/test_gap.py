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


K = len(CHANNELS)
SECONDS_8 = 8 * SECOND, K
EXACT = Errors(np.zeros((K, 0, 0)), np.zeros((0, 0)))


def held(n):
    return SimpleNamespace(held=np.ones(n, dtype=bool), measured=SimpleNamespace(
        present=np.ones((n, K), dtype=bool)))


def gap_of(effect, left, errors=EXACT, beside=None, energy=0.0, noise=0.0):
    """Return the gap beside noise of 1, of which an effect is explained and something is left."""
    arms = Arms(effect + left + noise, np.zeros(effect.shape), effect,
                left if beside is None else beside)
    return gap((held(len(effect)),), [arms], np.ones(K), energy + np.zeros(K), errors)


def test_blocks_that_are_left_out_count_in_no_arm():
    rng = np.random.default_rng(8)
    effect, left = rng.standard_normal((2, *SECONDS_8))
    expected = gap_of(effect, 0.3 * left)
    present = np.arange(2 * len(effect)) < len(effect)
    arms = [np.concatenate([x, 50.0 + np.zeros(x.shape)]) for x in (
        effect + 0.3 * left, np.zeros(effect.shape), effect, 0.3 * left)]
    dataset = held(len(present))
    dataset.measured.present[~present] = False
    found = gap((dataset,), [Arms(*arms)], np.ones(K), np.zeros(K), EXACT)
    assert found == expected


def width(found):
    return found.closed_ci95[1] - found.closed_ci95[0]


def test_the_interval_of_few_blocks_is_wider_than_their_bootstrap():
    rng = np.random.default_rng(3)
    widths = []
    for seconds in (6, 60):
        effect = rng.standard_normal((seconds * SECOND, K))
        found = gap_of(effect, 0.3 * np.repeat(rng.standard_normal((seconds, K)), SECOND, axis=0))
        assert found.closed_ci95[0] < found.closed < found.closed_ci95[1] <= 1.0
        widths.append(width(found))
    # ten times the blocks: root of ten, and 1.44 against 1.03 for their number
    assert widths[0] > 1.1 * np.sqrt(10.0) * widths[1]


def test_what_was_taken_for_an_effect_counts_as_left_and_widens_the_interval():
    rng = np.random.default_rng(4)
    effect, left = 2.0 * rng.standard_normal(SECONDS_8), 0.3 * rng.standard_normal(SECONDS_8)
    known = np.full((K, 1, 1), 4.0), np.full((1, 1), 1e-4)
    found = [gap_of(effect, left, errors) for errors in (
        Errors(*known), Errors(*known, np.full((1, 1), 0.01), [left], np.full(K, 0.02)))]
    share = [1.0 - one.closed for one in found]
    # 0.3^2 + 4 * 1e-4 without, 4 * 0.01 + 0.02 more with it, all in 2^2 and what was left
    assert share[1] / share[0] == pytest.approx(np.sqrt(0.1504 / 0.0904), rel=0.05)
    assert width(found[1]) > 2.0 * width(found[0])
    # at least as wide as what is left is uncertain beside any discrepancy
    assert width(found[1]) > share[1] * (np.exp(1.9 * OFF) - np.exp(-1.9 * OFF))
    assert found[1].recalibrated == found[0].recalibrated


def test_no_more_is_taken_for_an_effect_than_it_explains():
    effect = np.random.default_rng(6).standard_normal(SECONDS_8)
    errors = Errors(np.ones((K, 1, 1)), np.zeros((1, 1)), np.full((1, 1), 100.0),
                    [np.zeros(SECONDS_8)], np.zeros(K))
    assert gap_of(effect, 0.0 * effect, errors).closed == pytest.approx(0.0)


def test_no_more_is_missed_than_effects_leave():
    rng = np.random.default_rng(7)
    effect, left = rng.standard_normal(SECONDS_8), 0.1 * rng.standard_normal(SECONDS_8)
    # of a channel whose discrepancy may be anything, blocks that were not fitted to say how much
    errors = Errors(np.ones((K, 1, 1)), np.zeros((1, 1)), np.zeros((1, 1)),
                    [np.zeros(SECONDS_8)], np.full(K, 50.0))
    found = gap_of(effect, left, errors, beside=0.0 * left)
    assert found.closed == pytest.approx(0.9, abs=0.01)


@pytest.mark.parametrize('share', [0.0, 1.0, 10.0])
def test_what_a_bin_shows_counts_once_however_well_it_is_predicted(share):
    rng = np.random.default_rng(5)
    effect, left = rng.standard_normal(SECONDS_8), 0.3 * rng.standard_normal(SECONDS_8)
    noise = 0.1 * rng.standard_normal(SECONDS_8)
    model = SimpleNamespace(residuals=[left + noise], datasets=(held(len(left)),),
                            noise=[SimpleNamespace(rms=lambda group: np.full(K, 0.1))])
    bins = [TimeFrequencyBin(c, 'move', (8.0, 16.0), 3.0, 2.0 * BIN_SIGMA) for c in range(K)]
    energy = unpredictable(model, bins, [share * left])
    found = gap_of(effect, left, beside=share * left, energy=energy, noise=noise)
    assert found.explained == pytest.approx(0.3, rel=0.02)
