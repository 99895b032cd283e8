"""Explanations ranked by marginal likelihood: effects that rules of a search once exchanged."""

from dataclasses import replace
import json

from forcecal_ros.cli.diagnose import _earlier
from forcecal_ros.cli.plan import _candidates
from forcecal_ros.core.errors import UsageError
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.evidence import fit, Gram, Prior
from forcecal_ros.diagnose.result import _from_document, Diagnosis, to_document
from forcecal_ros.diagnose.search import posterior
from forcecal_ros.diagnose.search.calibration import Features
from forcecal_ros.diagnose.search.model_comparison import _Level, CHANCE, ModelComparison
from forcecal_ros.diagnose.search.posterior import Explanation
from forcecal_ros.diagnose.sources.rig import RigSource
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest
from rig_recordings import bare, FREE, own_recording

NO_PRIOR = Prior(*(np.zeros(0) for _ in range(4)))


def explanation(names, evidence, gates=0):
    fit = type('Fit', (), {'accepted': [type('A', (), {'name': n}) for n in names],
                           'model': type('M', (), {'gates': dict.fromkeys(range(gates))})})
    return Explanation(fit, evidence, 0.0)


def test_a_change_point_has_to_bring_what_any_effect_has_to():
    for more, gates in ((0.5, 0), (1.5, 1)):
        always = explanation(['tool_mass'], 100.0)
        changes = explanation(['tool_mass'], 100.0 + more * posterior.WORTH, gates=1)
        kept, = posterior._likeliest([changes, always])
        assert len(kept.fit.model.gates) == gates


@pytest.mark.parametrize('brings, kept', [(0.5, {'a'}), (1.5, {'a', 'b'})])
def test_an_effect_is_kept_only_if_it_is_worth_its_place_beside_the_others(
        monkeypatch, brings, kept):
    found, less = chosen(monkeypatch, {'a': 100.0 - brings * posterior.WORTH, 'b': 60.0},
                         explanation(['a', 'b'], 100.0))
    assert found.names == kept == set(less)


@pytest.mark.parametrize('better, kept', [(-1.0, {'a'}), (1.0, {'c'})])
def test_the_rest_of_an_explanation_is_exchanged_for_a_better_one(monkeypatch, better, kept):
    found, less = chosen(monkeypatch, {'a': 100.0, 'b': 60.0}, explanation(['a', 'b'], 101.0),
                         explanation(['c'], 100.0 + better))
    assert found.names == kept == set(less)


def chosen(monkeypatch, alone, *found):
    """Choose among explanations; of two effects each alone has this evidence, neither has none."""
    monkeypatch.setattr(posterior, '_without', lambda start, now, name: explanation(
        sorted(now.names - {name}), alone.get(''.join(now.names - {name}), 0.0)))
    return posterior._chosen(None, found, explanation([], 0.0))


def test_what_takes_the_place_of_an_effect_brings_half_as_much_and_is_fitted_once(monkeypatch):
    lost, fitted = 100.0, []
    table = type('Table', (), {'candidates': lambda self, now: [
        type('T', (), {'effect': type('E', (), {'name': name}), 'evidence': share * lost,
                       'gate': None, 'ways': 1, 'nested': (), 'otherwise': None})
        for name, share in (('known', 2.0), ('more', 0.6), ('less', 0.4))]})()
    monkeypatch.setattr(posterior, '_without', lambda start, now, name: explanation(
        sorted(now.names - {name}), -lost))
    monkeypatch.setattr(posterior, '_with', lambda now, t: fitted.append(t.effect.name))
    known = {frozenset(('b', 'known'))}
    out = posterior._exchanged(None, explanation(['a', 'b'], 0.0), table, known)
    assert [one.names for one in out] == [{'b'}]
    assert fitted == ['more'] and frozenset(('b', 'more')) in known


def test_rivals_get_lines_of_their_own_where_the_likeliest_gained_more_by_its_own(monkeypatch):
    """A late wrench was a low-pass of 0.99: only its line was taken where its fit ended."""
    found = [explanation([name], evidence) for name, evidence in (
        ('wrench_lowpass', 853.0), ('wrench_delay', 849.0), ('wrench_hysteresis', 198.0))]

    def anew(one, nearby=False):
        return one._replace(evidence=one.evidence + 340.0)

    monkeypatch.setattr(posterior, 'extended', lambda *_: found)
    monkeypatch.setattr(posterior, '_linearised_anew', anew)
    monkeypatch.setattr(posterior, '_exchanged', lambda *_: [])
    lowpass, delay, hysteresis = posterior._weighed_beside(None, explanation([], 0.0), None)
    assert [one.evidence for one in (lowpass, delay, hysteresis)] == [1193.0, 1189.0, 198.0]


