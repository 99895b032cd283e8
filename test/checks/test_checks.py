"""What a recording can have wrong is found with channel and time; what is sound is let pass."""

from dataclasses import replace
import re

from calibration_runs import run
from changed import later, with_values
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.checks.signals import (
    clipped,
    DEAD,
    refuse_clocks_apart,
    refuse_dead,
    refuse_stuck,
)
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import CHANNELS, PoseStream, Recording, Stream
from forcecal_ros.sim.rig.file import load_rig
from longer import first
import numpy as np
import pytest

RATE = 500.0
T = np.arange(20_000) / RATE
"""40 s."""


@pytest.fixture(scope='module')
def rig():
    return run(seed=5)


def noise(channels=6, seed=0, t=T):
    return np.random.default_rng(seed).standard_normal((len(t), channels))


def moved(t=T, rest=None):
    """Return slow motion that all six channels feel alike, at rest from ``rest`` on [s]."""
    s = np.clip(t / 4.0, 0.0, None) if rest is None else np.minimum(t, rest) / 4.0
    return 30.0 * np.sin(2.0 * np.pi * s)[:, np.newaxis] * np.arange(1.0, 7.0)


def frozen(values, channel, start, end=np.inf, t=T):
    values = np.array(values)
    inside = (t >= start) & (t < end)
    values[inside, channel] = values[np.argmax(inside), channel]
    return values


def stuck(values, name='wrench', t=T, pose=None):
    refuse_stuck(Stream(t, values), name, CHANNELS[name], pose)


# Values that are none ------------------------------------------------------------------------


@pytest.mark.parametrize('value', [np.nan, np.inf, -1e7, 1e308])
def test_a_channel_that_says_nonsense_is_named_with_its_share_and_its_first_time(rig, value):
    def broken(values):
        values[5000::20, 4] = value
        return values

    with pytest.raises(DataError, match=r'wrench: 3\.\d % of the samples are not finite or beyond '
                       r'1e\+06 \(torque\.y from 5\.00 s on\); check the driver'):
        checked(with_values(rig, broken))


def test_single_values_are_left_out_and_noted(rig):
    def broken(values):
        values[[7, 900, 901]] = 1e7
        return values

    kept = checked(with_values(rig, broken, 'accelerometer'))
    assert kept.removed == {'accelerometer': 3}
    assert len(kept.accelerometer) == len(rig.accelerometer) - 3
    assert kept.notes == ('accelerometer: 3 samples are not finite or beyond 1e+06 and left out',)


def test_counts_of_a_converter_are_readings_before_the_matrix_and_none_after(rig):
    counts = with_values(rig, lambda values: 1e5 * values)
    assert checked(counts, raw_wrench=True).removed == {}
    with pytest.raises(DataError, match='wrench: .* beyond 1e'):
        checked(counts)


def test_both_checks_of_raw_channels_count_what_they_remove(rig):
    def broken(values):
        values[7], values[8] = np.nan, 1e8
        return values

    once = checked(with_values(rig, broken), raw_wrench=True)
    assert once.removed == {'wrench': 1}
    twice = checked(once)
    assert twice.removed == {'wrench': 2}
    assert len(twice.wrench) == len(rig.wrench) - 2 and checked(twice) is twice


def test_one_of_few_poses_may_be_missing():
    t = np.arange(24.0)
    values = noise(t=t)
    values[3, 2] = np.nan
    pose = PoseStream(t, np.zeros((24, 3)), np.tile(np.eye(3), (24, 1, 1)))
    assert checked(Recording(wrench=Stream(t, values), pose=pose)).removed == {'wrench': 1}


def test_a_position_may_be_unknown_but_not_an_orientation(rig):
    pose = rig.pose
    unknown = replace(pose, position=np.full_like(pose.position, np.nan))
    assert checked(replace(rig, pose=unknown)).removed == {}
    R = np.array(pose.R_base_sensor)
    R[2000:] = np.nan
    with pytest.raises(DataError, match=r'pose: 5\d\.\d % .*pose\.orientation from 8\.00 s on'):
        checked(replace(rig, pose=replace(pose, R_base_sensor=R)))


def test_an_empty_wrench_is_refused_and_other_empty_streams_count_as_not_measured(rig):
    with pytest.raises(DataError, match='wrench: no message was recorded'):
        checked(replace(rig, wrench=rig.wrench.between(0.0, 0.0)))
    found = checked(replace(rig, optidrive=rig.optidrive.between(0.0, 0.0)))
    assert found.optidrive is None
    assert found.notes == ('optidrive: no message; treated as not measured',)


