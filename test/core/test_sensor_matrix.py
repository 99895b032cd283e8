"""A six-axis calibration turns raw channels into a wrench before anything else sees them."""

from dataclasses import replace

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.sensor_matrix import corrected, sensor_matrix
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.observe import replay
import numpy as np
import pytest

RNG = np.random.default_rng(1)
MATRIX = np.eye(6) + 0.2 * RNG.standard_normal((6, 6))
OFFSET = 100 * RNG.standard_normal(6)


@pytest.fixture
def plain():
    return Calibration(
        mass=Estimate(2.0, 0.001, 'kg'), com=Estimate([0.0, 0.0, 0.05], 1e-4, 'm'),
        wrench_bias=Estimate(np.zeros(6), 0.01, 'N, N m'))


@pytest.fixture
def raw(plain):
    return replace(plain, matrix=Estimate(MATRIX, 0.0, 'N, N m per count'),
                   matrix_offset=Estimate(OFFSET, 0.0, 'count'))


def test_one_reading_is_corrected_like_all_of_them(raw):
    part = sensor_matrix(raw)
    readings = RNG.standard_normal((50, 6)) * 100
    expected = (readings - OFFSET) @ MATRIX.T
    np.testing.assert_allclose(
        [corrected(tuple(row), part) for row in readings.tolist()], expected, rtol=1e-12)


def test_the_observer_sees_the_same_contact_through_raw_channels(plain, raw):
    t = np.arange(200) * 1e-3
    wrench = np.tile([0, 0, -19.6133, 0, 0, 0], (200, 1)) + RNG.standard_normal((200, 6))
    pose = PoseStream(t, np.zeros((200, 3)), np.tile(np.eye(3), (200, 1, 1)))
    counts = wrench @ np.linalg.inv(MATRIX).T + OFFSET
    direct = replay(Recording(wrench=Stream(t, wrench), pose=pose), plain)
    through = replay(Recording(wrench=Stream(t, counts), pose=pose), raw)
    np.testing.assert_allclose(through.contact, direct.contact, atol=1e-9)


def test_no_matrix_changes_nothing(plain):
    assert sensor_matrix(plain) is None


def test_a_matrix_of_another_number_of_channels_is_refused(raw):
    wide = replace(raw, matrix=Estimate(np.ones((6, 8)), 0.0, 'N, N m per count'),
                   matrix_offset=Estimate(np.ones(8), 0.0, 'count'))
    with pytest.raises(ConfigError, match='6 x 8'):
        sensor_matrix(wide)
