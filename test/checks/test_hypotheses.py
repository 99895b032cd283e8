"""Each row of the table is found on an arm that never rests, on rests, and beside a known tool."""

from dataclasses import replace
from functools import cache
import re

from calibration_runs import run
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.evidence import explain, on_grid
from forcecal_ros.checks.hypotheses import judge, Known, refuse_other_mass
from forcecal_ros.checks.messages import Stated
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.diagnose.recordings import require_axes_of
from forcecal_ros.sim.rig.file import load_rig
from longer import first
import moving_arm
from moving_arm import moving
import numpy as np
import pytest
from static_sets import static_set
import wrong_recordings
from wrong_recordings import log, recording_of, work, WRONG

DOWN = np.array([0.0, 0.0, -9.80665])
SWAPPED = [1, 0, 2, 4, 3, 5]
TURN = rotation_from_vector(np.radians([0.0, 0.0, 30.0]))
QUARTER = rotation_from_vector(np.radians([0.0, 0.0, 90.0]))
LEANING = rotation_from_vector(np.radians([10.0, 0.0, 0.0]))


def mapped(change):
    return lambda one: replace(one, wrench=change(one.wrench))


def wrong(name):
    return lambda one: WRONG[name].make(one, np.random.default_rng(5))


def turned(Q):
    return mapped(lambda w: w @ np.kron(np.eye(2), Q).T)


def leaning(one):
    q = wrong_recordings.quaternion_from_matrix(LEANING @ wrong_recordings.orientations(one))
    return replace(one, q=q, place=one.place @ LEANING.T)


def jump(one):
    step = np.array([4.0, -2.0, 3.0, 0.1, 0.0, 0.0])
    return replace(one, wrench=one.wrench + step * wrong_recordings.half(one)[:, None])


def picked_up(one):
    R = wrong_recordings.at_wrench(one)
    return replace(one, wrench=one.wrench + 0.5 * wrong_recordings.half(one)[:, None] * np.hstack(
        [-9.80665 * R[:, 2], np.zeros((len(R), 3))]))


def late(one, seconds=1.5):
    return replace(one, stamp=one.stamp + round(1e9 * seconds))


ROWS = {
    'sign': (mapped(lambda w: -w), 'opposite sign'),
    'sign of the forces': (mapped(lambda w: w * np.repeat([-1, 1], 3)), 'opposite sign'),
    'sign of the torques': (mapped(lambda w: w * np.repeat([1, -1], 3)), 'opposite sign'),
    'base': (lambda one: replace(one, wrench=wrong_recordings.in_base(
        one, np.full(len(one.t), True))), 'in the base frame, not in the sensor'),
    'inverted': (wrong('pose of base in the sensor'), 'it is inverted'),
    'wxyz': (wrong('quaternions w first'), 'in the order w, x, y, z'),
    '30 deg': (turned(TURN), r'rotated by -?(30|29)\.\d+ ± 0\.\d+ deg about z'),
    '90 deg': (turned(QUARTER), r'rotated by -?(90|89)\.\d+ .* about z.*x, y, z measure'),
    'swapped': (mapped(lambda w: w[:, SWAPPED]), 'mirrored .*x, y, z measure y, x, z'),
    'one force axis': (mapped(lambda w: w * [1, -1, 1, 1, 1, 1]), 'forces are mirrored.*x, -y, z'),
    'leaning': (leaning, r'tilted: gravity is (10\.|9\.9)'),
    'crosstalk': (mapped(lambda w: w + 0.1 * w[:, [2]] * [1, 0, 0, 0, 0, 0]),
                  r'it has crosstalk of \+(9\.[89]|10) % from force\.z to force\.x'),
    'crosstalk into torque': (mapped(lambda w: w + 0.01 * w[:, [2]] * [0, 0, 0, 0, 0, 1]),
                              r'it has crosstalk of \+(9\.\d|10) mm from force\.z to torque\.z'),
    'exchanged': (wrong('force and torque exchanged'), 'force and torque are swapped'),
    'torque in base': (wrong('torque in base, force not'), 'torques are expressed in the base'),
    'torque axes': (mapped(lambda w: w[:, [0, 1, 2, 4, 5, 3]]), 'torques are about other axes'),
    'clock': (late, r'gravity rotates 1\.5\d? s later'),
    'jump': (jump, r'N in all orientations: the bias changed .*, or a contact began'),
    'picked up': (picked_up, r'carries 0\.[45]\d* kg more'),
}
LOGS = {'arm': cache(lambda: moving(1)),
        'rests': cache(lambda: log(1, hold=2.0, move=1.2, rate=100.0))}


