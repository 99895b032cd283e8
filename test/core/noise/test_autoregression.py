"""Whitening by autoregressions, and noise with a longer memory."""

from forcecal_ros.core.noise.autoregression import (
    AT_ONCE,
    at_standstill,
    fit_autoregression,
    unpredicted,
)
from longer import first
import numpy as np
import pytest


def test_whitened_noise_is_white_whatever_its_colour():
    rng = np.random.default_rng(0)
    n = 20_000
    white = rng.standard_normal((n, 16))
    coloured = white.copy()
    for k in range(1, n):
        coloured[k] += 0.9 * coloured[k - 1]
    noise = fit_autoregression(coloured, np.ones((n, 16), dtype=bool), np.zeros(n, dtype=int))
    w = noise.whiten(coloured[:, 0][np.newaxis], 0)[0][8:]
    assert abs(w.var() - 1.0) < 5.0 * np.sqrt(2.0 / n)
    assert abs(w[1:] @ w[:-1]) / n < 5.0 / np.sqrt(n)


def test_a_constant_is_no_noise_and_counts_against_noise_that_is_fitted_beside_it():
    rng = np.random.default_rng(4)
    residual = np.zeros((3000, 16))
    residual[:, 0] = 40.0 + rng.standard_normal(3000)
    noise = fit_autoregression(residual, np.ones((3000, 16), dtype=bool),
                               np.zeros(3000, dtype=np.intp))
    constant = noise.whiten(np.full((1, 3000), 40.0), 0)[0, 8:]
    # sum of 8 coefficients of white noise: 8 / sqrt(3000) at 5 sigma would be 0.26 of it
    assert constant.mean() == pytest.approx(40.0, rel=0.3)


def test_noise_at_standstill_knows_nothing_of_a_gap_that_shows_in_motion():
    rng = np.random.default_rng(5)
    groups = np.repeat(np.array([0, 1, 0, 1], dtype=np.intp), 1000)
    residual = np.zeros((4000, 16))
    residual[:, 0] = rng.standard_normal(4000) + 5.0 * (np.arange(4000) > 2000)
    residual[groups == 1, 0] += 100.0 * np.sin(np.arange(2000) / 5.0)
    own = fit_autoregression(residual, np.ones((4000, 16), dtype=bool), groups)
    rest = at_standstill(residual, own)
    assert rest.sigma[:, 0] == pytest.approx(1.0, abs=5.0 / np.sqrt(2.0 * 2000))
    moving = rest.whiten(residual[:, :1].T, 0)[0, groups == 1]
    hidden = own.whiten(residual[:, :1].T, 0)[0, groups == 1]
    assert np.std(moving) > 10.0 * np.std(hidden)


def test_the_rms_of_an_autoregression_is_that_of_its_process():
    rng = np.random.default_rng(6)
    n, e = 50_000, rng.standard_normal(50_000)
    for k in range(1, n):
        e[k] += 0.8 * e[k - 1]
    noise = fit_autoregression(e[:, None], np.ones((n, 1), dtype=bool), np.zeros(n, dtype=np.intp))
    # variance of AR(1) over that of its innovations; n (1 - rho) / (1 + rho) independent samples
    assert noise.rms()[0] == pytest.approx(1 / np.sqrt(1 - 0.8 ** 2), rel=5 / np.sqrt(2 * n / 9))


@pytest.mark.parametrize('spacing', [1.25, 2.5, 12.5])
def test_samples_that_are_some_blocks_apart_have_noise_too(spacing):
    rng = np.random.default_rng(6)
    there = np.unique(np.floor(spacing * np.arange(3000)).astype(int))
    present = np.zeros((there[-1] + 1, 1), dtype=bool)
    present[there] = True
    residual = np.zeros(present.shape)
    residual[there, 0] = 2.0 * rng.standard_normal(len(there))
    noise = fit_autoregression(residual, present, np.zeros(len(present), dtype=np.intp))
    # 3000 samples: 1.3 %
    assert noise.rms()[0] == pytest.approx(2.0, rel=0.07)
    assert noise.spacing(0) == pytest.approx(spacing, rel=0.2)
    white = noise.whiten(residual.T, 0)[0]
    assert not white[~present[:, 0]].any()
    assert white[noise.rows[:, 0]].std() == pytest.approx(1.0, rel=0.07)
    assert noise.rows.sum() > 0.5 * len(there)


@pytest.mark.parametrize('lost', first([0.1, 0.0]))
def test_a_product_with_a_weighed_signal_is_that_of_whitened_ones_over_the_same_blocks(lost):
    rng, n = np.random.default_rng(5), 2000
    present = rng.random((n, 2)) >= lost
    noise = fit_autoregression(np.cumsum(rng.standard_normal((n, 2)), axis=0), present,
                               np.repeat([0, 1, 2, 1], 500))
    signals, blocks = rng.standard_normal((3, n)), np.arange(n) % 700 < 400
    white = noise.whiten(signals, 1)
    assert noise.rows[blocks, 1].sum() > 300
    for signal, own in zip(signals, white):
        assert signals @ noise.weigh(signal, 1, blocks) == pytest.approx(white @ (own * blocks))


@pytest.mark.parametrize(('lost', 'whole'), [(0.0, 1), (0.1, 1), (0.0, 300)])
def test_pieces_are_whitened_to_the_same_bits_as_all_at_once(lost, whole):
    rng, n = np.random.default_rng(6), 2 * AT_ONCE + 500
    present = rng.random((n, 2)) >= lost
    noise = fit_autoregression(rng.standard_normal((n, 2)), present, np.arange(n) // 700 % 3)
    rows = rng.standard_normal((3, n))
    found = list(noise.whiten_in_pieces(lambda part: rows[:, part], 1, whole))
    assert [part.start % whole for part, _ in found] == [0] * 3
    assert [part.stop for part, _ in found[:-1]] == [part.start for part, _ in found[1:]]
    white = np.concatenate([piece for _, piece in found], axis=1)
    assert white.any()
    np.testing.assert_array_equal(white, noise.whiten(rows, 1))


def test_a_noise_stays_in_channels_where_another_brings_no_more_than_chance():
    rng, n = np.random.default_rng(7), 6000
    present, groups = np.ones((n, 2), dtype=bool), np.repeat([0, 1], n // 2)
    residual = rng.standard_normal((n, 2))
    noise = fit_autoregression(residual, present, groups)
    alike = residual + 0.02 * rng.standard_normal((n, 2))
    assert noise.or_better(fit_autoregression(alike, present, groups), alike) is noise
    for louder in (residual * np.where(groups, 1.1, 1.0)[:, np.newaxis],
                   residual + 0.3 * np.roll(residual, 1, axis=0)):
        one = np.stack([residual[:, 0], louder[:, 1]], axis=1)
        other = fit_autoregression(one, present, groups)
        taken = noise.or_better(other, one)
        assert taken.same(noise, 0) and not taken.same(noise, 1)
        assert taken.same(other, 1)


def test_slow_noise_is_predicted_from_its_past_and_white_noise_is_not():
    rng = np.random.default_rng(1)
    white = rng.standard_normal(10_000)
    slow = white + np.cumsum(rng.standard_normal(10_000)) * 0.02
    rows = np.ones(10_000, dtype=bool)
    assert unpredicted(white, rows) > white @ white - 5.0 * 4.0 * np.sqrt(2.0)
    assert unpredicted(slow, rows) < 0.9 * (slow @ slow)
