"""The filter of the six-axis calibration, and the standard errors of what it has filtered."""

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.insitu import Mounting, Options
from forcecal_ros.insitu.moments import gathered, smooth, window_samples
import insitu_leg
from insitu_leg import Leg
from insitu_runs import calibrated, sigmas
import numpy as np
import pytest

WINDOW, ORDER = 13, 3


@pytest.mark.parametrize('samples', [9, 13, 14, 15, 40])
def test_what_is_gathered_is_what_the_filter_spreads(samples):
    x, y = np.random.default_rng(samples).standard_normal((2, samples, 2))
    smoothed = smooth(y, WINDOW, ORDER).values
    np.testing.assert_allclose(gathered(x, WINDOW, ORDER).T @ y, x.T @ smoothed, atol=1e-12)


def test_a_window_of_few_samples_doubts_the_unit_of_time():
    with pytest.raises(ConfigError, match='increase it, or correct the unit of time'):
        window_samples(3.01, 3, 0.1)
    with pytest.raises(ConfigError, match='increase it$'):
        window_samples(0.01, 3, 100.0)


@pytest.mark.long
def test_standard_errors_of_fast_motion_are_those_of_its_errors():
    # some twenty independent errors a run: their RMS scatters by 9 % over three
    fast = Leg(inertial=True, speed=8.0)
    off = [sigmas(calibrated(fast, seed, Options(moving=True),
                             Mounting(position=insitu_leg.ACCELEROMETER)), fast)
           for seed in (20, 21)]
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.35