@pytest.mark.parametrize('which', first(LOGS))
@pytest.mark.parametrize('row', ROWS)
def test_a_fault_is_refused_by_its_name(which, row):
    spoil, said = ROWS[row]
    with pytest.raises(DataError, match=said):
        judge(recording_of(spoil(LOGS[which]())), DOWN)


@pytest.mark.parametrize('spoil', first([leaning, turned(TURN)]))
def test_a_row_of_two_faults_is_no_alternative_to_one_of_them_beside_contact(spoil):
    with pytest.raises(DataError) as error:
        judge(recording_of(spoil(work(1, poses=10, rate=100.0))), DOWN)
    assert ', or ' not in str(error.value)


@pytest.mark.parametrize('seed', first(range(3)))
def test_sound_recordings_are_as_they_are(seed):
    for one in (moving(seed), log(seed, hold=2.0, move=1.2, rate=100.0),
                work(seed, poses=10, rate=100.0)):
        assert judge(recording_of(one), DOWN) == ()
    for rate in (0.0, 100.0):
        assert judge(static_set(seed, rate)[0], DOWN) == ()


KNOWN = Known(moving_arm.MASS, moving_arm.COM, moving_arm.BIAS)
BY_TOOL = {
    'kgf': (mapped(lambda w: w * np.repeat([1 / 9.80665, 1], 3)), 'forces are in kgf'),
    'mN': (mapped(lambda w: w * np.repeat([1e3, 1], 3)), 'forces are in mN'),
    'N mm': (mapped(lambda w: w * np.repeat([1, 1e3], 3)), 'torques are in N mm'),
    'lbf in': (mapped(lambda w: w * np.repeat([1, 8.8507], 3)), 'torques are in lbf in'),
    'sign of the torques': (mapped(lambda w: w * np.repeat([1, -1], 3)), 'opposite sign of the f'),
    'weight removed': (lambda one: replace(one, wrench=one.wrench - np.hstack(
        [-moving_arm.MASS * 9.80665 * wrong_recordings.at_wrench(one)[:, 2],
         np.zeros((len(one.t), 3))])), 'subtracts its weight'),
}


@pytest.mark.parametrize('row', BY_TOOL)
def test_a_known_tool_tells_units_and_signs_while_the_arm_moves(row):
    spoil, said = BY_TOOL[row]
    with pytest.raises(DataError, match=said):
        judge(recording_of(spoil(moving(2))), DOWN, Stated(by='calibration'), KNOWN)


def test_a_cable_that_lifts_most_of_the_tool_is_no_unit_of_force():
    """A weight of 1 / 4.45 as much would be in lbf, were there little else in the forces."""
    up = (1.0 - 1.0 / 4.448) * moving_arm.MASS * 9.80665
    one = wrong_recordings.pulled(moving(2), lambda place: [0.0, 0.0, up] - 20.0 * place)
    note, = judge(recording_of(one), DOWN, Stated(by='calibration'), KNOWN)
    assert note.startswith('something pulls at the tool by up to') and ' lbf' not in note


def test_a_known_tool_passes_and_another_one_is_noted():
    assert judge(recording_of(moving(3)), DOWN, Stated(by='calibration'), KNOWN) == ()
    note, = judge(recording_of(moving(3, mass=1.4)), DOWN, Stated(by='calibration'), KNOWN)
    assert 'carries 1.400' in note and '± 0.000' in note and 'tool or payload' in note


@pytest.mark.parametrize('spoil', first([
    mapped(lambda w: w.clip([-8.0] * 6, [12.0] * 6)), mapped(lambda w: 0.4 * w),
    turned(rotation_from_vector(np.radians([0.0, 0.0, 1.0])))], 2))
