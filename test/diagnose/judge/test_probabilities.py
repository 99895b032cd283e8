"""Probabilities of effects, and the verdict that follows."""

from forcecal_ros.diagnose.judge.probabilities import nameless, probabilities, Slot, UNKNOWN
from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.verdict import verdict
import numpy as np
import pytest

NOTHING_LEFT = UnexplainedPart(0.4, '')


def test_equal_odds_make_the_verdict_ambiguous_and_a_bad_fit_makes_it_unknown():
    slot = Slot('base_tilt', {'cable_force': -0.2})
    named, candidates = probabilities([slot], NOTHING_LEFT, 0.98)
    assert {n for n, _ in candidates} == {'base_tilt', 'cable_force'}
    chances = dict(candidates)
    assert named['base_tilt'] == chances['base_tilt']
    assert chances['cable_force'] / chances['base_tilt'] == pytest.approx(np.exp(-0.2))
    assert 0.9 < sum(chances.values()) < 1.0
    assert verdict(['base_tilt'], candidates, NOTHING_LEFT, 0.98, True)[0] == 'ambiguous'
    left = UnexplainedPart(5.0, 'force.x')
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.4, True)[0] == 'unknown'
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.9, True)[0] == 'partial'
    for rest in (left, NOTHING_LEFT):
        word, said = verdict(['base_tilt'], [('base_tilt', 0.9)], rest, -1.1, True,
                             with_discrepancy=True)
        assert word == 'unknown'
        assert 'makes what was held out worse' in said and '%' not in said
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.98, True)[0] == 'identified'
    doubtful = [('unknown', 0.6), ('base_tilt', 0.4)]
    assert verdict(['base_tilt'], doubtful, left, 0.98, True)[0] == 'unknown'
    assert verdict(['base_tilt'], doubtful, NOTHING_LEFT, 0.98, True)[0] == 'partial'
    glaring = UnexplainedPart(17.0, 'pose.x')
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], glaring, 0.98, True)[0] == 'partial'


def test_the_more_is_closed_by_the_fewer_effects_the_surer_they_are():
    def sure(closed, *names):
        return probabilities([Slot(n, {}) for n in names], NOTHING_LEFT, closed)[0][names[0]]
    assert sure(0.5, 'base_tilt') < sure(0.9, 'base_tilt') < sure(0.999, 'base_tilt') < 1.0
    assert sure(0.99, 'base_tilt') > sure(0.99, 'base_tilt', 'tool_com') > sure(
        0.99, 'base_tilt', 'tool_com', 'tool_mass')


def test_what_is_known_before_any_model_counts_among_the_effects():
    alone = dict(probabilities([], NOTHING_LEFT, 0.99, known=1)[1])
    assert alone == {}
    two = probabilities([Slot('wrench_bias_drift', {})], NOTHING_LEFT, 0.99, known=1)[0]
    one = probabilities([Slot('wrench_bias_drift', {})], NOTHING_LEFT, 0.99)[0]
    assert two['wrench_bias_drift'] < one['wrench_bias_drift']


def test_a_faint_effect_beside_a_strong_one_takes_nothing_from_it():
    missing = {'wrench_gain': 240.0, 'wrench_crosstalk': 240.0}
    alone = nameless({'wrench_gain': 3113.0}, missing)['wrench_gain']
    faint = nameless({'wrench_gain': 3113.0, 'wrench_crosstalk': 39.0}, missing)
    alike = nameless({'wrench_gain': 3113.0, 'wrench_crosstalk': 3000.0}, missing)
    assert alone < 0.15
    assert faint['wrench_gain'] == pytest.approx(alone, abs=0.02)
    assert faint['wrench_crosstalk'] > 0.5
    assert alike['wrench_gain'] > 2.0 * alone


def test_unknown_is_what_the_strong_effects_leave_and_not_the_faint_ones():
    factors = {'wrench_gain': 3000.0, 'wrench_crosstalk': 30.0}
    doubts = {'wrench_gain': 0.1, 'wrench_crosstalk': 0.6}
    named, candidates = probabilities([Slot(n, {}) for n in factors], NOTHING_LEFT, 0.9, 0, doubts,
                                      factors)
    assert named == pytest.approx({'wrench_gain': 0.9, 'wrench_crosstalk': 0.4})
    assert candidates[0] == ('wrench_gain', pytest.approx(0.9))
    assert dict(candidates)[UNKNOWN] == pytest.approx(0.105, abs=0.001)


def test_an_effect_is_doubted_by_what_it_brings_beside_what_is_left():
    assert nameless({'tool_mass': 100.0}, {'tool_mass': 1e5})['tool_mass'] > 0.99
    assert nameless({'tool_mass': 1e5}, {'tool_mass': 1e5})['tool_mass'] == pytest.approx(
        0.35, abs=0.01)
    assert 0.05 < nameless({'tool_mass': 1e6}, {'tool_mass': 1e5})['tool_mass'] < 0.1
    # never surer than experience with cases can show
    assert nameless({'tool_mass': 1e9}, {'tool_mass': 0.0})['tool_mass'] == pytest.approx(0.05)
    assert nameless({'cable_force': 1e9}, {'cable_force': 0.0})['cable_force'] == pytest.approx(
        0.25)


def test_where_nothing_is_named_what_comes_closest_shares_what_unknown_leaves():
    left = UnexplainedPart(5.0, 'force.x')
    closest = {'tool_com': 0.0, 'tool_mass': -1.0, 'base_tilt': -2.0, 'wrench_gain': -9.0}
    candidates = probabilities([], left, 0.0, nearest=closest)[1]
    assert [name for name, _ in candidates] == [UNKNOWN, 'tool_com', 'tool_mass', 'base_tilt']
    chances = dict(candidates)
    assert sum(chances.values()) == pytest.approx(1.0)
    assert chances['tool_com'] / chances['tool_mass'] == pytest.approx(np.e)
    assert dict(probabilities([], left, 0.0)[1]) == {UNKNOWN: chances[UNKNOWN]}
