"""A cable that pulls hard at an unknown point: products of what the fit has to find."""

from forcecal_ros.diagnose.dataset import split_datasets
from forcecal_ros.diagnose.model.linearised import linearised_model
from forcecal_ros.diagnose.search import model_comparison, posterior
from forcecal_ros.diagnose.search.model_comparison import Accepted, joint_fit
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


@pytest.mark.parametrize('last, step, longer', [
    ([2.0, 1.0], [1.6, 0.8], 5.0),  # 1 + 0.8 + 0.64 + ... such steps lead where it goes
    ([2.0, 1.0], [1.999, 1.0], 10.0), ([2.0, 1.0], [0.8, 0.4], None),
    ([2.0, 1.0], [-1.6, -0.8], None), ([2.0, 1.0], [0.8, -1.6], None),
    ([0.0, 0.0], [1.6, 0.8], None), ([2.0, 1.0], [0.0, 0.0], None)])
def test_steps_that_repeat_are_made_at_once(last, step, longer):
    found = model_comparison._longer(np.array(last), np.array(step))
    assert found == (() if longer is None else pytest.approx((longer,)))


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
    return type('Candidate', (), {'effect': type('Effect', (), {'name': name}), 'ways': 1,
                                  'evidence': evidence, 'gate': gate})
