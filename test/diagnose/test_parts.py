"""Parts of the diagnosis by themselves: limits, noise, bounds, intervals, odds, stamps."""

from forcecal_ros.diagnose import remainder
from forcecal_ros.diagnose.evidence import fit, Gram, Prior, Score
from forcecal_ros.diagnose.gap import Errors
from forcecal_ros.diagnose.left import _foreign
from forcecal_ros.diagnose.limits import _best_limit
from forcecal_ros.diagnose.nuisances import nuisances, spreads
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.ranking import weights
from forcecal_ros.diagnose.selection import _near
from forcecal_ros.diagnose.spectral_lines import Line
from forcecal_ros.diagnose.trial import Trial
from forcecal_ros.diagnose.verdict import probabilities, Remains, verdict
from forcecal_ros.recording.checks.clipping import clipping, quantisation
from forcecal_ros.recording.checks.clocks import clocks, skew_between
from forcecal_ros.recording.streams import CHANNELS, Recording, Stream
from forcecal_ros.simulators.rig.file import load_rig
import numpy as np
import pytest
from scipy.optimize import lsq_linear

NOTHING_LEFT = Remains(0.4, '')


def trial(name, evidence, free=1):
    return Trial(name, np.zeros(free), np.zeros(free), np.arange(free), np.zeros(0), frozenset(),
                 evidence / 2.0, evidence, Score(10.0, 100.0, 100.0), 1.0, 0.0, 1000, True)


def test_what_has_nearly_the_evidence_of_an_effect_is_fitted_in_full_whatever_it_gains():
    own, alike = trial('wrench_lowpass', 355.0, 2), trial('wrench_delay', 337.0)
    others = trial('tool_friction', 5.0), trial('tool_mass', -3.0)
    trials = [own, alike._replace(gain=-28.0), *others]
    assert [t.name for t in _near(trials, 'wrench_lowpass', 100)] == ['wrench_delay']
    nothing = [own._replace(evidence=-1.0), alike._replace(evidence=-0.9, gain=-1.0)]
    assert not _near(nothing, 'wrench_lowpass', 100)


def test_a_bounded_fit_is_the_best_one_within_the_bounds_however_alike_the_columns_are():
    rng = np.random.default_rng(3)
    for _ in range(20):
        common = rng.standard_normal((400, 1))
        columns = common + 0.3 * rng.standard_normal((400, 6))
        data = columns @ rng.uniform(-6.0, 6.0, 6) + rng.standard_normal(400)
        gram = Gram(columns.T @ columns, columns.T @ data, float(data @ data), 400)
        found = fit(gram, Prior(np.zeros(6), np.ones(6), np.full(6, 3.0))).x
        best = lsq_linear(np.vstack([columns, np.eye(6)]), np.append(data, np.zeros(6)),
                          (-3.0, 3.0), tol=1e-12).x
        assert found == pytest.approx(best, abs=1e-4)




def test_a_soft_limit_under_noise_is_found_where_it_is():
    rng = np.random.default_rng(0)
    signal = 100.0 * np.sin(np.linspace(0.0, 60.0, 6000))
    measured = np.clip(signal, -80.0, 80.0) + 0.3 * rng.standard_normal(6000)
    limit, removed = _best_limit(signal, measured)
    assert limit == pytest.approx(80.0, abs=100.0 * 0.5 / 40)
    assert removed > 0.9 * np.sum((measured - signal) ** 2)