@pytest.mark.parametrize('name, value', [
    ('optidrive', 0.0), ('angular_velocity', 0.0), ('angular_velocity', np.nan)])
def test_zeros_where_nothing_measures_are_no_dead_sensor(rig, name, value):
    width = len(CHANNELS[name])
    nothing = Stream(rig.wrench.t, np.full((len(rig.wrench), width), value))
    assert getattr(checked(replace(rig, **{name: nothing})), name) is None


# Channels that stick ---------------------------------------------------------------------------


@pytest.mark.parametrize('start, end', [(18.0, np.inf), (12.0, 13.0), (0.0, 20.0)])
def test_one_channel_that_sticks_is_named_with_its_value_and_time(start, end):
    values = frozen(moved() + noise(), 4, start, end)
    first = values[int(start * RATE), 4]
    with pytest.raises(DataError, match=f'^torque.y is stuck at {first:.6g} from {start:.2f} s to '
                       f'{min(end, 40.0) - 1 / RATE:.2f} s while other channels change; check'):
        stuck(values)


def test_a_whole_sensor_that_sticks_is_named_once():
    with pytest.raises(DataError, match='^accelerometer: all channels are constant from 18.00 '
                       r's to 40\.00 s; check'):
        stuck(frozen(noise(3), slice(None), 18.0), 'accelerometer')


def test_a_channel_is_stuck_in_steps_where_the_others_go_on():
    coarse = np.round(moved() + 0.3 * noise(), 0)
    stuck(coarse)
    for channel in (0, 5):
        with pytest.raises(DataError, match=CHANNELS['wrench'][channel]):
            stuck(frozen(coarse, channel, 18.0))


def test_a_wrench_that_does_not_feel_the_robot_turn_is_stuck_however_coarse():
    values = np.round(moved(rest=20.0) / 50.0) * 50.0
    R = np.tile(np.eye(3), (len(T), 1, 1))
    still = PoseStream(T, np.zeros((len(T), 3)), R)
    stuck(values, pose=still)
    angle = np.clip(T - 25.0, 0.0, 1.0)
    R[:, 0, 0], R[:, 2, 2] = np.cos(angle), np.cos(angle)
    R[:, 0, 2], R[:, 2, 0] = np.sin(angle), -np.sin(angle)
    with pytest.raises(DataError, match='wrench: all channels are constant'):
        stuck(values, pose=replace(still, R_base_sensor=R))


@pytest.mark.parametrize('resolution', [0.0, 0.3, 20.0])
@pytest.mark.parametrize('sigma', [0.0, 0.05, 1.0])
@pytest.mark.parametrize('rest', [None, 30.0])
def test_a_sensor_that_rests_in_steps_or_without_noise_is_sound(resolution, sigma, rest):
    rings = np.exp(-20.0 * np.clip(T - (rest or 0.0), 0.0, None))[:, np.newaxis]
    values = moved(rest=rest) + rings * noise(seed=2) + sigma * noise()
    if resolution:
        values = resolution * np.round(values / resolution)
    stuck(values)
    for j, name in enumerate(CHANNELS['wrench']):
        refuse_stuck(Stream(T, values[:, j:j + 1]), name, (name,))


def test_a_smooth_motion_that_comes_to_rest_without_noise_is_sound():
    u = np.clip((T - 5.0) / 3.0, 0.0, 1.0)
    way = (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, np.newaxis] * np.arange(1.0, 7.0)
    before = np.sin(np.minimum(T, 5.0) * np.pi / 10.0)[:, np.newaxis]
    stuck(before + way)


