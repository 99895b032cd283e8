"""What spoils a log and shows in motion alone is told, and sound logs are not."""

from dataclasses import replace
from itertools import product
import re

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.checks.signals import interpolated
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.calibration_file import load
from longer import first
import moving_arm
from moving_arm import moving
import numpy as np
import pytest
import wrong_recordings
from wrong_recordings import (
    about_another_point,
    bursts,
    log,
    pulled,
    recording_of,
    resampled,
    work,
    write,
    WRONG,
)

DOWN = np.array([0.0, 0.0, -9.80665])
BRIEF = {'seconds': 16.0, 'rate': 100.0}
RESTING = {'hold': 2.0, 'move': 1.2, 'rate': 100.0}


def spoilt(wrong, seed):
    return recording_of(WRONG[wrong].make(work(seed), np.random.default_rng(seed)))


@pytest.mark.parametrize('seed', first(range(40, 44)))
def test_a_log_that_was_stamped_anew_at_half_speed_is_told(seed):
    note, = judge(spoilt('played at half speed, stamped anew', seed), DOWN)
    assert 0.48 < float(note.split('run at ')[1].split()[0]) < 0.6


@pytest.mark.parametrize('made, of, scale, said', [
    ('arm', moving_arm, -1.0, 'its position has other axes than its orientation'),
    ('rests', wrong_recordings, -1.0, 'its position has other axes than its orientation'),
    ('rests', wrong_recordings, 0.4, 'the stamps run at 0.63 of real time')])
def test_an_inertia_that_is_not_that_of_the_weight_is_told(
        made, of, scale, said, tmp_path, capsys):
    """A negative one, of a mirrored position, is no length in mm."""
    one = moving(1) if made == 'arm' else log(1, **RESTING)
    bag = str(write(replace(one, place=scale * one.place), tmp_path / 'bag'))
    written = str(tmp_path / 'c.yaml')
    assert main(['calibrate', bag, '-o', written]) == 0
    note, = (line for line in capsys.readouterr().err.splitlines() if 'times the inertia' in line)
    assert said in note and ' mm' not in note and note.endswith('suspect: inertia')
    found = load(written)
    assert abs(float(found.mass) - of.MASS) < 3.0 * found.mass.std
    assert 'inertia' in found.quality['suspect']


@pytest.mark.parametrize('make, stiffness, hook, lever', first([
    (moving, 10.0, (0.0, 0.5, -0.4), 0.1), (log, 10.0, (0.4, 0.3, 0.6), 0.1),
    *product([moving, log], [10.0, 30.0], [(0.0, 0.0, 0.0)], [0.0, 0.1])], 2))
def test_a_cable_that_pulls_is_told_and_not_taken_for_another_fault(make, stiffness, hook, lever):
    one = pulled(make(1, **(BRIEF if make is moving else RESTING)),
                 lambda place: stiffness * (hook - place), lever)
    with pytest.raises(DataError, match='something pulls at the tool') as error:
        judge(recording_of(one), DOWN)
    said = str(error.value)
    found, std = re.search(r'a spring of (\S+) ± (\S+) N/m', said).groups()
    assert abs(float(found) - stiffness) < 1.5 * float(std) and ', or ' not in said
    assert float(std) < 0.02 * stiffness


def test_a_recording_with_a_cable_does_for_a_known_tool(tmp_path, capsys):
    bag = str(write(pulled(moving(1, **BRIEF), lambda place: -10.0 * place), tmp_path / 'bag'))
    assert main(['check', bag]) == 1
    said = capsys.readouterr().out
    assert 'fault: something pulls at the tool' in said and 'estimate: yes' in said


@pytest.mark.parametrize('stiffness, slack, hook, seed', first([
    (10.0, 0.45, (0.0, 0.5, -0.2), 0), (40.0, 0.2, (0.0, 0.0, 0.5), 4),
    (40.0, 0.2, (0.0, 0.0, 0.5), 1), (40.0, 0.45, (0.0, 0.0, 0.5), 3)], 2))
def test_a_rope_that_is_slack_at_times_turns_and_tilts_nothing(stiffness, slack, hook, seed):
    """It is no spring, but torques show no more than the tool."""
    def rope(place):
        away = np.linalg.norm(hook - place, axis=1, keepdims=True)
        return stiffness * np.maximum(away - slack, 0.0) * (hook - place) / away

    one = pulled(moving(seed, seconds=20.0, rate=100.0), rope)
    try:
        assert judge(recording_of(one), DOWN) == ()
    except DataError as error:
        assert str(error).startswith('something pulls at the tool')