def test_noise_that_grows_from_octave_to_octave_is_expected_and_one_strong_octave_is_not():
    dof = np.full(len(remainder.BANDS), 100.0)
    pink = np.array([8.0, 4.0, 2.0, 1.2, 1.0, 1.0, 1.0, 1.0])
    assert remainder._colour([(pink * dof, dof)] * 3) == pytest.approx(pink)
    alone = np.array([1.0, 1.0, 50.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert remainder._colour([(alone * dof, dof)] * 3)[2] == remainder.STEEPEST


def test_a_clock_that_is_wrong_by_more_than_half_a_hertz_is_wrong_against_the_rig():
    t = 1e-3 * np.arange(20_000) * (1.0 + 1e-3)
    recording = Recording(wrench=Stream(t, np.zeros((len(t), 6))))
    found = clocks(recording, {'wrench': 1000.0})
    assert skew_between(found)['wrench'] == pytest.approx(1e-3, rel=1e-6)


def test_errors_of_parameters_are_drawn_as_large_as_they_are_expected():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((16, 3, 3))
    errors = Errors(root @ np.swapaxes(root, 1, 2), np.diag([1.0, 4.0, 0.25]))
    draws = np.array([errors.drawn(rng) for _ in range(2000)])
    scatter = draws.std(axis=0) / np.sqrt(len(draws))
    assert (np.abs(draws.mean(axis=0) - errors.expected()) < 5.0 * scatter).all()


def test_beside_a_gross_effect_a_small_lead_does_not_decide_and_fewer_parameters_do():
    weight = weights([trial('wrench_lowpass', 150_070.0, 2), trial('wrench_delay', 150_000.0)])
    assert 0.0 < weight['wrench_delay'] - weight['wrench_lowpass'] < 1.0
    small = weights([trial('wrench_lowpass', 170.0, 2), trial('wrench_delay', 100.0)])
    assert small['wrench_lowpass'] - small['wrench_delay'] > np.log(1e6)


def test_equal_odds_make_the_verdict_ambiguous_and_a_bad_fit_makes_it_unknown():
    named, candidates = probabilities([('base_tilt', {'cable_force': -0.2})], NOTHING_LEFT, 0.98)
    assert {n for n, _ in candidates} == {'base_tilt', 'cable_force'}
    chances = dict(candidates)
    assert named['base_tilt'] == chances['base_tilt']
    assert chances['cable_force'] / chances['base_tilt'] == pytest.approx(np.exp(-0.2))
    assert 0.9 < sum(chances.values()) < 1.0
    assert verdict(['base_tilt'], candidates, NOTHING_LEFT, 0.98, True)[0] == 'ambiguous'
    left = Remains(5.0, 'force.x')
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.4, True)[0] == 'unknown'
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.9, True)[0] == 'partial'
    for rest in (left, NOTHING_LEFT):
        word, said = verdict(['base_tilt'], [('base_tilt', 0.9)], rest, -1.1, True, allowed=True)
        assert word == 'unknown'
        assert 'makes the rest worse' in said and '%' not in said
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], left, 0.98, True)[0] == 'identified'
    doubtful = [('unknown', 0.6), ('base_tilt', 0.4)]
    assert verdict(['base_tilt'], doubtful, left, 0.98, True)[0] == 'unknown'
    assert verdict(['base_tilt'], doubtful, NOTHING_LEFT, 0.98, True)[0] == 'partial'
    glaring = Remains(17.0, 'pose.x')
    assert verdict(['base_tilt'], [('base_tilt', 0.9)], glaring, 0.98, True)[0] == 'partial'


def test_the_more_is_closed_by_the_fewer_effects_the_surer_they_are():
    def sure(closed, *names):
        return probabilities([(n, {}) for n in names], NOTHING_LEFT, closed)[0][names[0]]
    assert sure(0.5, 'base_tilt') < sure(0.9, 'base_tilt') < sure(0.999, 'base_tilt') < 1.0
    assert sure(0.99, 'base_tilt') > sure(0.99, 'base_tilt', 'tool_com') > sure(
        0.99, 'base_tilt', 'tool_com', 'tool_mass')


def test_what_is_known_before_any_model_counts_among_the_effects():
    alone = dict(probabilities([], NOTHING_LEFT, 0.99, known=1)[1])
    assert alone == {}
    two = probabilities([('wrench_bias_drift', {})], NOTHING_LEFT, 0.99, known=1)[0]
    one = probabilities([('wrench_bias_drift', {})], NOTHING_LEFT, 0.99)[0]
    assert two['wrench_bias_drift'] < one['wrench_bias_drift']


def test_no_step_makes_a_mass_or_a_spring_negative():
    rig = load_rig(None)
    found = nuisances(rig, 'acc1', ('wrench', 'accelerometer', 'optidrive', 'pose'))
    p = Problem(rig, (), found, np.array(spreads(rig, found)), centre=np.zeros(len(found)))
    p.centre = p.moved(np.full(len(found), -1e6))
    moved = p.current()
    assert moved.tool.mass == pytest.approx(0.05 * rig.tool.mass)
    assert moved.wall.stiffness == pytest.approx(0.05 * rig.wall.stiffness)
    assert moved.optidrive.stiffness == pytest.approx(0.05 * rig.optidrive.stiffness)
    offset = [n.name for n in found].index('wrench.bias.0')
    assert p.centre[offset] == -1e6


def test_a_line_beside_that_of_an_explained_vibration_is_its_own():
    beside = Line('force.x', 64.31, 1.0, 5000.0)
    other = Line('force.y', 50.0, 1.0, 60.0)
    p = Problem(load_rig(None), (), effects={'spindle_vibration': {'frequency': 64.01}})
    lines, notes = _foreign((beside, other), p)
    assert lines == (other,) and 'wanders about 64.01 Hz' in notes[0]
    assert _foreign((beside, other), Problem(load_rig(None), ())) == ((beside, other), ())


@pytest.mark.parametrize('step, ends', [(0.1, 2), (5.0, 0)])
def test_the_last_of_a_few_rough_steps_is_not_the_end_of_a_range(step, ends):
    t = 0.001 * np.arange(20_000)
    force = np.zeros((len(t), 6))
    force[:, 0] = np.clip(120.0 * np.sin(2.0 * np.pi * 0.3 * t), -100.0, 100.0)
    force += 0.2 * np.random.default_rng(5).standard_normal(force.shape)
    force[:, 0] = np.clip(step * np.round(force[:, 0] / step), -100.0, 100.0)
    recording = Recording(wrench=Stream(t, force, 'ft_sensor'))
    noise = dict.fromkeys(CHANNELS['wrench'], 0.2)
    found = clipping(recording, quantisation(recording, noise), noise)
    assert [round(abs(x.limit)) for x in found] == [100] * ends