def test_a_driver_that_repeats_each_reading_has_that_habit():
    held = noise()[np.arange(len(T)) // 20 * 20]
    stuck(held)
    with pytest.raises(DataError, match='force.z is stuck at'):
        stuck(frozen(noise()[np.arange(len(T)) // 2 * 2], 2, 18.0))


def test_a_dead_channel_is_told_from_one_that_no_channel_tells_from_rest():
    values = noise()
    values[:, 2] = -3.25
    with pytest.raises(DataError, match='^force.z is constant at -3.25; check'):
        refuse_dead(Stream(T, values), 'wrench')
    seldom = np.round(0.3 * noise(), 0)
    seldom[:, 2] = 0.0
    refuse_dead(Stream(T, seldom), 'wrench')
    few = slice(0, DEAD)
    refuse_dead(Stream(T[few], values[few]), 'wrench')
    with pytest.raises(DataError, match='^wrench: the values never change'):
        refuse_dead(Stream(T, np.ones((len(T), 6))), 'wrench')


# Limits, clocks, pauses --------------------------------------------------------------------------


@pytest.mark.parametrize('resolution', [0.0, 0.5])
def test_a_channel_that_stops_at_a_limit_is_clipped_and_not_stuck(resolution):
    values = moved() + noise()
    values[:, 1] = np.clip(values[:, 1], -1e3, 40.0)
    if resolution:
        values = resolution * np.round(values / resolution)
    recording = checked(Recording(wrench=Stream(T, values)))
    found, = clipped(recording)
    assert (found.channel, found.limit) == ('force.y', 40.0)
    assert found.start == pytest.approx(0.46, abs=0.05) and found.samples > 5000
    assert recording.notes == (str(found),)


def test_sound_recordings_pass_without_a_word(rig):
    for recording in (rig, run(seed=6, noise=False), run(seed=7, accelerometer='acc2'),
                      run(load_rig('rigid_tool.yaml'), seed=8)):
        kept = checked(recording)
        assert kept.removed == {} and kept.notes == recording.notes


@pytest.mark.parametrize('name, way', [
    ('wrench', 1e4), ('accelerometer', -1e4), ('pose', 1e4), ('target', -1e4)])
def test_the_stream_on_another_clock_is_named(rig, name, way):
    named = re.escape(f'{way:+.1f} s; synchronise')
    with pytest.raises(DataError, match=f'{name}.* {named} .*PTP'):
        refuse_clocks_apart(later(rig, way, name))
    refuse_clocks_apart(later(rig, np.sign(way) * 15, name))


def test_pauses_are_told_but_no_rest_between_single_samples(rig):
    t = np.where(rig.wrench.t > 9.0, rig.wrench.t + 3.0, rig.wrench.t)
    late = checked(replace(rig, wrench=replace(rig.wrench, t=t)))
    assert late.notes == ('wrench: nothing was recorded for 3.0 s from 9.0 s on',)
    poses = np.arange(0.0, 120.0, 5.0)
    assert not checked(Recording(wrench=Stream(poses, noise(t=poses)))).notes


@pytest.mark.parametrize('value', [np.nan, 0.0])
def test_what_a_driver_says_before_its_sensor_answers_is_left_out(value):
    wrench, pose = turned(0.0)
    values = np.array(wrench.values)
    values[:600] = value
    found = checked(Recording(wrench=replace(wrench, values=values), pose=pose))
    assert len(found.wrench) == len(T) - 600
    assert found.notes == (
        'wrench: the first 600 samples, up to 1.20 s, contain no reading; left out',)
    values[9000:9600] = value
    with pytest.raises(DataError):
        checked(Recording(wrench=replace(wrench, values=values), pose=pose))


def test_a_driver_without_a_reading_for_longer_than_any_starts_is_refused():
    t = 0.01 * np.arange(6000)
    values = 5.0 + np.random.default_rng(1).standard_normal((6000, 6))
    for silent, said in ((1900, 'left out'), (2500, '41.7 % of the samples are not finite')):
        values[:silent] = np.nan
        try:
            text = ''.join(checked(Recording(wrench=Stream(t, values))).notes)
        except DataError as error:
            text = str(error)
        assert said in text


def turned(late, sign=1.0, contact=0.0):
    """Return the wrench of a kilogram that turns about, `late` behind its pose, and that pose."""
    rng = np.random.default_rng(3)
    angles = np.cumsum(rng.standard_normal((9, 3)), axis=0)
    ways = np.stack([np.interp(T, np.arange(9) * 5.0, column) for column in angles.T], axis=1)
    R = rotation_from_vector(ways)
    force = -9.81 * sign * R[:, 2] + 0.3 * noise(3) + contact * (T[:, None] % 4.0 > 2.0)
    return (Stream(T + late, np.hstack([force, 0.01 * noise(3, 1)])),
            PoseStream(T, np.full((len(T), 3), np.nan), R))


DOWN = np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize('late, sign', first([(3.0, 1.0), (7.0, 1.0)]))
def test_a_wrench_that_shows_gravity_turn_at_another_time_is_told_by_how_much(late, sign):
    wrench, pose = turned(late, sign)
    side = 'later' if late > 0 else 'earlier'
    said = rf'{abs(late):.2f} s {side} than in the pose.* \{-late:+.2f} s to all stamps of wrench'
    with pytest.raises(DataError, match=said):
        judge(Recording(wrench=wrench, pose=pose), DOWN)


@pytest.mark.parametrize('contact', first([50.0, 0.0, 5.0]))
def test_pushes_and_delays_of_filters_are_no_other_clock(contact):
    wrench, pose = turned(0.05, contact=contact)
    judge(Recording(wrench=wrench, pose=pose), DOWN)
