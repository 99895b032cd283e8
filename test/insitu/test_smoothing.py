"""The filter of the six-axis calibration, and the standard errors of what it has filtered."""

from forcecal_ros.insitu import Mounting, Options
from forcecal_ros.insitu.smoothing import gathered, smooth
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


def test_standard_errors_of_fast_motion_are_those_of_its_errors():
    # some twenty independent errors a run: their RMS scatters by 9 % over three
    fast = Leg(inertial=True, speed=8.0)
    off = [sigmas(calibrated(fast, seed, Options(moving=True),
                             Mounting(position=insitu_leg.ACCELEROMETER)), fast)
           for seed in (20, 21, 22)]
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.35
