"""What the sentence of a verdict without a gap leaves open."""

from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.say.verdict import verdict
import pytest

NOTHING = UnexplainedPart(0.5, 'force.x')


@pytest.mark.parametrize('known, said', [
    ({}, 'the recalibrated rig explains the recording down to its noise'),
    ({'slow_noise': True}, 'the recalibrated rig explains the recording down to its noise, if '
     'what varies slowly is noise'),
    ({'band': 12.5}, 'the recalibrated rig explains the recording below 12.5 Hz down to its '
     'noise')])
def test_no_gap_says_what_was_taken_for_noise_and_what_was_not_looked_at(known, said):
    assert verdict([], [], NOTHING, None, True, **known) == ('no_gap', said)
