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


@pytest.mark.parametrize('degrees', [3.0, 4.0, 8.0])
def test_a_heavy_tail_makes_no_impulses_and_knocks_do(degrees):
    rng = np.random.default_rng(4)
    white = np.abs(rng.standard_t(degrees, 20000)) / np.sqrt(degrees / (degrees - 2.0))
    assert np.sum(white > time_frequency.IMPULSE) >= (4 if degrees < 5.0 else 0)
    assert time_frequency._beyond_its_tail(white) < time_frequency.IMPULSES
    knocked = np.abs(rng.standard_normal(20000))
    knocked[::2500] += 12.0
    assert time_frequency._beyond_its_tail(knocked) == 8
