"""The second edition since part 2: limits, begins, shrinks, sound laws, simpler methods."""

from dataclasses import dataclass
from types import SimpleNamespace

from blind.noise import Colour
from blind.second import case, methods, rules
from blind.second.ground import Ground
from blind.second.judged import Judged
from blind.second.law import added, Kind, Moved
from blind.second.shrink import closed, squares, true_shrink
import numpy as np
import pytest


class _Plain:
    """A recording of one wrench of one channel, of white noise of 0.5; its energy is plain."""

    name, moved = 'real', [SimpleNamespace(t=np.arange(1000) / 1000.0)]
    effects = ('wrench_gain',)
    levels, judged_seconds = {'wrench': np.array([0.5])}, 1.0
    nominal_levels = levels
    ground = Ground({'wrench': [Colour(1.0, np.ones(1), np.ones(1))]},
                    {'wrench': np.array([0.5])}, [('zero', {'wrench': np.ones((1000, 1))})])

    def nuisance(self, name):
        return '', 0.0

    def start(self, name):
        return 0.1, 2.0

    def knowing(self, forms):
        return self

    def of_effect(self, name, size, seed):
        return {'wrench': size * np.sin(2 * np.pi * 5.0 * self.moved[0].t)[:, None]}


def test_true_shrink_is_of_block_means_over_the_noise_and_leaves_what_the_fit_does():
    base, t = _Plain(), _Plain.moved[0].t
    effect = base.of_effect('wrench_gain', 1.0, 7)
    nothing = {'wrench': np.zeros((1000, 1))}
    energy = base.ground.net(effect)
    assert true_shrink(base, effect, nothing) == pytest.approx(1 - energy**-0.5, abs=1e-6)
    slow = {'wrench': 0.5 * np.cos(2 * np.pi * 3.0 * t)[:, None]}
    assert true_shrink(base, effect, slow) == pytest.approx(1 - np.sqrt(0.25 / 1.25), abs=0.01)
    # what is faster than a block counts in the energy and not in the tool's measure
    fast = {'wrench': 0.5 * np.cos(2 * np.pi * 250.0 * t)[:, None]}
    assert base.ground.net(fast) > 400.0
    assert true_shrink(base, effect, fast) == pytest.approx(1 - energy**-0.5, abs=0.01)


def test_oracle_finds_the_strength_of_an_effect_within_its_error():
    base, rng = _Plain(), np.random.default_rng(3)
    effect = base.of_effect('wrench_gain', 0.2, 7)
    measured = {'wrench': 1.0 * effect['wrench'] + 0.5 * rng.standard_normal((1000, 1)) + 0.7}
    strength, error = base.ground.strength(measured, effect)
    assert error == pytest.approx(base.ground.net(effect)**-0.5) and abs(strength - 1) < 3 * error


@dataclass
class _Twice:
    """Two recordings of a tool at rest, of which only the wrench is looked at."""

    ground = _Plain.ground
    own = 0.0

    def __post_init__(self):
        still, t = np.zeros((1000, 3)), np.arange(1000) / 1000.0
        self.moved = [Moved(t, np.tile(np.eye(3), (1000, 1, 1)), still, still, still, still, still,
                            still, np.zeros((1000, 6)), still, 1.0, np.zeros(3), i)
                      for i in range(2)]

    def of_law(self, what):
        return {'wrench': what.wrench[:, :1]}


def _first_alone(rng, share=0.25):
    """Act in the first recording alone, but for a share of the draws."""
    both = rng.random() < share
    wave = np.sin(20.0 * np.arange(1000) / 1000.0)
    return lambda m: added(m, np.outer(wave * (m.index == 0 or both), [1.0, 0.0, 0.0]))


def test_law_is_drawn_again_until_both_recordings_have_it():
    base, rng = _Twice(), np.random.default_rng(1)
    for _ in range(5):
        both, energy, most = case._law(base, Kind(_first_alone), rng, rules.THIRD)
        assert np.abs(both[1].wrench).max() == pytest.approx(np.abs(both[0].wrench).max())
        largest = np.abs(both[0].times(np.sqrt(most / energy)).wrench).max()
        assert largest == pytest.approx(1.5 * base.moved[0].load)


def test_shrink_of_a_label_is_by_the_noise_that_the_answer_states():
    base, t = _Plain(), _Plain.moved[0].t
    effect = base.of_effect('wrench_gain', 1.0, 7)
    slow = {'wrench': 0.5 * np.cos(2 * np.pi * 3.0 * t)[:, None]}
    found = squares(base, effect, slow)
    assert closed(found, {'force.x': 0.5}) == pytest.approx(true_shrink(base, effect, slow))
    both = {**found, 'force.y': [4.0, 4.0]}  # a channel that the effect does not touch
    loud, quiet = closed(both, {'force.x': 0.5, 'force.y': 100.0}), closed(
        both, {'force.x': 0.5, 'force.y': 0.5})
    assert loud > quiet + 0.3 and closed(both, {'force.x': 0.5, 'force.y': 0.0}) == closed(
        both, {'force.x': 0.5})
    label = {'generator': 'rig', 'kind': 'library', 'effect': 'wrench_gain', 'excused': [],
             'doubtful': [], 'ambiguous': False, 'shrink': both}
    answer = {'document': {'verdict': 'identified', 'gap': {
        'noise': {'force.x': 0.5, 'force.y': 100.0}}}}
    assert Judged('a', label, answer).shrink == loud


def test_simpler_methods_name_what_is_there_and_the_oracle_its_strength():
    base, rng = _Plain(), np.random.default_rng(3)
    label = {'kind': 'library', 'effect': 'wrench_gain', 'size': 0.2, 'part_seed': 7,
             'onset': None}
    noise = 0.5 * rng.standard_normal((1000, 1))
    for size, names in ((0.0, []), (0.2, ['wrench_gain'])):
        measured = {'wrench': base.of_effect('wrench_gain', size, 7)['wrench'] + noise + 0.7}
        said = methods.judge(base, measured)
        assert all(said[one]['names'] == names for one in ('bic', 'everything', 'bounded')), said
        assert max(said['bic']['odds'], key=said['bic']['odds'].get) == ''.join(names)
        found = methods.told(base, label, measured)
        assert abs(found['strength'] - size / 0.2) < 3 * found['error']
    assert methods.told(base, {**label, 'kind': 'none'}, measured) == {}