def test_pushes_gains_biases_and_small_turns_are_left_to_whoever_looks_for_them(spoil):
    recording = recording_of(spoil(work(1, poses=10, rate=100.0)))
    model = Known(wrong_recordings.MASS, wrong_recordings.COM)
    assert all('centre of mass' in note for note in judge(
        recording, DOWN, Stated(by='rig'), model))


@pytest.mark.parametrize('factor, said', [
    (1e3, 'in mm'), (1e2, 'in cm'), (1 / 0.0254, 'in inches'), (1e-3, 'in m but read as mm')])
def test_lengths_of_positions_are_told_by_inertia(factor, said):
    one = moving(4)
    with pytest.raises(DataError, match=said):
        judge(recording_of(replace(one, place=factor * one.place)), DOWN)


@pytest.mark.parametrize('delay, make', [
    (6, moving), (6, log), (30, log), pytest.param(30, moving, marks=pytest.mark.long)])
def test_a_delay_is_noted_as_one_and_not_as_smoothing(delay, make):
    note, = judge(recording_of(late(make(7), 1e-3 * delay)), DOWN)
    found = re.search(r'rotates (\d+\.\d+) ± 0\.\d+ ms later', note)
    assert abs(float(found[1]) - delay) < 1.0 and 'smooths' not in note


@pytest.mark.parametrize('make', [moving, log])
def test_crosstalk_is_not_noted_as_smoothing(make):
    assert judge(recording_of(mapped(lambda w: w + 0.03 * w[:, [2, 2, 2, 5, 5, 5]] * [
        1, 0, 0, 0, 0, 0])(make(7))), DOWN) == ()


def test_crosstalk_is_noted_up_to_what_a_rotation_within_tolerance_shows():
    def log(part):
        return recording_of(mapped(lambda w: w + part * w[:, [2]] * [1, 0, 0, 0, 0, 0])(
            LOGS['rests']()))

    assert judge(log(0.05), DOWN) == (
        'the wrench has crosstalk of +5 % from force.z to force.x',)
    with pytest.raises(DataError, match=r'it has crosstalk of \+(5\.9|6) %'):
        judge(log(0.06), DOWN)


def test_a_sign_that_is_stated_wrongly_is_named():
    with pytest.raises(DataError, match='wrench.sign to 1 '):
        judge(recording_of(mapped(lambda w: -w)(moving(1))), DOWN, Stated(wrench_sign=-1))


@pytest.mark.parametrize('sign', [1, -1])
def test_a_rig_names_the_other_sign_than_the_stated_one(sign):
    recording = recording_of(mapped(lambda w: -w)(moving(1)))
    with pytest.raises(DataError, match=f'wrench.sign to {-sign} '):
        require_axes_of(load_rig(), replace(recording, wrench_sign=sign))


@pytest.mark.parametrize('scale', [30.0, 100.0])
def test_raw_counts_are_refused_by_their_bias(scale):
    counts = mapped(lambda w: scale * w + [20_000.0, 20_000.0, 20_000.0, 0, 0, 0])
    with pytest.raises(DataError, match='raw counts'):
        judge(recording_of(counts(moving(8))), DOWN)


def test_a_scale_decides_what_the_unit_is():
    refuse_other_mass(1.31, 0.002, 1.3)
    for found, said in ((1.3 / 9.80665, 'its forces are in kgf'), (0.9, 'subtracts a load')):
        with pytest.raises(DataError, match=said):
            refuse_other_mass(found, 0.002, 1.3)


def test_a_tool_that_is_displaced_is_explained_with_its_displacement():
    """Without it, inertia put the centre of mass 54 mm away in a sound recording of the demo."""
    recording, tool = checked(run(seed=1)), load_rig().tool
    found = explain(on_grid(recording, DOWN))
    for com, covariance in (found.com_by_force, found.com_by_torque):
        np.testing.assert_allclose(com, tool.com, atol=1e-3)
        assert np.trace(covariance) < 1e-6
    assert not judge(recording, DOWN)
