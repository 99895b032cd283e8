"""Turns and poses between samples."""

from forcecal_ros.core.geometry import rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import PoseStream
import numpy as np
import pytest


def test_poses_between_samples_are_right_to_the_ends_of_a_recording():
    def turned(t):
        angles = np.stack([0.8 * np.sin(2.0 * t + 1.0), 0.5 * np.sin(3.0 * t), t], axis=1)
        return rotation_from_vector(angles)

    t = np.arange(500) * 0.008
    stream = PoseStream(t, np.stack([np.sin(t)] * 3, axis=1), turned(t))
    between = np.linspace(t[0], t[-1], 3001)
    found = stream.at(between)
    # a spline of rotation vectors is 5e-5 off at the ends, and of both signs of a quaternion by 1
    assert np.abs(found.R_base_sensor - turned(between)).max() < 2e-6
    np.testing.assert_allclose(found.position[:, 0], np.sin(between), atol=1e-9)


@pytest.mark.parametrize('angle', [0.0, 1e-9, 0.3, 1.5, 1.6, 3.0, np.pi - 1e-7, np.pi])
def test_a_rotation_vector_is_exact_up_to_half_a_turn(angle):
    axis = np.array([0.6, -0.48, 0.64])
    found = rotation_vector(rotation_from_vector(angle * axis))
    back = rotation_from_vector(found)
    np.testing.assert_allclose(back, rotation_from_vector(angle * axis), atol=1e-12)
    assert np.linalg.norm(found) == pytest.approx(angle, abs=1e-12, rel=1e-12)
