"""Times in another unit, and places and angles, are told by how fast readings and arm are."""

from dataclasses import replace

from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.signals import refuse_degrees_a_second, refuse_other_pace
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from kuka import static_recording
import numpy as np
import pytest
from static_sets import static_set
from wrong_recordings import log, path, recording_of, work

LOGS = {'poses': recording_of(log(1)), 'work': recording_of(work(2)),
        'at 10 Hz': recording_of(work(3, rate=10.0))}


def paced(recording, factor, names=('wrench', 'pose')):
    return replace(recording, **{name: replace(stream, t=factor * stream.t) for name in names
                                 if (stream := getattr(recording, name)) is not None})


def turned(recording, vectors):
    pose = recording.pose
    return replace(recording, pose=replace(pose, R_base_sensor=rotation_from_vector(vectors)))


@pytest.mark.parametrize('name, factor', [
    *((name, 0.1) for name in LOGS), ('poses', 4.0), ('work', 4.0), ('at 10 Hz', 2.0)])
def test_sound_logs_and_slower_and_faster_ones_are_left_alone(name, factor):
    refuse_other_pace(LOGS[name])
    refuse_other_pace(paced(LOGS[name], factor))


def test_sets_of_poses_are_left_alone_however_far_they_are_apart():
    refuse_other_pace(static_set(0, 100.0)[0])
    poses = static_set(0)[0]
    refuse_other_pace(poses)
    often = replace(poses, pose=PoseStream(
        60.0 * np.arange(240.0), np.full((240, 3), np.nan),
        np.resize(poses.pose.R_base_sensor, (240, 3, 3))))
    refuse_other_pace(often)


@pytest.mark.parametrize('name', LOGS)
def test_readings_that_come_in_bursts_are_left_alone(name):
    recording = LOGS[name]
    late = {which: replace(stream, t=stream.t[np.minimum(
        (np.arange(len(stream)) // 10 + 1) * 10, len(stream)) - 1] + 2e-6 * (
            np.arange(len(stream)) % 10)) for which in ('wrench', 'pose')
        if (stream := getattr(recording, which)) is not None}
    refuse_other_pace(replace(recording, **late))


def test_real_poses_are_left_alone(kuka_data):
    refuse_other_pace(static_recording(kuka_data))


TAKEN_FOR_S, TAKEN_FOR_LESS = (
    'time is in ms or us but read as s.* set its unit',
    r'time is in (another unit \()?s .*read as ms')


@pytest.mark.parametrize('name, factor, said', [
    ('poses', 1e3, TAKEN_FOR_S), ('work', 1e6, TAKEN_FOR_S), ('at 10 Hz', 1e3, TAKEN_FOR_S),
    ('poses', 200.0, 'or counts rows; .*evenly spaced, set rate'),
    ('poses', 1e-6, TAKEN_FOR_LESS), ('work', 1e-3, TAKEN_FOR_LESS),
    ('at 10 Hz', 1e-3, TAKEN_FOR_LESS)])
def test_a_time_in_another_unit_or_of_row_numbers_is_refused(name, factor, said):
    with pytest.raises(DataError, match=said):
        checked(paced(LOGS[name], factor))


@pytest.mark.parametrize('names', [('wrench',), ('pose',)])
def test_one_stream_in_milliseconds_is_refused(names):
    with pytest.raises(DataError, match=rf'^{names[0]}: .* one has its time in ms'):
        checked(paced(LOGS['work'], 1e3, names))


def test_places_in_millimetres_are_told_by_their_speed():
    recording = LOGS['work']
    pose = recording.pose
    with pytest.raises(DataError, match='pose: its position moves .* it is in mm; multiply by'):
        checked(replace(recording, pose=replace(pose, position=1e3 * pose.position)))


def test_degrees_that_are_taken_for_radians_are_refused():
    recording = LOGS['work']
    vectors = np.degrees(rotation_vector(recording.pose.R_base_sensor))
    with pytest.raises(DataError, match='pose: it rotates .* its angles are in degrees'):
        checked(turned(recording, vectors))


def with_gyro(seed, factor):
    one = work(seed)
    way = path(np.random.default_rng(seed), 16, 0.8, 1.8)
    motion = way.at(one.t)
    rng = np.random.default_rng(seed)
    gravity = -9.81 * motion.R[:, 2]
    felt = np.einsum('nji,nj->ni', motion.R, motion.acceleration) - gravity
    return replace(
        recording_of(one), angular_velocity=Stream(
            one.t, factor * (motion.omega + 0.01 * rng.standard_normal((len(one.t), 3)))),
        accelerometer=Stream(one.t, felt + 0.05 * rng.standard_normal(felt.shape)),
        accelerometer_unit='m/s^2')


@pytest.mark.parametrize('seed', [2, 302])
def test_a_gyro_in_degrees_a_second_is_told_by_the_pose_and_by_gravity(seed):
    sound, other = with_gyro(seed, 1.0), with_gyro(seed, 57.29578)
    for without in ({}, {'pose': None}):
        refuse_degrees_a_second(replace(sound, **without))
        with pytest.raises(DataError, match='^angular_velocity: .* it is in deg/s; multiply by'):
            refuse_degrees_a_second(replace(other, **without))
    resting = replace(other, pose=None, accelerometer=replace(
        other.accelerometer, values=np.ones_like(other.accelerometer.values)))
    refuse_degrees_a_second(resting)


def test_a_stream_of_its_own_has_no_pace_to_compare():
    t = np.arange(1000.0)
    refuse_other_pace(Recording(wrench=Stream(t, np.ones((1000, 6)))))
