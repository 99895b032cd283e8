"""The stated variance of a mean of rounded readings is what such means show."""

from forcecal_ros.core.noise.white import rounding_variance
import numpy as np
import pytest


@pytest.mark.parametrize('sigma', [0.0, 0.1, 0.2, 0.3, 0.5])
def test_means_of_rounded_readings_scatter_as_stated(sigma):
    rng = np.random.default_rng(4)
    levels = rng.uniform(-50.0, 50.0, 2000)
    read = np.rint(levels[:, None] + sigma * rng.standard_normal((2000, 500)))
    off = (read.mean(axis=1) - levels).var()
    white = (sigma**2 + 1.0 / 12.0 * (sigma > 0.0)) / 500
    stated = rounding_variance(0.01, 1e-4 * float(read.var(axis=1).mean())) / 1e-4
    assert off == pytest.approx(stated + white, rel=0.25, abs=2e-4)


def test_what_does_not_come_in_steps_is_not_rounded():
    assert rounding_variance(0.0, 1.0) == 0.0
