"""Logs that drivers, loggers and clocks spoil: a right answer, or the true cause."""

from dataclasses import replace
from functools import cache
import re

from changed import with_values
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.gravity import refuse_disagreeing
from forcecal_ros.checks.signals import SENSORS
from forcecal_ros.cli.common import with_notes_of
from forcecal_ros.cli.estimate import other_frame
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.stamps import with_even_streams
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.bags.header_stamps import usable_stamps
from longer import first
import numpy as np
import pytest
from wrong_recordings import COM, log, MASS, recording_of, work, write, WRONG

SHORT = {'hold': 2.0, 'move': 1.2, 'rate': 100.0}
"""Of the recordings here."""


@cache
def known():
    return identify(recording_of(log(1, **SHORT)))


def poses(wrong, seed=1):
    return recording_of(WRONG[wrong].make(log(seed, **SHORT), np.random.default_rng(5)))


def at_work(wrong, seed=2):
    return recording_of(WRONG[wrong].make(
        work(seed, poses=10, rate=100.0), np.random.default_rng(5)))


def test_a_wrench_of_another_arm_is_refused_as_no_weight_in_any_frame():
    with pytest.raises(DataError, match='wrench and pose are of different robots'):
        identify(poses('wrench of another arm'))


@pytest.mark.long
def test_torques_about_another_point_are_told_by_the_calibration():
    assert refuse_disagreeing(at_work('nothing'), known()) == ()
    note, = refuse_disagreeing(at_work('torque about the tool centre'), known())
    assert 'torques place the centre of mass at (0.005 -0.012 -0.09' in note


@pytest.mark.parametrize('wrong, said', [
    ('pose repeats at 10 Hz', 'pose: .* sent 12 times, so the sensor runs at 10.4 Hz'),
    ('wrench of 10 Hz published at 200', 'wrench: .* sent 10 times, so the sensor runs at 10 '),
    ('2 % zero packets', r'wrench: \d+ isolated messages are zero in all channels'),
    ('dead band of 2 N', r'force\.\w has no reading between 0 and 2: .*dead band'),
    ('30 % lost in bursts', r'wrench: \d\d% of its messages are missing'),
    ('poses of two digits', 'pose: its position has a resolution of 10 mm')])
def test_what_spoils_readings_is_noted_once(wrong, said):
    notes = checked(at_work(wrong)).notes
    assert len([note for note in notes if re.search(said, note)]) >= 1


@pytest.mark.parametrize('seed', first(range(3)))
def test_sound_logs_are_not_remarked_upon(seed):
    for one in (log(seed, **SHORT), work(seed, poses=10, rate=100.0), work(
            seed, poses=10, rate=20.0)):
        assert checked(recording_of(one)).notes == ()
    assert refuse_disagreeing(recording_of(work(seed, poses=10, rate=100.0)), known()) == ()


@pytest.mark.parametrize('wrong, said', [
    pytest.param('wrench behind a low-pass of 0.5 Hz',
                 'the driver filters the wrench .a low-pass of 0.', marks=pytest.mark.long),
    ('wrench averaged over 1 s', 'the driver filters the wrench .a moving average'),
    pytest.param('wrench 80 ms late', r'weight in the wrench rotates (7|8)\d\S* ± \S+ ms later',
                 marks=pytest.mark.long)])
def test_how_a_wrench_follows_gravity_is_noted(wrong, said):
    assert any(re.search(said, note) for note in refuse_disagreeing(at_work(wrong), known()))


def test_lost_packets_do_not_lighten_the_tool():
    found = identify(poses('2 % zero packets'))
    assert abs(float(found.mass) - MASS) < 5 * float(found.mass.std) + 1e-3
    assert np.abs(found.com.value - COM).max() < 1e-3


def test_poses_that_are_repeated_are_thinned_to_those_that_came():
    thin = checked(at_work('pose repeats at 10 Hz'))
    sound = at_work('nothing').pose
    assert len(thin.pose) < 0.12 * len(sound)
    np.testing.assert_allclose(thin.pose.position, sound.position[np.searchsorted(
        sound.t, thin.pose.t)], atol=2e-4)


def test_a_recording_that_begins_at_stamp_zero_keeps_its_first_message(tmp_path):
    one = WRONG['begins at stamp 0'].make(log(1, poses=3, **SHORT), None)
    recording = read_recording(write(one, tmp_path / 'bag'))
    assert len(recording.wrench) == len(one.t) and recording.start_ns == 0
    assert recording.notes == ()


@pytest.mark.parametrize('wrong, said', [
    ('stamps of whole seconds', '99% of the messages have the stamp of the previous'),
    ('microseconds in nanosec', 'nanosec of its stamps contains microseconds')])
