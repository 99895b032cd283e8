"""The second edition since part 2: limits, begins, the tool's measure of a shrink, the oracle."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
if not (ROOT / 'blind').is_dir():
    pytest.skip('the blind check is not part of what is installed', allow_module_level=True)

from blind.noise import Colour
from blind.second import case, rules
from blind.second.ground import Ground
from blind.second.shrink import true_shrink


class _Plain:
    """A recording of one wrench of one channel, of white noise of 0.5; its energy is plain."""

    name, moved = 'real', [SimpleNamespace(t=np.arange(1000) / 1000.0)]
    levels, judged_seconds = {'wrench': np.array([0.5])}, 1.0
    ground = Ground({'wrench': [Colour(1.0, np.ones(1), np.ones(1))]},
                    {'wrench': np.array([0.5])}, [('zero', {'wrench': np.ones((1000, 1))})])

    def nuisance(self, name):
        return '', 0.0

    def start(self, name):
        return 0.1, 2.0

    def of_effect(self, name, size, seed):
        return {'wrench': size * np.sin(2 * np.pi * 5.0 * self.moved[0].t)[:, None]}


def test_sizes_keep_to_the_limits_of_the_library_since_the_second_part():
    for drawn_by, largest in ((rules.FIRST, 2.0), (rules.MENDED, 0.5)):
        assert case._size(_Plain(), 'tool_mass', 1e9, 7, drawn_by)[0] == largest


def test_energy_counts_from_the_begin_of_an_effect_where_one_recording_judges():
    whole, late = (case._size(_Plain(), 'wrench_gain', 400.0, 7, rules.MENDED, onset)[0]
                   for onset in (None, 0.5))
    assert late / whole == pytest.approx(np.sqrt(2.0), rel=0.05)


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


def test_nuisance_takes_up_no_more_than_three_of_its_sigma_of_what_is_left():
    for size, left in ((2.0, 0.0), (5.0, 2.0)):
        found = _Plain.ground.left({'wrench': np.full((1000, 1), size)})['wrench']
        assert found == pytest.approx(np.full((1000, 1), left), abs=0.01)


def test_oracle_finds_the_strength_of_an_effect_within_its_error():
    base, rng = _Plain(), np.random.default_rng(3)
    effect = base.of_effect('wrench_gain', 0.2, 7)
    measured = {'wrench': 1.0 * effect['wrench'] + 0.5 * rng.standard_normal((1000, 1)) + 0.7}
    strength, error = base.ground.strength(measured, effect)
    assert error == pytest.approx(base.ground.net(effect)**-0.5) and abs(strength - 1) < 3 * error
