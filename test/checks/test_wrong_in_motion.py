"""What spoils a log and shows in motion alone is told, and sound logs are not."""

from dataclasses import replace

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.checks.signals import interpolated
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.calibration_file import load, save
from longer import first
from moving_arm import moving
import numpy as np
import pytest
from wrong_recordings import bursts, log, recording_of, resampled, work, WRONG

DOWN = np.array([0.0, 0.0, -9.80665])


def spoilt(wrong, seed):
    return recording_of(WRONG[wrong].make(work(seed), np.random.default_rng(seed)))


@pytest.mark.parametrize('seed', first(range(40, 44)))
def test_a_log_that_was_stamped_anew_at_half_speed_is_told(seed):
    note, = judge(spoilt('played at half speed, stamped anew', seed), DOWN)
    assert 0.48 < float(note.split('run at ')[1].split()[0]) < 0.6


@pytest.mark.parametrize('seed', first(range(50, 54)))
@pytest.mark.parametrize('wrong', ['30 % lost in bursts', 'poses of two digits'])
def test_other_logs_show_no_other_speed_and_no_other_point(wrong, seed):
    notes = judge(spoilt(wrong, seed), DOWN)
    assert not [note for note in notes if 'of real time' in note or 'point' in note]


@pytest.mark.parametrize('seed', first(range(80, 84)))
def test_a_wrench_that_a_driver_smooths_a_little_is_told_by_its_delay(seed):
    note, = judge(spoilt('wrench behind a low-pass of 10 Hz', seed), DOWN)
    assert 14 <= float(note.split('weight rotate ')[1].split()[0]) <= 17
    assert judge(spoilt('nothing', seed), DOWN) == ()


@pytest.mark.parametrize('make', [log, moving])
@pytest.mark.long
def test_torques_about_another_point_are_warned_of_while_calibrating(make, tmp_path):
    wrong = WRONG['torque about the tool centre'].make(make(70), None)
    save(identify(recording_of(wrong)), tmp_path / 'c.yaml')
    quality = load(tmp_path / 'c.yaml').quality
    note, = (one for one in quality['warnings'] if 'are about a point' in one)
    assert 'com' in quality['suspect']
    assert note.endswith('suspect: com')
    place = note.split('about a point (')[1].split(')', maxsplit=1)[0]
    np.testing.assert_allclose([float(x) for x in place.split()], [0.0, 0.0, 0.15], atol=0.01)
    stated = note.split('--sensor-from-pose ')[1].split(',', maxsplit=1)[0].split()
    np.testing.assert_allclose([float(x) for x in stated], [0.0, 0.0, 0.15, 0, 0, 0, 1], atol=0.01)
    sound = identify(recording_of(log(70))).quality
    assert 'inertia in motion' not in str(sound)


@pytest.mark.parametrize('rate', [1.0, 5.0])
def test_poses_interpolated_from_few_are_told_with_their_rate(rate):
    said = interpolated(recording_of(resampled(work(71), rate)).pose)
    assert abs(float(said.split('between ')[1].split()[0]) - rate) < 0.05 * rate


def test_poses_as_they_were_recorded_or_coarse_are_not_called_interpolated():
    for wrong in ('nothing', 'pose repeats at 10 Hz', 'poses of two digits'):
        assert interpolated(spoilt(wrong, 72).pose) == ''


def test_a_slow_log_is_not_said_to_hold_no_rotation():
    one = log(3, poses=8, rate=10.0)
    notes = identify(recording_of(one.of_pose(np.arange(0, len(one.pose_t), 12)))).quality['notes']
    said, = (note for note in notes if 'inertia' in note)
    assert 'readings at 10 Hz in poses of' in said and 'record faster' in said


def test_messages_in_bursts_are_calibrated_as_when_they_were_measured():
    found = identify(recording_of(bursts(log(3, poses=8), 10)))
    assert float(found.mass) == pytest.approx(1.3, abs=2e-3)
    assert not [line for line in found.quality['warnings'] if 'delays are looked for' in line]
    assert abs(found.quality['pose_delay']) < 0.006


def test_whole_numbers_in_all_channels_are_refused_as_counts():
    one = log(2, poses=8)
    with pytest.raises(DataError, match='whole numbers'):
        identify(recording_of(replace(one, wrench=np.round(30.0 * one.wrench))))
