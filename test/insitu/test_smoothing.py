"""The filter of the six-axis calibration, and the standard errors of what it has filtered."""

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.insitu import Mounting, Options
from forcecal_ros.insitu.moments import gathered, projection, smooth, window_samples
import insitu_leg
from insitu_leg import Leg
from insitu_runs import calibrated, sigmas
import numpy as np
import pytest

WINDOW, ORDER = 13, 3


@pytest.mark.parametrize('samples', [9, 13, 14, 15, 40])
def test_what_is_gathered_is_what_the_filter_spreads(samples):
    x, y = np.random.default_rng(samples).standard_normal((2, samples, 2))
    smoothed = np.concatenate([part.values for part in smooth([y], WINDOW, ORDER)])
    np.testing.assert_allclose(gathered(x, WINDOW, ORDER).T @ y, x.T @ smoothed, atol=1e-12)


def test_a_window_of_few_samples_doubts_the_unit_of_time():
    with pytest.raises(ConfigError, match='widen it, if time is in s; else state its unit'):
        window_samples(3.01, 3, 0.1)
    with pytest.raises(ConfigError, match='widen it$'):
        window_samples(0.01, 3, 100.0)


@pytest.mark.parametrize('window, order', [(5, 3), (7, 0), (31, 2), (301, 3), (301, 1), (41, 5)])
@pytest.mark.parametrize('chunk', [500, 60_000])
def test_sums_that_slide_are_the_direct_convolution(window, order, chunk):
    rng = np.random.default_rng(window)
    x = 1e4 * rng.standard_normal(3) + np.cumsum(rng.standard_normal((40_000, 3)), axis=0)
    parts = [part.values for part in smooth(
        (x[i:i + chunk] for i in range(0, len(x), chunk)), window, order)]
    found, taps = np.concatenate(parts), projection(window, order)[window // 2]
    assert len(found) == len(x)
    start = x[0]
    direct = start + np.stack([np.convolve(column, taps, 'valid') for column in (x - start).T], 1)
    half = window // 2
    np.testing.assert_allclose(found[half:-half], direct, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found[:half], projection(window, order)[:half] @ x[:window],
                               rtol=1e-12)


def test_standard_errors_of_fast_motion_are_those_of_its_errors():
    # some twenty independent errors a run: their RMS scatters by 9 % over three
    fast = Leg(inertial=True, speed=8.0)
    off = [sigmas(calibrated(fast, seed, Options(moving=True),
                             Mounting(position=insitu_leg.ACCELEROMETER)), fast)
           for seed in (20, 21, 22)]
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.35
