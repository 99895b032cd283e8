"""The equations of the error analysis that no calibration is judged by."""

from forcecal_ros.calibrate.paper import step_gain
from forcecal_ros.calibrate.poses import orientation_h, orientation_v
from forcecal_ros.reproduce.error_analysis import gain_error, mass_from_weight
import numpy as np
import pytest

G = 9.80665
WEIGHT = 13.0 * G * np.array([0.0, 0.0, -1.0])


def test_mass_from_weight_is_the_mass():
    assert mass_from_weight(orientation_h(), orientation_v(), WEIGHT, WEIGHT, G) \
        == pytest.approx(13.0)


def test_gain_error_vanishes_with_its_causes_and_is_that_of_the_step_else():
    """A step of 20 N as steps 5 to 8 take it, with another mass and another offset."""
    true = {'offset': 5.0, 'mass': 13.0}
    u = np.linspace(-20.0, 20.0, 41)
    volts = true['offset'] - 0.2937 * u / true['mass']
    wrong = {'offset_error': 0.0, 'mass_error': 0.1}
    found = step_gain(volts - true['offset'], u / 13.1)
    assert gain_error(volts[-1], u=20.0, u_assumed=20.0, **true, **wrong) == pytest.approx(
        -0.2937 - found)
    same = {'offset_error': 0.0, 'mass_error': 0.0}
    assert gain_error(volts[-1], u=20.0, u_assumed=20.0, **true, **same) == 0
    off = {'offset_error': 0.01, 'mass_error': 0.0}
    assert gain_error(volts[-1], u=20.0, u_assumed=20.0, **true, **off) == pytest.approx(
        0.01 * 13.0 / 20.0)