@pytest.mark.parametrize('make, of', [(moving, moving_arm), (log, wrong_recordings)])
def test_a_slight_pull_is_noted_beside_the_mass_that_it_may_spoil(make, of):
    one = make(1, **(BRIEF if make is moving else RESTING))
    found = identify(recording_of(pulled(one, lambda place: -2.0 * place)))
    note, = (said for said in found.quality['warnings'] if 'pulls at the tool' in said)
    assert note.startswith('something pulls at the tool by up to 0.')
    assert note.endswith('suspect: mass, com, wrench_bias')
    assert abs(float(found.mass) - of.MASS) < 3.0 * found.mass.std


@pytest.mark.parametrize('seed', first(range(50, 54)))
@pytest.mark.parametrize('wrong', ['30 % lost in bursts', 'poses of two digits'])
def test_other_logs_show_no_other_speed_and_no_other_point(wrong, seed):
    notes = judge(spoilt(wrong, seed), DOWN)
    assert not [note for note in notes if 'of real time' in note or 'point' in note]


@pytest.mark.parametrize('seed', first(range(80, 84)))
def test_a_wrench_that_a_driver_smooths_a_little_is_told_by_its_delay(seed):
    note, = judge(spoilt('wrench behind a low-pass of 10 Hz', seed), DOWN)
    assert 14 <= float(note.split('wrench rotates ')[1].split()[0]) <= 17
    assert judge(spoilt('nothing', seed), DOWN) == ()


@pytest.mark.parametrize('of, changes, seed, lever', first([
    (moving_arm, BRIEF, 70, 0.15), (wrong_recordings, RESTING, 70, 0.15),
    *product([moving_arm], [BRIEF, {}], range(71, 74), [0.15, 0.02])]))
def test_torques_about_another_point_leave_the_mass_as_it_is(
        of, changes, seed, lever, tmp_path, capsys):
    """What is estimated is that of a sensor at the point, as when it is stated."""
    make = moving if of is moving_arm else log
    one = about_another_point(make(seed, **changes), [0.0, 0.0, lever])
    bag, written = str(write(one, tmp_path / 'bag')), str(tmp_path / 'c.yaml')
    assert main(['calibrate', bag, '-o', written]) == 0
    note, = (line for line in capsys.readouterr().err.splitlines() if 'reference point of' in line)
    assert note.endswith('suspect: com, inertia')
    found = load(written)
    assert {'com', 'inertia'} == {*found.quality['suspect']}
    assert abs(float(found.mass) - of.MASS) < 3.0 * found.mass.std < 0.004 * of.MASS
    assert (abs(found.com.value - of.COM + [0.0, 0.0, lever]) < 3.5 * found.com.std).all()
    for begin, end in (('torques is (', ')'), ('--sensor-from-pose ', ' 0 0 0 1,')):
        place = note.split(begin)[1].split(end, maxsplit=1)[0]
        np.testing.assert_allclose([float(x) for x in place.split()], [0, 0, lever], atol=3e-3)


@pytest.mark.parametrize('rate', [1.0, 5.0])
def test_poses_interpolated_from_few_are_told_with_their_rate(rate):
    said = interpolated(recording_of(resampled(work(71), rate)).pose)
    assert abs(float(said.split('between poses at ')[1].split()[0]) - rate) < 0.05 * rate


def test_poses_as_they_were_recorded_or_coarse_are_not_called_interpolated():
    for wrong in ('nothing', 'pose repeats at 10 Hz', 'poses of two digits'):
        assert interpolated(spoilt(wrong, 72).pose) == ''


def test_a_slow_log_is_not_said_to_hold_no_rotation():
    one = log(3, poses=8, rate=10.0)
    notes = identify(recording_of(one.of_pose(np.arange(0, len(one.pose_t), 12)))).quality['notes']
    said, = (note for note in notes if 'inertia' in note)
    assert 'readings at 10 Hz in poses of' in said and 'record at a higher rate' in said


def test_messages_in_bursts_are_calibrated_as_when_they_were_measured():
    found = identify(recording_of(bursts(log(3, poses=8), 10)))
    assert float(found.mass) == pytest.approx(1.3, abs=2e-3)
    assert not [line for line in found.quality['warnings'] if 'search limit' in line]
    assert abs(found.quality['pose_delay']) < 0.006


def test_whole_numbers_in_all_channels_are_refused_as_counts():
    one = log(2, poses=8)
    with pytest.raises(DataError, match='readings are integers'):
        identify(recording_of(replace(one, wrench=np.round(30.0 * one.wrench))))
