"""Which hypothesis is fitted in full, and which is likelier."""

from types import SimpleNamespace

from forcecal_ros.diagnose.model.evidence import Score
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.acceptance import weights
from forcecal_ros.diagnose.search.exchange import _acts, _near, _stands_at_bound
from forcecal_ros.diagnose.search.fitted import Accepted, HypothesisFit
from forcecal_ros.diagnose.search.selection import _missing
from forcecal_ros.sim.rig.file import load_rig
import numpy as np


def hypothesis_fit(name, evidence, free=1):
    return HypothesisFit(name, np.zeros(free), np.zeros(free), np.arange(free), np.zeros(0),
                         frozenset(), evidence / 2.0, evidence, Score(10.0, 100.0, 100.0), 1.0,
                         0.0, 1000, True)


def test_what_has_nearly_the_evidence_of_an_effect_is_fitted_in_full_whatever_it_gains():
    own, other = hypothesis_fit('wrench_lowpass', 355.0, 2), hypothesis_fit('wrench_delay', 337.0)
    others = hypothesis_fit('tool_friction', 5.0), hypothesis_fit('tool_mass', -3.0)
    results = [own, other._replace(gain=-28.0), *others]
    assert [t.name for t in _near(results, 'wrench_lowpass', 100)] == ['wrench_delay']
    nothing = [own._replace(evidence=-1.0), other._replace(evidence=-0.9, gain=-1.0)]
    assert not _near(nothing, 'wrench_lowpass', 100)


def test_beside_a_large_effect_a_small_lead_does_not_decide_and_fewer_parameters_do():
    weight = weights([hypothesis_fit('wrench_lowpass', 150_070.0, 2),
                      hypothesis_fit('wrench_delay', 150_000.0)])
    assert 0.0 < weight['wrench_delay'] - weight['wrench_lowpass'] < 1.0
    small = weights([hypothesis_fit('wrench_lowpass', 170.0, 2),
                     hypothesis_fit('wrench_delay', 100.0)])
    assert small['wrench_lowpass'] - small['wrench_delay'] > np.log(1e6)


def test_beside_much_that_is_missing_a_lead_of_less_does_not_decide():
    fits = [hypothesis_fit('tool_mass', 3808.0), hypothesis_fit('tool_com', 3774.0)]
    for missing, most in ((0.0, -4.0), (33.0, -2.0), (1e6, -0.05)):
        odds = weights(fits, missing)
        assert odds['tool_com'] - odds['tool_mass'] < most
    assert odds['tool_com'] - odds['tool_mass'] > -0.1


def test_where_something_is_missing_what_takes_up_anything_has_to_lead():
    fits = [hypothesis_fit('wrench_crosstalk', 3808.0), hypothesis_fit('tool_com', 3808.0)]
    alike, beside = weights(fits), weights(fits, 33.0)
    assert alike['tool_com'] == alike['wrench_crosstalk']
    assert beside['tool_com'] > beside['wrench_crosstalk'] + 1.0


def test_what_is_missing_in_other_streams_is_not_held_against_an_effect():
    without, whole = (SimpleNamespace(unexplained=np.array(costs), missing_by_stream=np.array(
        [40.0, 1e5, 0.0])) for costs in ([900.0, 1e5, 5.0], [100.0, 1e5 - 8.0, 6.0]))
    acts = {'wrench_gain': _acts(without, whole), 'tool_mass': np.ones(3),
            'robot_delay': _acts(whole, whole)}
    missing = _missing(whole, acts)
    assert missing['wrench_gain'] == 40.0 + 0.01 * 1e5
    assert missing['tool_mass'] == missing['robot_delay'] == 40.0 + 1e5


def test_an_effect_at_the_end_of_its_range_is_told_from_one_within():
    model = LinearisedModel(load_rig(None), ())
    free = np.arange(3)

    def accepted(*theta):
        return Accepted('accel_misalignment', np.array(theta), np.zeros(3), free, frozenset())

    low = model.library['accel_misalignment'].parameters[0].low
    assert _stands_at_bound(model, accepted(low, 0.0, 0.0))
    assert not _stands_at_bound(model, accepted(0.9 * low, 0.0, 0.1))
