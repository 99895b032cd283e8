"""The contact wrench in other frames, by numbers worked out by hand, and where a force acts."""

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.observe.frames import contact_point, Frames
import numpy as np
import pytest

TURN = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
"""A quarter turn about z: x goes to y."""

WRENCH = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)


def test_a_flange_behind_the_sensor_feels_the_force_with_a_longer_lever():
    flange = Frames(['tool0'], [0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0])
    # the sensor is 0.1 m along z of the flange: (0, 0, 0.1) x (1, 2, 3) = (-0.2, 0.1, 0)
    assert flange.of(0.0, WRENCH, 0.1)['tool0'] == pytest.approx((1, 2, 3, -0.1, 0.3, 0.3))


def test_a_turned_frame_sees_the_force_along_its_own_axes():
    turned = Frames(['tcp'], [0.0, 0.0, 0.0, *TURN])
    # its x is y of the sensor, its y is -x of the sensor
    assert turned.of(0.0, WRENCH, 0.1)['tcp'] == pytest.approx((2, -1, 3, 0.2, -0.1, 0.3))


def test_the_base_goes_by_the_pose_of_the_wrench():
    frames = Frames(['base_link'], [])
    assert frames.of(0.0, WRENCH, 0.1) == {}
    frames.note(0.0, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    frames.note(1.0, (0.0, 0.0, 2.0, *TURN))
    # (1, 0, 0) x (1, 2, 3) = (0, -3, 2)
    assert frames.of(0.05, WRENCH, 0.1)['base_link'] == pytest.approx((1, 2, 3, 0.1, -2.8, 2.3))
    # x and y swap by the turn; (0, 0, 2) x (-2, 1, 3) = (-2, -4, 0)
    assert frames.of(0.95, WRENCH, 0.1)['base_link'] == pytest.approx(
        (-2, 1, 3, -2.2, -3.9, 0.3))
    assert frames.of(0.5, WRENCH, 0.1) == {}


@pytest.mark.parametrize('names, numbers, why', [
    (['tool0', 'flange', 'base'], [0.0] * 6 + [1.0], '3 frames .* has 7 numbers'),
    (['tool0', 'tool0'], [0.0] * 6 + [1.0], 'names must differ'),
    (['tool0'], [0.0] * 7, 'norm 0, not 1'),
    (['../tool'], [], "'../tool' cannot be part of a topic")])
def test_what_is_no_frame_is_refused(names, numbers, why):
    with pytest.raises(ConfigError, match=why):
        Frames(names, numbers)


def test_without_frames_there_is_nothing():
    assert Frames([''], [0.0]).of(0.0, WRENCH, 0.1) == {}


STD = np.array([0.2, 0.1, 0.3, 0.01, 0.02, 0.015])
COVARIANCE = np.diag(STD ** 2)
FORCE, POINT = np.array([12.0, -5.0, 20.0]), np.array([0.1, 0.02, 0.15])


def test_the_force_acts_on_the_line_that_was_pushed_along():
    wrench = np.concatenate([FORCE, np.cross(POINT, FORCE)])
    found = contact_point(wrench, COVARIANCE)
    np.testing.assert_allclose(np.cross(found.position - POINT, FORCE), 0.0, atol=1e-12)
    assert abs(found.position @ FORCE) < 1e-12


def test_its_covariance_is_that_of_many_readings():
    rng = np.random.default_rng(1)
    wrench = np.concatenate([FORCE, np.cross(POINT, FORCE)])
    points = np.array([contact_point(wrench + STD * noise, COVARIANCE).position
                       for noise in rng.normal(size=(4000, 6))])
    expected = contact_point(wrench, COVARIANCE).covariance
    # variances of 4000 draws are known to 2.2 %, and second order adds as much
    np.testing.assert_allclose(np.cov(points.T), expected, atol=0.1 * np.trace(expected))


def test_a_force_within_its_noise_acts_nowhere():
    assert contact_point(np.array([0.5, 0, 0, 0, 0.1, 0]), COVARIANCE) is None
    assert contact_point(np.array([2.0, 0, 0, 0, 0.1, 0]), COVARIANCE) is not None
