"""Odds of an effect beside a discrepancy."""

from forcecal_ros.diagnose.model.gates import BIAS
from forcecal_ros.diagnose.search.odds import IMITATORS, log_odds, most_probable, others_beside
from forcecal_ros.effects import EFFECTS
import pytest


def test_an_effect_counts_the_others_by_what_they_bring_in_its_own():
    factors = {'tool_mass': 1000.0, 'tool_com': 500.0, 'base_tilt': 10.0}
    assert others_beside('tool_mass', factors) == pytest.approx(0.51)
    assert others_beside('base_tilt', factors) == pytest.approx(2.0)
    assert log_odds('tool_mass', factors, 100.0) > log_odds('tool_com', factors, 100.0)


def test_ten_times_what_is_missing_makes_an_effect_likelier_by_the_same_factor():
    one, ten = (log_odds('tool_mass', {'tool_mass': x}, 100.0) for x in (100.0, 1000.0))
    assert ten - one == pytest.approx(
        log_odds('wrench_crosstalk', {'wrench_crosstalk': 1000.0}, 100.0)
        - log_odds('wrench_crosstalk', {'wrench_crosstalk': 100.0}, 100.0))
    assert one > 0.0


@pytest.mark.parametrize('name', IMITATORS)
def test_what_takes_up_anything_is_less_likely_at_the_same_evidence(name):
    assert name in {*EFFECTS, BIAS.name}
    assert log_odds(name, {name: 100.0}, 100.0) < 0.0 < log_odds(
        'tool_mass', {'tool_mass': 100.0}, 100.0)
    assert most_probable(name) < most_probable('tool_mass') < 1.0
