"""Probabilities of effects: one calibration, no constant that belongs to one effect."""

import json

from forcecal_ros.diagnose.search.calibration import Features, features_of, FILE, stored
from forcecal_ros.diagnose.search.posterior import Posterior, ties_of, weighed
from forcecal_ros.diagnose.verdict import UNKNOWN
import pytest

STRONG = Features(2000.0, 50.0)
probability = stored().probability


def test_the_file_says_how_it_was_fitted_and_how_well_it_does_on_what_it_was_not_fitted_to():
    document = json.loads(FILE.read_text())
    assert document['provenance']
    for found in (document['figures'], document['fit_cross_validated']):
        assert found['cases'] >= 200
        assert found['log_score'] > document['log_score_of_frequencies']
    assert len(document['weights']) == len(STRONG.row()) == 2


def test_the_more_is_missing_the_less_likely_an_effect_is():
    values = [probability(STRONG._replace(missing=m)) for m in (0.0, 200.0, 2000.0, 20000.0)]
    assert values == sorted(values, reverse=True)
    assert values[0] > 0.8 and values[-1] < 0.5


def test_effects_that_together_leave_nothing_are_not_likelier_than_each_alone():
    """Several fit any background: what the others bring counts against the weaker ones."""
    alone = probability(Features(300.0, 1000.0))
    three = features_of({'wrench_gain': 900.0, 'wrench_crosstalk': 300.0, 'cable_force': 400.0},
                        0.0)
    assert three['wrench_crosstalk'].beside == 2.0
    assert three['cable_force'].beside == pytest.approx(1.75)
    assert probability(three['wrench_crosstalk']) < max(alone, 0.5)
    assert probability(three['wrench_gain']) > 0.5
    pair = features_of({'wrench_gain': 9e4, 'wrench_delay': 3e4}, 0.0)
    assert min(map(probability, pair.values())) > 0.9


@pytest.mark.parametrize('possible', [True, False])
def test_what_does_harm_or_stops_at_a_limit_is_a_candidate_and_not_named(possible):
    found = Posterior(None, (), (), {'wrench_crosstalk': Features(186.0, 28.9)},
                      {'wrench_crosstalk': {'cable_force': -15.0}})
    named, candidates = weighed(found, True, possible)
    assert (named['wrench_crosstalk'] > 0.5) == possible
    assert (candidates[0][0] == UNKNOWN) != possible
    assert {'wrench_crosstalk', 'cable_force'} < dict(candidates).keys()


def test_effects_that_are_alike_share_the_probability_and_are_tied():
    found = Posterior(None, (), (), {'wrench_delay': STRONG},
                      {'wrench_delay': {'wrench_lowpass': -0.1, 'tool_mass': -1000.0}})
    named, candidates = weighed(found, False, True)
    assert dict(candidates)['wrench_lowpass'] == pytest.approx(named['wrench_delay'], rel=0.05)
    assert 'tool_mass' not in dict(candidates)
    note, = ties_of(found)
    assert note.startswith('wrench_delay and wrench_lowpass are confounded')


def test_a_gap_without_an_effect_is_unknown_and_what_comes_closest_is_listed_by_its_evidence():
    likely, unlikely = (Posterior(None, (), (), {'cable_force': Features(100.0, missing)},
                                  {'cable_force': {'tool_mass': -5.0, 'tool_com': -100.0}},
                                  closest='not accepted') for missing in (20.0, 2000.0))
    assert weighed(likely, False, True)[1] == []
    assert ties_of(likely) == ()
    for found in (likely, unlikely):
        candidates = weighed(found, True, True)[1]
        assert [name for name, _ in candidates] == [UNKNOWN, 'cable_force', 'tool_mass']
    assert dict(weighed(likely, True, True)[1])[UNKNOWN] == 0.5
    assert dict(candidates)[UNKNOWN] > 0.8
    assert weighed(Posterior(None, (), ()), True, True)[1] == [(UNKNOWN, 1.0)]
