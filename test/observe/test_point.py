"""Where a contact force acts, and how sure that is."""

from forcecal_ros.observe.frames import contact_point
import numpy as np

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
