"""Claims about the robust fit: its standard errors, and its scales."""

from forcecal_ros.core.estimation import robust_fit
from longer import first
import numpy as np
import pytest


def regression(seed, channels, n=1200):
    """Regress on a line and a constant, in noise of two sizes, a tenth of it touched."""
    rng = np.random.default_rng(seed)
    X = np.stack([np.broadcast_to(np.linspace(-1.0, 1.0, n)[:, None], (n, channels)),
                  np.ones((n, channels))], axis=2)
    loud = np.arange(n) % 2
    y = X @ [2.0, -1.0] + (1.0 + 4.0 * loud)[:, None] * rng.normal(size=(n, channels))
    touched = (np.arange(n) // 20 % 10 == seed % 10)[:, None]
    return X, y + 30.0 * touched * rng.normal(size=(n, channels)), loud


@pytest.mark.parametrize('channels', first([3, 1]))
def test_standard_errors_are_those_of_the_errors_however_many_channels_a_group_has(channels):
    off = []
    for seed in range(120):
        X, y, loud = regression(seed, channels)
        fit = robust_fit(X, y, groups=loud, channels=channels)
        off.append((fit.theta - [2.0, -1.0]) / fit.std)
    np.testing.assert_allclose(np.sqrt(np.square(off).mean(axis=0)), 1.0, atol=0.2)


SHOWN = {
    'in all blocks': lambda rng, t: rng.normal(size=(len(t), 16)),
    'in a sixteenth each': lambda rng, t: np.arange(16) == np.floor(16 * t)[:, None],
    'in one block each': lambda rng, t: (2 * np.arange(16) == np.floor(40 * t)[:, None])
    * rng.normal(size=(len(t), 16))}
"""Columns of regressors by the time at which they differ from 0, from 0 to 1."""


@pytest.mark.parametrize('shown', SHOWN)
def test_estimates_are_within_1_96_standard_errors_however_many_blocks_show_them(shown):
    within = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        X = SHOWN[shown](rng, np.arange(1200) / 1200)[:, None, :] * rng.normal(size=(1, 3, 1))
        fit = robust_fit(X, rng.normal(size=(1200, 3)))
        within.append(np.abs(fit.theta) < 1.96 * fit.std)
    assert 0.93 < np.mean(within) < 0.97


def test_quiet_rows_count_more_than_loud_ones():
    X, y, loud = regression(0, 3)
    fit = robust_fit(X, y, groups=loud)
    np.testing.assert_allclose(fit.scale[:, 0], [1.0, 5.0], rtol=0.3)
    assert fit.std[0] < 0.75 * robust_fit(X, y).std[0]


def test_what_no_row_determines_keeps_its_prior():
    X, y, _ = regression(0, 3)
    X = np.concatenate([X, np.zeros((*y.shape, 1))], axis=2)
    assert robust_fit(X, y, np.array([0.0, 0.0, 0.25])).std[2] == pytest.approx(2.0)
    assert robust_fit(X, y).std[2] > 1e3


def noisy(seed, signal, n=600):
    """Draw a regressor with noise of size 1, and readings of it without; a draw of that noise."""
    rng = np.random.default_rng(seed)
    truth = signal * np.sin(np.linspace(0.0, 40.0, n))[:, None] * np.ones(3)
    X = np.stack([truth + rng.normal(size=(n, 3)), np.ones((n, 3))], axis=2)
    draw = np.zeros((n, 3, 2))
    draw[:, :, 0] = rng.normal(size=(n, 3))
    return X, 2.0 * truth - 1.0 + 0.1 * rng.normal(size=(n, 3)), draw


def test_noise_of_a_regressor_dilutes_nothing_where_a_draw_of_it_is_given():
    draws = (noisy(seed, 2.0) for seed in range(60))
    fits = [robust_fit(X, y, noise=draw) for X, y, draw in draws]
    off = np.array([(fit.theta - [2.0, -1.0]) / fit.std for fit in fits])
    np.testing.assert_allclose(np.sqrt(np.square(off).mean(axis=0)), 1.0, atol=0.25)
    X, y, _ = noisy(0, 2.0)
    assert robust_fit(X, y).theta[0] < 1.5  # 2 times signal over signal and noise, 4/6


def test_noise_alone_shows_nothing_and_is_estimated_as_such():
    for seed in range(60):
        X, y, draw = noisy(seed, 0.0)
        fit = robust_fit(X, y, noise=draw)
        assert abs(fit.theta[0]) < 4.0 * fit.std[0]
        assert np.isfinite(fit.std).all() and abs(fit.theta[1] + 1.0) < 4.0 * fit.std[1]


def test_readings_that_were_raised_by_a_regressor_hold_its_noise():
    off = []
    for seed in range(60):
        X, y, draw = noisy(seed, 2.0)
        about = np.array([0.5, 0.0])
        fit = robust_fit(X, y + X @ about, noise=draw, about=about)
        off.append((fit.theta - [2.5, -1.0]) / fit.std)
    np.testing.assert_allclose(np.sqrt(np.square(off).mean(axis=0)), 1.0, atol=0.25)