def test_alternatives_are_those_in_the_place_of_one_effect():
    chosen = explanation(['a', 'b'], 50.0)
    others = [explanation(['a', 'c'], 40.0), explanation(['b', 'c'], 45.0),
              explanation(['a'], 10.0)]
    assert posterior._instead(chosen, others, 'b') == {'c': -10.0}
    assert posterior._instead(chosen, others, 'a') == {'c': -5.0}


def test_a_further_recording_continues_from_what_was_as_likely():
    features = {'wrench_delay': Features(90.0, 4.0)}
    first = posterior.Posterior(None, (), (), features, {'wrench_delay': {'wrench_lowpass': 0.4}})
    document = to_document(Diagnosis('ambiguous', '', (NamedEffect('wrench_delay', {
        'delay': Parameter(0.004, 1e-4, 's')}, 0.5),), earlier=first.earlier()), {}, None)
    earlier = _from_document(json.loads(json.dumps(document))).earlier
    assert earlier.of(['wrench_lowpass']) == 0.0
    assert earlier.of({'wrench_delay'}) == -0.4
    # neither none nor what was not listed was likelier than the least of those listed
    assert earlier.of([]) == earlier.of(['tool_mass']) == -90.4
    assert earlier.missing == 4.0 and earlier.numbers['wrench_delay']['delay'] == (0.004, 1e-4)


def test_a_prior_against_another_model_is_refused_and_candidates_are_planned_for(tmp_path):
    found = Diagnosis('ambiguous', 'either', candidates=(('wrench_delay', 0.6), ('unknown', 0.3)))
    (tmp_path / 'diagnosis.json').write_text(json.dumps(to_document(found, {}, None)))
    with pytest.raises(UsageError, match='compared with a rig, this recording with measured'):
        _earlier(str(tmp_path), 'measured motion')
    with pytest.raises(UsageError, match='verdict ambiguous has no candidates to continue'):
        _earlier(str(tmp_path), '')
    assert _candidates(str(tmp_path)) == ('wrench_delay',)
    (tmp_path / 'diagnosis.json').write_text(json.dumps(to_document(
        replace(found, verdict='no_gap', candidates=()), {}, None)))
    with pytest.raises(UsageError, match='no_gap has no candidates'):
        _candidates(str(tmp_path))


@pytest.mark.parametrize('gained, counted', [(50.0, 50.0), (1e4, 120.0)])
def test_what_a_discrepancy_gains_is_missing_as_far_as_noise_could_not_gain_it(gained, counted):
    """A wrench alone: twenty for each of six channels, beside what no discrepancy explains."""
    comparison = ModelComparison.__new__(ModelComparison)
    comparison.every = Gram(np.zeros((0, 0)), np.zeros(0), 1e4, 10000)
    comparison.null_evidence, comparison.null = -6000.0, fit(comparison.every, NO_PRIOR)
    comparison.levels = [_Level(NO_DISCREPANCY, comparison.every, comparison.null._replace(
        log_evidence=-6000.0 - gained))]
    comparison._products = type('Products', (), {'parts': range(6)})
    by_chance = CHANCE * np.sqrt(5000.0)
    assert comparison.missing_evidence == pytest.approx(1000.0 - by_chance + counted)


def test_a_filter_is_fitted_with_and_without_its_second_order():
    """By the linear screen the first order is likelier; as fitted, a delay is likelier than it."""
    recording = own_recording(parts=FREE[:8], effects={
        'wrench_lowpass': {'time_constant': 0.008, 'second_order': 0.5}})
    found, = RigSource(load_rig()).diagnose(bare(recording)).diagnosis.effects
    assert found.name == 'wrench_lowpass' and found.probability > 0.9
    values = found.parameters
    assert values['time_constant'].value == pytest.approx(0.008, abs=3 * 3e-5)
    assert values['second_order'].value == pytest.approx(0.5, abs=3 * 0.006)
