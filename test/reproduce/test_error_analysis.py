"""The equations of the error analysis that no calibration is judged by."""

from forcecal_ros.identify.poses import orientation_h, orientation_v
from forcecal_ros.reproduce.error_analysis import gain_error, mass_from_weight
import numpy as np
import pytest

G = 9.80665
WEIGHT = 13.0 * G * np.array([0.0, 0.0, -1.0])


def test_mass_from_weight_is_the_mass():
    assert mass_from_weight(orientation_h(), orientation_v(), WEIGHT, WEIGHT, G) \
        == pytest.approx(13.0)


def test_gain_error_vanishes_with_its_causes():
    arguments = {'u': 20.0, 'u_assumed': 20.0, 'a': 1.5, 'a_assumed': 1.5, 'offset': 5.0,
                 'mass': 13.0, 'offset_error': 0.0, 'mass_error': 0.0}
    assert gain_error(**arguments) == 0
    assert gain_error(**{**arguments, 'mass_error': 0.1}) != 0
    # (u - V0 m) / (a m) with another mass is u / a (1/m - 1/m')
    assert gain_error(**{**arguments, 'mass_error': 0.1}) == pytest.approx(
        20 / 1.5 * (1 / 13 - 1 / 13.1))
