"""Rows of the table that ``test_hypotheses`` lacks, in a run of the demo: a tool that slides."""

import re

from calibration_runs import run
from changed import later, with_values
from forcecal_ros.checks.entry import checked
from forcecal_ros.checks.hypotheses import judge, refuse_late_accelerometer
from forcecal_ros.checks.messages import Finding
from forcecal_ros.core.errors import DataError
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest
from rig_recordings import own_recording

DOWN = np.array([0.0, 0.0, -9.80665])


@pytest.fixture(scope='module')
def recording():
    return checked(run(seed=3))


def test_a_delay_and_crosstalk_are_noted_as_what_they_are_and_not_as_a_filter(recording):
    late, = judge(later(recording, 0.006), DOWN)
    assert re.search(r'wrench rotates (5\.9|6|6\.0)\d* \S+ \S+ ms later than the pose', late)
    crossed, = judge(with_values(recording, lambda w: w + 0.03 * w[:, 2:3] * np.eye(6)[0]), DOWN)
    assert crossed == 'the wrench has crosstalk of +3 % from force.z to force.x'


def test_torques_about_another_point_call_the_centre_of_mass_into_question(recording):
    note, = judge(with_values(recording, lambda w: np.hstack([
        w[:, :3], w[:, 3:] - np.cross([0.0, 0.0, 0.3], w[:, :3])])), DOWN)
    assert isinstance(note, Finding)
    assert 'reference point of the torques' in note and note.suspect == ('com', 'inertia')
    np.testing.assert_allclose(note.point, [0.0, 0.0, 0.3], atol=2e-3)


@pytest.mark.parametrize('late', [0.12, -0.5])
def test_an_accelerometer_of_another_clock_is_refused_with_its_offset(recording, late):
    with pytest.raises(DataError, match='^accelerometer: by its stamps, gravity rotates') as error:
        refuse_late_accelerometer(later(recording, late, 'accelerometer'), DOWN)
    found, way = str(error.value).split('rotates ')[1].split()[::2][:2]
    assert abs(float(found) - abs(late)) <= 0.02
    assert way == ('later' if late > 0 else 'earlier')


def test_a_delay_of_an_accelerometer_is_left_to_the_fit(recording):
    refuse_late_accelerometer(later(recording, 0.05, 'accelerometer'), DOWN)


def test_a_diagnosis_names_the_unit_before_it_looks_for_effects():
    scaled = with_values(own_recording(20), lambda values: values / 9.80665)
    diagnosis = RigSource(load_rig()).diagnose(scaled).diagnosis
    assert diagnosis.verdict == 'invalid_data'
    assert 'its forces are in kgf; multiply by 9.8066' in diagnosis.reason
