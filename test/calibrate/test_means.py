"""Means while the robot stands still, and drift."""

from forcecal_ros.calibrate.residuals import drift
from forcecal_ros.core.streams import Stream
import numpy as np
from scipy.signal import lfilter


def test_a_drift_is_found_where_it_is_and_noise_is_none():
    rng = np.random.default_rng(11)
    t = np.arange(0, 4, 0.001)
    values = 0.01 * rng.standard_normal((len(t), 3))
    windows = [(0.0, 2.0), (2.0, 4.0)]
    assert drift(Stream(t, values), windows)[0] < 5
    values[2000:, 1] += 0.01 * np.exp(-(t[2000:] - 2) / 0.5)
    sigmas, pose, channel = drift(Stream(t, values), windows)
    assert sigmas > 6 and (pose, channel) == (1, 1)


def test_noise_that_a_filter_of_two_hertz_has_passed_is_no_drift():
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 40.0, 0.004)
    a = np.exp(-2 * np.pi * 2.0 * 0.004)
    values = lfilter([1.0 - a], [1.0, -a], rng.standard_normal((len(t), 6)), axis=0)
    windows = [(4.0 * i, 4.0 * i + 3.0) for i in range(10)]
    assert drift(Stream(t, values), windows)[0] < 6
    values[:750, 2] += 1.0 * t[:750]
    assert drift(Stream(t, values), windows) > (6, 0, 2)
