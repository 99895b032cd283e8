"""Each row of the table is found in a run of the demo: a tool of 13 kg, a wall, a sliding tool."""

from dataclasses import replace

from calibration_runs import run
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge, refuse_late_accelerometer
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_from_vector,
)
from longer import but
import numpy as np
import pytest

DOWN = np.array([0.0, 0.0, -9.80665])
TURN = rotation_from_vector(np.radians([0.0, 0.0, 30.0]))
LEANING = rotation_from_vector(np.radians([10.0, 0.0, 0.0]))


@pytest.fixture(scope='module')
def recording():
    return checked(run(seed=3)).recording


def mapped(change):
    """Return what changes the wrench by ``change(values, R)``, R at its stamps."""
    def spoil(one):
        rows = np.searchsorted(one.pose.t, one.wrench.t).clip(max=len(one.pose) - 1)
        values = change(np.array(one.wrench.values), one.pose.R_base_sensor[rows])
        return replace(one, wrench=replace(one.wrench, values=values))
    return spoil


def posed(change):
    return lambda one: replace(one, pose=replace(one.pose, R_base_sensor=change(
        np.array(one.pose.R_base_sensor))))


def in_base(values, R):
    return np.hstack([np.einsum('nij,nj->ni', R, part) for part in np.split(values, 2, axis=1)])


def scalar_first(R):
    return matrix_from_quaternion(quaternion_from_matrix(R)[:, [3, 0, 1, 2]])


def half(values):
    return (np.arange(len(values)) > 0.5 * len(values))[:, None]


def weight(R, mass):
    return np.hstack([-mass * 9.80665 * R[:, 2], np.zeros((len(R), 3))])


def zeroed(values, R):
    """Zero the sensor half-way, as a driver does when it is asked to."""
    return values - half(values) * values[len(values) // 2]


ROWS = {
    'sign': (mapped(lambda w, R: -w), 'opposite sign'),
    'sign of forces': (mapped(lambda w, R: w * np.repeat([-1, 1], 3)), 'opposite sign'),
    'base': (mapped(in_base), 'expressed in base'),
    'inverted': (posed(lambda R: np.swapaxes(R, 1, 2)), 'that of base in the sensor'),
    'wxyz': (posed(scalar_first), 'in the order w, x, y, z'),
    'rotated': (mapped(lambda w, R: w @ np.kron(np.eye(2), TURN).T),
                r'turned by -?(30|29)\.\d+ \+- 0\.\d+ deg about z'),
    'mirrored': (mapped(lambda w, R: w[:, [1, 0, 2, 4, 3, 5]]), 'mirrored'),
    'one axis': (mapped(lambda w, R: w * [1, -1, 1, 1, -1, 1]), 'mirrored.*x, -y, z'),
    'one force axis': (mapped(lambda w, R: w * [1, -1, 1, 1, 1, 1]),
                       'forces are mirrored.*x, -y, z'),
    'leaning': (posed(lambda R: LEANING @ R), r'not level, gravity in it is (10\.|9\.)'),
    'exchanged': (mapped(lambda w, R: w[:, [3, 4, 5, 0, 1, 2]]), 'are exchanged'),
    'torque in base': (mapped(lambda w, R: np.hstack([w[:, :3], in_base(w, R)[:, 3:]])),
                       'torques are expressed in base'),
    'zeroed half-way': (mapped(zeroed), 'N off, however the sensor turns'),
    'payload half-way': (mapped(lambda w, R: w + half(w) * weight(R, 4.0)), 'carries 4.* kg more'),
    'weight removed': (mapped(lambda w, R: w - weight(R, 13.0)), 'removes the weight'),
    'clock': (lambda one: replace(one, wrench=replace(one.wrench, t=one.wrench.t + 1.5)),
              r'gravity turn 1\.5\d* s later'),
    'torque in N mm': (mapped(lambda w, R: w * np.repeat([1, 1e3], 3)), 'in N mm'),
    'torque in lbf in': (mapped(lambda w, R: w * np.repeat([1, 8.8507], 3)), 'in lbf in'),
    'sign of torques': (mapped(lambda w, R: w * np.repeat([1, -1], 3)), 'opposite sign of the f'),
    'mm': (lambda one: replace(one, pose=replace(one.pose, position=1e3 * one.pose.position)),
           'position is in mm'),
    'cm': (lambda one: replace(one, pose=replace(one.pose, position=1e2 * one.pose.position)),
           'position is in cm'),
}


AS_ON_AN_ARM = {'sign', 'sign of forces', 'base', 'inverted', 'wxyz', 'rotated', 'mirrored',
                'one force axis', 'leaning', 'exchanged', 'torque in base'}
"""Of which ``test_hypotheses`` has the like."""


@pytest.mark.parametrize('row', but(ROWS, AS_ON_AN_ARM))
def test_a_fault_is_refused_by_its_name(recording, row):
    spoil, said = ROWS[row]
    with pytest.raises(DataError, match=said):
        judge(spoil(recording), DOWN)


def test_torques_about_another_point_call_the_centre_of_mass_into_question(recording):
    note, = judge(mapped(lambda w, R: np.hstack([
        w[:, :3], w[:, 3:] - np.cross([0.0, 0.0, 0.3], w[:, :3])]))(recording), DOWN)
    assert 'are about a point' in note and 'suspect: com' in note


def test_the_run_itself_is_as_recorded(recording):
    assert judge(recording, DOWN) == ()


@pytest.mark.parametrize('late', [0.12, 0.2, -0.5])
def test_an_accelerometer_of_another_clock_is_refused_with_its_offset(recording, late):
    stream = recording.accelerometer
    spoilt = replace(recording, accelerometer=replace(stream, t=stream.t + late))
    with pytest.raises(DataError, match='^accelerometer shows gravity turn') as error:
        refuse_late_accelerometer(spoilt, DOWN)
    found, way = str(error.value).split('turn ')[1].split()[::2][:2]
    assert abs(float(found) - abs(late)) <= 0.02
    assert way == ('later' if late > 0 else 'earlier')


@pytest.mark.parametrize('late', [0.0, 0.02, 0.05])
def test_a_delay_of_an_accelerometer_is_left_to_the_fit(recording, late):
    stream = recording.accelerometer
    refuse_late_accelerometer(replace(recording, accelerometer=replace(
        stream, t=stream.t + late)), DOWN)
