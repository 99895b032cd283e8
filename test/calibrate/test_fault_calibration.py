"""A calibration is never wrong in silence: faulty runs are refused, or say what they spoil."""

from fault_calibration import judged
from longer import first
import pytest

CLEAR = {
    'collision on the way': 'inertia', 'tool friction': 'tool',
    'wrench tared half-way': 'wrench_bias', 'accelerometer saturates': '',
    'optidrive of wrong sign': ''}
"""Faults, and an estimate that is called into question where they are strong."""


@pytest.mark.parametrize('fault', CLEAR)
def test_no_estimate_is_far_off_without_being_called_into_question(fault):
    verdict = judged(fault, 0)
    assert verdict.word in {'refused', 'flagged', 'right'}
    if CLEAR[fault]:
        assert any(CLEAR[fault] in line.partition('suspect: ')[2] for line in verdict.said)
    else:
        assert verdict.word != 'right'
    assert all('\n' not in line for line in verdict.said)


@pytest.mark.long
def test_an_accelerometer_that_is_late_is_calibrated_with_its_delay():
    assert judged('accelerometer late', 0).word == 'right'


@pytest.mark.parametrize('fault, seed, said', first([
    ('accelerometer wrong', 9, 'accel.y varies 22 times as much in pose 3'),
    ('optidrive wrong', 9, 'optidrive varies 249 times as much in pose 1')]))
def test_a_jump_in_a_pose_does_not_hide_behind_its_own_noise(fault, seed, said):
    verdict = judged(fault, seed)
    assert verdict.word == 'flagged'
    assert any(said in line for line in verdict.said)


@pytest.mark.long
def test_a_short_contact_in_one_pose_does_no_harm():
    assert judged('contact in one pose', 4).word == 'right'


def test_a_healthy_run_says_nothing():
    assert judged('none', 200).word == 'right'
