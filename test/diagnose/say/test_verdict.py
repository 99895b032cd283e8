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


@pytest.mark.parametrize('name, closed, limits, word, said', [
    ('wrench_gain', 0.96, {}, 'identified', ''),
    ('wrench_gain', 0.96, {'at_limit': ['wrench_gain.fx = -0.9']}, 'unknown',
     'wrench_gain comes closest, but wrench_gain.fx = -0.9 reached its limit'),
    ('tool_com', 0.99, {'at_tolerance': ['tool.mass', 'wrench.bias.fy']}, 'partial',
     'at the limit of the tolerance: tool.mass, wrench.bias.fy (another robot')])
def test_what_stands_at_a_limit_is_not_identified_or_part_of_the_cause(
        name, closed, limits, word, said):
    found = verdict([name], [(name, 0.96)], UnexplainedPart(0.5, 'noise'), closed, True, **limits)
    assert found[0] == word and said in found[1]


@pytest.mark.parametrize('closed, why', [
    (0.3, 'explains 30 % of the residual'),
    (-0.1, 'adding it increases the held-out residual')])
def test_what_is_too_little_to_be_named_is_unknown_with_the_reason(closed, why):
    word, sentence = verdict(['wrench_gain'], [('unknown', 0.8), ('wrench_gain', 0.2)],
                             UnexplainedPart(3.0, 'a line'), closed, True)
    assert word == 'unknown'
    assert f'wrench_gain comes closest, but {why}; residual: a line' in sentence
