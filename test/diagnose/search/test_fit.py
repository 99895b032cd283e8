"""A cable that pulls hard at an unknown point: products of what the fit has to find."""

from forcecal_ros.diagnose.dataset import split_datasets
from forcecal_ros.diagnose.model.linearised import linearised_model
from forcecal_ros.diagnose.search import model_comparison, posterior
from forcecal_ros.diagnose.search.model_comparison import Accepted, Candidate, joint_fit
from forcecal_ros.diagnose.search.posterior import Explanation
from forcecal_ros.diagnose.sources.pair import PairSource
import numpy as np
from own_arm import real, simulated, TOLERANCES
import pytest

CABLE = {'x': -2.0, 'y': 10.0, 'z': 14.0, 'stiffness': 20.0,
         'point_x': -0.1, 'point_y': 0.0, 'point_z': 0.0}
WITHOUT_STIFFNESS = np.array([0, 1, 2, 4, 5, 6])


@pytest.fixture(scope='module')
def model():
    ready, = PairSource(TOLERANCES, simulated()).prepare([real({'cable_force': CABLE})])
    return linearised_model(ready.dataset.rig, split_datasets([ready.dataset], False))


def fitted(model, pull):
    """Fit a cable without stiffness, from a pull at a point that is 0.2 m off."""
    start = np.array([*pull, 0.0, 0.05, 0.0, 0.18])
    cable = Accepted('cable_force', start, np.zeros(7), WITHOUT_STIFFNESS, frozenset())
    return posterior.weigh(joint_fit(model, [cable], np.zeros(len(model.nuisances))))


def test_from_any_start_a_fit_comes_to_the_same_place(model, monkeypatch):
    best = fitted(model, (0.5, 0.0, 0.0))
    for pull in ((0.05, -0.05, 0.05), (0.0, 0.0, -2.0)):
        found = fitted(model, pull)
        assert found.evidence == pytest.approx(best.evidence, abs=1.0)
        assert found.fit.accepted[0].theta == pytest.approx(best.fit.accepted[0].theta, abs=0.01)
    monkeypatch.setattr(model_comparison, 'FURTHER', 1)
    assert fitted(model, (0.05, -0.05, 0.05)).evidence < best.evidence - 1e5


def test_a_number_that_was_left_out_is_estimated_where_the_fit_has_come_to(model):
    found = fitted(model, (0.5, 0.0, 0.0))
    assert abs(found.fit.accepted[0].theta[0] - CABLE['x']) > 1.0  # what the spring does is in it
    completed = posterior._completed(found)
    cable, = completed.fit.accepted
    assert completed.evidence > found.evidence + 1000.0
    assert (np.abs(cable.theta - list(CABLE.values())) < 4.0 * cable.std).all()
    assert posterior._completed(completed) is completed


class Bent:
    """A model whose lines end where its fit did, until it is run there."""

    def __init__(self, runs):
        self.runs, self.done = runs, []

    def __copy__(self):
        return self

    def settle(self, *, whole=False):
        self.done.append('tried' if whole else 'run')
        return ('tried' if whole else 'run') in self.runs

    def linearise(self):
        self.done.append('linearised')

    def log_posterior(self):
        return 0.0


@pytest.mark.parametrize('runs, done', [
    ((), ['tried', 'run']), (('run',), ['tried', 'run', 'linearised']),
    (('tried',), ['tried', 'linearised'])])
def test_where_a_fit_ended_a_simulator_is_run_and_its_lines_are_those_of_there(
        monkeypatch, runs, done):
    model = Bent(runs)
    monkeypatch.setattr(posterior, 'replace', lambda model: model)
    monkeypatch.setattr(posterior, 'weigh', lambda fit, ways: Explanation(fit, 20.0, 0.0))
    fit = model_comparison.JointFit(model, [], [])
    monkeypatch.setattr(posterior, 'joint_fit_if_finite', lambda model, accepted: fit)
    now = Explanation(fit, 10.0, 0.0)
    found = posterior._linearised_anew(now)
    assert model.done == done and (found is now) == ('linearised' not in done)


