"""What a verdict leaves open, and what it does not."""

from forcecal_ros.diagnose.verdict import UnexplainedPart, verdict
import pytest

NOTHING = UnexplainedPart(0.5, 'force.x')


@pytest.mark.parametrize('known, said', [
    ({}, 'the recording down to its noise'),
    ({'slow_noise': True}, 'the recording down to its noise, if slow variation is noise'),
    ({'band': 12.5}, 'the recording below 12.5 Hz down to its noise')])
def test_no_gap_says_what_was_taken_for_noise_and_what_was_not_looked_at(known, said):
    assert verdict([], [], NOTHING, None, True, **known) == (
        'no_gap', f'the recalibrated rig explains {said}')


def test_what_values_show_by_themselves_is_named_beside_what_is_unknown():
    named, left = ['wrench_gain', 'wrench_saturation'], UnexplainedPart(90.0, 'torque.z')
    candidates = [('wrench_saturation', 0.99), ('unknown', 0.74), ('wrench_gain', 0.25)]
    given = named, candidates, left, 0.95, True
    assert verdict(*given, with_discrepancy=True)[0] == 'unknown'
    word, said = verdict(*given, with_discrepancy=True, certain=['wrench_saturation'])
    assert word == 'partial' and said.endswith('likelier than wrench_gain')
