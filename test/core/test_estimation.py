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
