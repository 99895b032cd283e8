"""Colour of noise from octave to octave."""

from forcecal_ros.diagnose.localise import time_frequency
import numpy as np
import pytest


def test_noise_that_grows_from_octave_to_octave_is_expected_and_one_strong_octave_is_not():
    dof = np.full(len(time_frequency.BANDS), 100.0)
    pink = np.array([8.0, 4.0, 2.0, 1.2, 1.0, 1.0, 1.0, 1.0])
    assert time_frequency._colour([(pink * dof, dof)] * 3) == pytest.approx(pink)
    alone = np.array([1.0, 1.0, 50.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert time_frequency._colour([(alone * dof, dof)] * 3)[2] == time_frequency.STEEPEST
