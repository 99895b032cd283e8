"""Poses of a flange, and the transform that takes them to the sensor."""

from dataclasses import replace

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import combine, invert
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.io.calibration_file import from_document, to_document
from forcecal_ros.observe import replay
from forcecal_ros.observe.design import with_kalman_gains
from forcecal_ros.observe.frames import (
    agreed,
    mounting_of,
    taken_as_calibrated,
    taken_to_sensor,
)
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

TURN = Rotation.from_euler('xyz', [0.4, -0.3, 1.1])
NUMBERS = (0.02, -0.03, 0.11, *TURN.as_quat().tolist())
MOUNTING = mounting_of(NUMBERS, 'test')
SENSOR_IN_FLANGE = RigidTransform.from_components(NUMBERS[:3], TURN)


def on_flange(stream):
    """Return the pose of the flange to that of the sensor, by another way of computing."""
    flange = RigidTransform.from_components(
        stream.position, Rotation.from_matrix(stream.R_base_sensor)) * SENSOR_IN_FLANGE.inv()
    return PoseStream(stream.t, flange.translation, flange.rotation.as_matrix(), stream.frame)


def numbers(stream, k):
    return (*stream.position[k], *Rotation.from_matrix(stream.R_base_sensor[k]).as_quat())


@pytest.fixture(scope='module')
def rig():
    """Return a calibration run whose poses are the sensor's, and the same with a flange's."""
    sound = run(noise=True)
    return sound, replace(sound, pose=on_flange(sound.pose), target=on_flange(sound.target))


@pytest.fixture(scope='module')
def calibrated(rig):
    return with_kalman_gains(identify(taken_to_sensor(rig[1], MOUNTING)))


def test_live_poses_go_to_the_sensor_and_back(rig):
    sound, flange = rig
    for k in range(0, len(sound.pose), 500):
        there, own = numbers(sound.pose, k), numbers(flange.pose, k)
        for found, expected in ((combine(own, MOUNTING), there),
                                (combine(there, invert(MOUNTING)), own)):
            np.testing.assert_allclose(found[:3], expected[:3], atol=1e-12)
            assert abs(np.dot(found[3:], expected[3:])) == pytest.approx(1.0, abs=1e-12)


def test_a_recording_of_the_flange_calibrates_and_answers_as_one_of_the_sensor(rig, calibrated):
    sound, flange = rig
    of_sensor = with_kalman_gains(identify(sound))
    assert of_sensor.sensor_from_pose is None
    np.testing.assert_allclose(calibrated.com.value, of_sensor.com.value, atol=1e-9)
    np.testing.assert_allclose(calibrated.inertia.value, of_sensor.inertia.value, atol=1e-9)
    assert calibrated.sensor_from_pose == pytest.approx(NUMBERS)
    answer = replay(taken_as_calibrated(flange, calibrated, 'c.yaml'), calibrated)
    np.testing.assert_allclose(answer.contact, replay(sound, of_sensor).contact, atol=1e-6)


def test_a_calibration_keeps_the_transform_and_refuses_another_by_name(rig, calibrated):
    kept = from_document(to_document(calibrated), 'c.yaml')
    rounded = mounting_of([round(x, 4) for x in NUMBERS], 'test')
    assert agreed(rounded, kept, 'c.yaml') == rounded
    other = mounting_of((*NUMBERS[:2], NUMBERS[2] + 0.001, *NUMBERS[3:]), 'test')
    with pytest.raises(ConfigError, match=r'c\.yaml was made with sensor\.from_pose 0\.02 .* but'):
        taken_as_calibrated(taken_to_sensor(rig[1], other), kept, 'c.yaml')
    with pytest.raises(ConfigError, match='made with poses of ft_sensor itself'):
        agreed(MOUNTING, replace(kept, sensor_from_pose=None), 'c.yaml')


def test_a_file_of_another_package_takes_what_is_given():
    bias = Estimate(np.zeros(6), np.nan, 'N, N m')
    foreign = Calibration(mass=Estimate(1.0, np.nan, 'kg'), com=Estimate(np.zeros(3), np.nan, 'm'),
                          wrench_bias=bias, source={'of': 'ft_tools'})
    assert agreed(MOUNTING, foreign, 'ft_tools.yaml') == MOUNTING
    assert agreed(None, foreign, 'ft_tools.yaml') is None


def test_the_sensors_own_pose_is_not_taken_to_it_again(rig, calibrated):
    sound = replace(rig[0], wrench=replace(rig[0].wrench, frame='ft'),
                    pose=replace(rig[0].pose, of='ft'))
    assert taken_as_calibrated(sound, calibrated, 'c.yaml') is sound
    with pytest.raises(DataError, match='already is that of the frame of the wrench'):
        taken_to_sensor(sound, MOUNTING)


@pytest.mark.parametrize('given, why', [
    ((0.0, 0.0, 0.1), 'expected the 7 numbers'),
    ((0.0, 0.0, float('nan'), 0.0, 0.0, 0.0, 1.0), 'expected the 7 numbers'),
    ((0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.9), 'has norm 0.9, not 1')])
def test_what_is_no_transform_is_refused(given, why):
    with pytest.raises(ConfigError, match=why):
        mounting_of(given, 'sensor.from_pose')


def test_one_number_stands_for_none():
    assert mounting_of([0.0], 'sensor.from_pose') is None
