"""An effect that is as large as the library allows is no explanation."""

from forcecal_ros.diagnose.judge.found_effects import at_limit, Parameter
from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.say.verdict import verdict
import pytest


@pytest.mark.parametrize('name, key, value, std, unit, said', [
    ('wrench_gain', 'fx', -0.9, 0.001, '1', ['wrench_gain.fx = -0.9']),
    ('wrench_gain', 'fx', -0.895, 0.001, '1', ['wrench_gain.fx = -0.895']),
    ('wrench_gain', 'fx', -0.88, 0.001, '1', []),
    ('wrench_gain', 'fx', -0.9, 0.4, '1', []),
    ('tool_mass', 'change', -0.5, 1e-4, '1', ['tool_mass.change = -0.5']),
    ('tool_com', 'x', 0.2, 1e-4, 'm', ['tool_com.x = 0.2 m']),
    ('wrench_saturation', 'fy', 0.95, 0.0, 'N', []),
    ('wrench_delay', 'delay', 0.05, 1e-4, 's', []),
    ('accel_highpass', 'no such number', 0.9, 0.0, '1', []),
    ('an effect of a simulator of the user', 'kp', 0.9, 0.0, '1', [])])
def test_numbers_at_their_limit_are_named_if_they_are_known(name, key, value, std, unit, said):
    assert at_limit(name, {key: Parameter(value, std, unit)}) == said


def test_what_stands_at_its_limit_is_not_identified():
    given = (['wrench_gain'], [('wrench_gain', 0.96)], UnexplainedPart(0.5, 'noise'), 0.96, True)
    assert verdict(*given)[0] == 'identified'
    word, sentence = verdict(*given, at_limit=['wrench_gain.fx = -0.9'])
    assert word == 'unknown'
    assert 'wrench_gain comes closest, but wrench_gain.fx = -0.9 is as large as' in sentence
