"""Gravity compensation on a real arm in free motion, where the truth is zero."""

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.observe import FilterSettings, ObserverSettings, replay
from forcecal_ros.observe.playback import with_noise
from kuka import kuka_recording, slow, static_calibration
import numpy as np
import pytest

VIBRATION = ObserverSettings('ukf', learning=FilterSettings(
    contact_floor=(1.0, 0.1), bias_prior=(0.3, 0.02)))
"""This arm shakes its sensor by 1 N, and its bias moved since the calibration."""

AS_FAST = ObserverSettings(bandwidth_hz=24.7)
"""As the UKF with its usual noise: by this arm's own noise the observer would be slower."""


@pytest.fixture(scope='module')
def recording(kuka_data):
    return kuka_recording(kuka_data, '1-baseline')


@pytest.fixture(scope='module')
def calibration(kuka_data, recording):
    static = static_calibration(kuka_data)
    return with_noise(with_delay(static, estimate_delay(recording, static)), recording)


@pytest.fixture(scope='module')
def by_observer(recording, calibration):
    return slow(replay(recording, calibration, AS_FAST)).std(axis=0)


def slow_std(result):
    return slow(result).std(axis=0)


@pytest.mark.parametrize('name', ['ukf', 'ekf'])
def test_below_10_hz_little_is_left(recording, calibration, by_observer, name):
    left = slow_std(replay(recording, calibration, ObserverSettings(name)))
    assert (left < [0.13, 0.045, 0.07]).all()
    # the same load; what differs is how fast the two filters are, which shows a little here
    assert (left < 1.02 * by_observer).all()


def test_with_its_vibration_stated_the_arm_is_free_and_its_bias_is_found(
        recording, calibration, by_observer):
    result = replay(recording, calibration, VIBRATION)
    assert not result.learned.touching.any()
    moved = result.learned.bias[-1] - calibration.wrench_bias.value
    assert 0.15 < moved[2] < 0.4
    assert (slow_std(result) <= by_observer).all()
    assert np.abs(result.contact[2000:, :3].mean(axis=0)).max() < 0.1


def test_static_compensation_leaves_what_gravity_alone_leaves(recording, calibration):
    left = slow_std(replay(recording, calibration, ObserverSettings('static')))
    assert left == pytest.approx([0.36, 0.02, 0.15], abs=0.02)
