"""Probabilities of effects: one calibration, no constant that belongs to one effect."""

import json

from forcecal_ros.diagnose.judge.judgement import ties_of, weighed
from forcecal_ros.diagnose.search.calibration import Features, FILE, probability
from forcecal_ros.diagnose.search.posterior import Posterior
from forcecal_ros.diagnose.verdict import UNKNOWN
import numpy as np
import pytest

STRONG = Features(2000.0, 50.0, 0.97)


def test_the_file_says_how_it_was_fitted_and_how_well_it_does_on_what_it_was_not_fitted_to():
    stored = json.loads(FILE.read_text())
    assert stored['cases'] >= 15 and stored['provenance']
    assert stored['cross_validation']['log_score'] > np.log(0.5)
    assert len(stored['weights']) == len(STRONG.row()) == 2


def test_the_more_is_missing_the_less_likely_an_effect_is():
    values = [probability(STRONG._replace(missing=m)) for m in (0.0, 200.0, 2000.0, 20000.0)]
    assert values == sorted(values, reverse=True)
    assert values[0] > 0.8 and values[-1] < 0.5


def test_what_leaves_more_than_it_explains_is_unlikely_however_much_evidence_there_is():
    large = STRONG._replace(missing=800.0)
    found = [probability(large._replace(explained=share)) for share in (0.97, 0.8, 0.4, 0.2)]
    assert found == sorted(found, reverse=True)
    assert found[0] == found[1] > 0.8 and found[-1] < 0.5


@pytest.mark.parametrize('closed, is_gap, named', [
    (0.9, True, True), (0.12, True, False), (0.12, False, True), (-0.3, False, False)])
def test_what_leaves_more_than_it_explains_or_does_harm_is_unknown(closed, is_gap, named):
    found = Posterior(None, (), (), {'wrench_crosstalk': Features(18.6, 28.9)},
                      {'wrench_crosstalk': {}})
    assert (weighed(found, is_gap, closed)[0]['wrench_crosstalk'] > 0.5) == named


def test_effects_that_are_alike_share_the_probability_and_are_tied():
    found = Posterior(None, (), (), {'wrench_delay': STRONG},
                      {'wrench_delay': {'wrench_lowpass': -0.1, 'tool_mass': -1000.0}})
    named, candidates = weighed(found, False, 0.9)
    assert dict(candidates)['wrench_lowpass'] == pytest.approx(named['wrench_delay'], rel=0.05)
    assert 'tool_mass' not in dict(candidates)
    note, = ties_of(found)
    assert note.startswith('wrench_delay and wrench_lowpass are confounded')


def test_a_gap_without_an_effect_is_unknown_and_what_comes_closest_is_listed():
    found = Posterior(None, (), (), nearest={'cable_force': 0.0, 'tool_mass': -100.0})
    assert weighed(found, False, 0.0)[1] == []
    candidates = weighed(found, True, 0.0)[1]
    assert candidates[0][0] == UNKNOWN and candidates[1][0] == 'cable_force'