@pytest.mark.parametrize('located', [True, False])
def test_where_a_recording_locates_no_instant_an_effect_acts_all_the_time(monkeypatch, located):
    always = [candidate('kp', 7.0, None), candidate('kv', 60.0, None)]
    begins = [candidate('kp', 42.0, 'gate'), candidate('kv', 61.0, 'gate')]
    table = posterior._Table.__new__(posterior._Table)
    table.parts, table.found, table.taken_up = {}, [], []
    monkeypatch.setattr(posterior, 'screen_change_points', lambda comparison, parts: begins)
    model = type('M', (), {'effects': {}, 'earlier': posterior.FIRST_RECORDING})
    now = type('Fit', (), {'model': model, 'accepted': [], 'comparison': lambda self: type(
        'C', (), {'screen': lambda self, found: always})()})()
    first, second = table.candidates(now)
    assert (first.effect.name, first.gate, first.otherwise) == ('kv', None, None)
    assert (second.effect.name, second.gate, second.otherwise) == ('kp', 'gate', always[0])
    monkeypatch.setattr(posterior, '_continued', lambda now, t, begun: (
        t if located or not t.gate else None))
    monkeypatch.setattr(posterior, 'weigh', lambda fit, ways: fit)
    found = posterior.extended(Explanation(now, 0.0, 0.0), table, set())
    assert found == [first, second if located else always[0]]


def test_what_came_closest_is_forgotten_where_nothing_is_linearised_anew(monkeypatch):
    """What looked like an effect far from where a simulator was tried may be a number of it."""
    def one(evidence, *names):
        model = type('M', (), {'gates': {}})
        fit = type('Fit', (), {
            'accepted': [type('A', (), {'name': name}) for name in names], 'jacobians': (),
            'model': model, 'comparison': lambda self: type('C', (), {
                'discrepancy_evidence': 0.0})})()
        return Explanation(fit, evidence, 0.0)

    nothing, anew, unlikely = one(0.0), one(90.0), one(5.0, 'kp')
    monkeypatch.setattr(posterior, '_Table', lambda model, found: None)
    monkeypatch.setattr(posterior, 'weigh', lambda fit: nothing)
    monkeypatch.setattr(posterior, '_weighed_beside', lambda start, best, table: (
        [unlikely] if best is nothing else []))
    monkeypatch.setattr(posterior, '_chosen', lambda start, found, best: (
        unlikely, {'kp': posterior.Features(5.0, 0.0)}))
    for after, features in ((nothing, {'kp'}), (anew, set())):
        monkeypatch.setattr(posterior, '_linearised_anew', lambda e, after=after: (
            after if e is nothing else e))
        found = posterior.search(nothing.fit.model, [])
        assert set(found.features) == features
        assert (found.closest is unlikely.fit) == bool(features)


def test_effects_are_chosen_by_the_first_step_of_their_fits(monkeypatch):
    """Of more than are fitted, the last by its columns is the best where they are taken anew."""
    n = 2 * posterior.REFINED
    likely = [candidate(f'effect {k}', 1000.0 - k, None) for k in range(n + 1)]
    likely[2] = candidate('step', 75.0, 'gate')
    likely[3] = candidate('diverges', 2000.0, None)
    monkeypatch.setattr(posterior, '_with', lambda now, t, rounds: (
        None if t.effect.name == 'diverges' else t.effect.name))
    monkeypatch.setattr(posterior, 'weigh', lambda fit: Explanation(
        fit, 500.0 + 10.0 * int(fit.split()[1]), 0.0))
    nothing = Explanation(type('Fit', (), {'accepted': []}), 500.0, 0.0)
    chosen = posterior._by_first_step(nothing, likely)
    assert [t.effect.name for t, _ in chosen] == ['step', f'effect {n - 1}', f'effect {n - 2}',
                                                  f'effect {n - 3}']
    assert [fit for _, fit in chosen] == [None, f'effect {n - 1}', f'effect {n - 2}',
                                          f'effect {n - 3}']
    few = likely[:posterior.REFINED]
    assert posterior._by_first_step(nothing, few) == [(t, None) for t in few]


def candidate(name, evidence, gate):
    return Candidate(type('Effect', (), {'name': name}), evidence, 1, np.zeros(0), (), gate)