def test_stamps_that_are_cut_off_give_way_to_the_times_of_recording(tmp_path, wrong, said):
    one = WRONG[wrong].make(log(1, poses=4, **SHORT), None)
    recording = read_recording(write(one, tmp_path / 'bag'))
    assert len(recording.wrench) == len(one.t) and len(recording.pose) == len(one.pose_t)
    np.testing.assert_allclose(np.diff(recording.wrench.t), np.diff(one.t), atol=1e-6)
    assert sum(said in note or 'messages bear' in note for note in recording.notes) == 2


@pytest.mark.parametrize('wrong, said', [
    ('stamps of single precision, of the epoch', 'stamps are truncated'),
    ('milliseconds as seconds', 'the seconds are in milliseconds'),
    pytest.param('another arm on the same topic', 'two drivers publish on one topic',
                 marks=pytest.mark.long),
    ('another arm of another frame_id', 'two drivers publish on one topic')])
def test_stamps_of_no_clock_and_two_senders_are_refused(tmp_path, wrong, said):
    one = WRONG[wrong].make(log(1, **SHORT), None)
    with pytest.raises(DataError, match=said):
        read_recording(write(one, tmp_path / 'bag'))


def test_a_simulator_whose_commands_hold_for_two_samples_is_one_sender():
    rng = np.random.default_rng(0)
    t = 1_700_000_000 * 10**9 + 2_000_000 * np.arange(6000)
    moving = np.repeat([False, True, False], [1000, 4000, 1000])[:, np.newaxis]
    slow = np.cumsum(rng.standard_normal((6000, 6)), axis=0)
    ripple = 100.0 * np.tile([[1.0], [-1.0]], (3000, 1))
    simulated = np.where(moving, slow + ripple, slow[1000])
    assert usable_stamps('/wrench', t, t, simulated).note == ''
    with pytest.raises(DataError, match='two drivers publish on one topic'):
        usable_stamps('/wrench', t, t, slow + ripple)


def test_stamps_that_a_clock_says_stay_as_they_are():
    rng = np.random.default_rng(0)
    t = 1_700_000_000 * 10**9 + 10**7 * np.arange(3000)
    values = np.cumsum(rng.standard_normal((3000, 6)), axis=0)
    for stamps, log_ns, rows in (
            (t, t + 10**6, values), (t, t, np.round(values)), (t, 2 * t, values),
            (t // 10**9 * 10**9 + 10**9 * np.arange(3000), t, values),
            (np.repeat(t[::2], 2), t, np.repeat(values[::2], 2, axis=0)),
            (1000 * t, 10**5 * t, values), (t, t, rng.standard_normal((3000, 6)))):
        found = usable_stamps('/wrench', stamps, log_ns, rows)
        assert found.note == '' and found.stamps is stamps


def test_messages_that_come_in_bursts_are_put_back_where_they_were_measured():
    one = at_work('stamped on arrival, in bursts of 10')
    even = with_even_streams(one, SENSORS, 1.0)
    assert 'stamps of wrench jitter by' in even.notes[0] and len(even.notes) == 1
    sound = at_work('nothing')
    late = even.wrench.t - sound.wrench.t
    assert np.abs(late - late.mean()).max() < 0.01 < np.ptp(one.wrench.t - sound.wrench.t)
    assert with_even_streams(sound, SENSORS, 1.0) is sound


def test_a_wrench_of_another_frame_than_calibrated_is_noted():
    one = at_work('nothing')
    assert other_frame(one, known()) == ()
    renamed = replace(one, wrench=replace(one.wrench, frame='/left_tool0'))
    note, = other_frame(renamed, known())
    assert "its frame_id is 'left_tool0', but the calibration is for 'ft_sensor'" in note
    assert other_frame(replace(one, wrench=replace(one.wrench, frame='')), known()) == ()
    of_others = replace(known(), source={'of': 'force_torque_tools'})
    assert other_frame(renamed, of_others) == ()


def test_a_refusal_says_that_messages_named_two_frames():
    notes = ("/wrench: frame_id is 'a' in 9 messages, but 'b' in 9", 'something else')
    with pytest.raises(DataError, match="not of one robot; /wrench: frame_id is 'a' in 9"):
        with with_notes_of(replace(poses('nothing'), notes=notes)):
            raise DataError('not of one robot')


def test_counts_beyond_all_readings_are_named_as_such():
    with pytest.raises(DataError, match='counts of a converter'):
        checked(with_values(poses('nothing'), lambda values: 1e8 * values + 1e9))
