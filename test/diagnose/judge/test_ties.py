"""
Effects that do the same, each on a simulated recording along a measured motion.

A lag of less than a sample is a delay or a low-pass, whichever the driver's samples make it.
"""

from dataclasses import replace
from types import SimpleNamespace

from forcecal_ros.core.geometry import skew
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.diagnose.inputs.motion_dataset import held_out, prepare_motion
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.judge.probabilities import probabilities, Slot
from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.judge.ties import FORMS, lag, ties_of, TOLD_BY, untold
from forcecal_ros.diagnose.model.linearised import linearised_model
from forcecal_ros.diagnose.say.advice import advice
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.signals import Delay, Filter, FORCES
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

DT, LAG = 1e-3, 4e-4
STEP, SECONDS = 0.004, 12.0
RIG = load_rig('rigid_tool.yaml')


def crosstalk(matrix):
    return {f'{a}_of_{b}': matrix[i, j] for i, a in enumerate(FORCES)
            for j, b in enumerate(FORCES) if f'{a}_of_{b}' in {
                q.name for q in EFFECTS['wrench_crosstalk'].parameters} and matrix[i, j]}


def by_com(shift):
    matrix = np.zeros((6, 6))
    matrix[3:, :3] = skew(shift)
    return crosstalk(matrix)


@pytest.fixture(scope='module')
def models():
    """Return the model of a recording: turning all the time or at rest first, as recorded."""
    kept = {}

    def model(rest, accelerometer, speed=0.25):
        key = rest, accelerometer, speed
        if key not in kept:
            t = STEP * np.arange(round(SECONDS / STEP))
            u = np.clip(t - 3.0 * rest, 0.0, None)
            x = np.minimum(1.0, u / 5.0) if rest else np.ones(len(t))
            rise = (x ** 3 * (10.0 - 15.0 * x + 6.0 * x ** 2))[:, None]
            turn = 0.6 * rise * np.sin(speed * np.outer(u, [1.3, 1.7, 0.9]) + [0.0, 1.0, 2.0])
            poses = PoseStream(t, np.tile(RIG.home.position, (len(t), 1)), np.array(
                RIG.home.R_base_sensor) @ Rotation.from_rotvec(turn).as_matrix())
            recording = replace(simulate(RIG, poses, seed=2), target=None)
            if not accelerometer:
                recording = replace(recording, accelerometer=None)
            rig = rigid_tool_of_rig(RIG)
            kept[key] = linearised_model(rig, held_out([prepare_motion(recording, rig)]))
        return kept[key]
    return model


def tie_of(model, name, values):
    """Put an effect into a model as found, and ask for its tie."""
    whole = {q.name: float(values.get(q.name, q.nominal)) for q in EFFECTS[name].parameters}
    found = replace(model, effects={name: whole})
    found.evaluate()
    numbers = {name: {k: Parameter(v, 0.0, '1') for k, v in whole.items()}}
    return ties_of(found, numbers, {name: 0.0}).get(name)


def asked(model, name, values):
    """Name what an effect is tied with."""
    tie = tie_of(model, name, values)
    return '' if tie is None else tie.other


def test_what_is_named_as_well_is_no_tie(models):
    model = models(rest=True, accelerometer=True)
    found = {q.name: 0.06 for q in EFFECTS['tool_mass'].parameters}
    heavy = replace(model, effects={'tool_mass': found})
    heavy.evaluate()
    numbers = {'tool_mass': {k: Parameter(v, 0.0, '1') for k, v in found.items()}}
    assert ties_of(heavy, numbers, {'tool_mass': 0.0})['tool_mass'].other == 'wrench_gain'
    # of gains whose tolerance is lifted the model's effects know nothing
    both = {**numbers, 'wrench_gain': {}}
    assert not ties_of(heavy, both, dict.fromkeys(both, 0.0))


ALONG_COM = dict(zip('xyz', 0.05 * np.array(RIG.tool.com) / np.linalg.norm(RIG.tool.com)))


@pytest.mark.parametrize('name, values, other', [
    ('accel_misalignment', ALONG_COM, 'wrench_crosstalk'),
    ('wrench_crosstalk', crosstalk(np.kron(np.eye(2), skew(list(ALONG_COM.values())))),
     'accel_misalignment'),
    ('wrench_crosstalk', crosstalk(np.kron(np.eye(2), np.abs(skew(list(ALONG_COM.values()))))),
     ''),
    # across the arm of the weight the torques tell them apart
    ('accel_misalignment', {'x': 0.05}, ''),
])
def test_a_turned_sensor_is_an_accelerometer_turned_back_until_it_rests(models, name, values,
                                                                       other):
    assert asked(models(rest=False, accelerometer=True), name, values) == other
    assert asked(models(rest=True, accelerometer=True), name, values) == ''


@pytest.mark.parametrize('name, values, other', [
    ('tool_com', {'x': 0.006, 'y': -0.003, 'z': 0.004}, 'wrench_crosstalk'),
    ('wrench_crosstalk', by_com([0.006, -0.003, 0.004]), 'tool_com'),
    ('wrench_crosstalk', {'tx_of_fy': 0.01, 'ty_of_fx': 0.01}, ''),
    ('tool_mass', {'change': 0.06}, 'wrench_gain'),
    ('wrench_gain', dict.fromkeys(FORCES, 0.06), 'tool_mass'),
    ('wrench_gain', {'fx': 0.06, 'fz': 0.06}, ''),
])
def test_tool_and_sensor_change_places(models, name, values, other):
    for accelerometer in (True, False):
        assert asked(models(rest=True, accelerometer=accelerometer), name, values) == other


def test_a_quick_turn_of_a_known_inertia_tells_a_mass_from_gains(models):
    model = models(rest=True, accelerometer=True, speed=1.0)
    assert asked(model, 'tool_mass', {'change': 0.06}) == ''


def test_a_tilt_is_a_force_at_the_centre_of_mass(models):
    pull = dict(zip('xy', (1.5, -0.8)))
    at = {f'point_{axis}': x for axis, x in zip('xyz', RIG.tool.com)}
    model = models(rest=True, accelerometer=False)
    assert asked(model, 'base_tilt', {'x': 0.02, 'y': -0.01}) == 'cable_force'
    assert asked(model, 'cable_force', {**pull, **at}) == 'base_tilt'
    assert asked(model, 'cable_force', {**pull, **at, 'point_z': 0.3}) == ''
    assert asked(model, 'cable_force', {**pull, **at, 'z': 6.0}) == ''


def test_each_pair_goes_both_ways_and_is_told():
    for name, others in FORMS.items():
        for other in others:
            assert name in FORMS[other]
    assert {frozenset((a, b)) for a, others in FORMS.items() for b in others} == set(TOLD_BY)


def test_what_has_no_partner_is_the_same_as_nothing(models):
    assert asked(models(rest=True, accelerometer=True), 'wrench_delay', {'delay': 0.004}) == ''


def test_numbers_that_would_have_to_agree_are_less_likely(models):
    tie = tie_of(models(rest=True, accelerometer=True), 'tool_mass', {'change': 0.06})
    assert tie.note.startswith('tool_mass and wrench_gain do the same here')
    slots = [Slot('tool_mass', {}, tie)]
    candidates = dict(probabilities(slots, UnexplainedPart(0.1, 'nothing'), 0.99)[1])
    assert candidates['tool_mass'] == pytest.approx(4.0 * candidates['wrench_gain'])
    turned = tie_of(models(rest=False, accelerometer=True), 'accel_misalignment', ALONG_COM)
    assert turned.odds == 1.0


def test_what_ranking_tells_apart_is_no_tie_however_strong_an_effect_is():
    weak, strong = untold(1e3), untold(1e8)
    assert 25.0 < weak < 50.0
    assert 2400.0 < strong < 2500.0


def test_a_delay_between_two_samples_is_a_low_pass_to_the_next_reader():
    t = DT * np.arange(8000)
    force = 40 * np.sin(2 * np.pi * (1 + 1.5 * t) * t)[:, None]  # to 25 Hz
    read = np.interp(t - LAG, t, force[:, 0])[:, None]
    by_delay = read - Delay(LAG, DT)(force)
    by_lowpass = read - Filter([1.0], [LAG, 1.0], DT)(force)
    # by what each takes off the amplitude: ((2 a - 1) / (1 - a))^2 for a = 0.4 of a sample
    assert np.square(by_lowpass).sum() < 0.12 * np.square(by_delay).sum()


@pytest.mark.parametrize('name, number, other', [
    ('wrench_delay', 'delay', 'wrench_lowpass'),
    ('wrench_lowpass', 'time_constant', 'wrench_delay')])
def test_they_share_the_probability_below_a_sample_and_not_above(name, number, other):
    def tie(value):
        return lag(name, {name: {number: Parameter(value, 1e-6, 's')}}, DT)

    def said(value, odds=-40.0):
        slots = [Slot(name, {other: odds}, tie(value))]
        return probabilities(slots, UnexplainedPart(0.1, 'nothing'), 0.99)

    named, candidates = said(LAG)
    assert named[name] == dict(candidates)[other] < 0.5
    named, candidates = said(4e-3)
    assert named[name] > 0.9 and other not in dict(candidates)
    assert said(LAG, odds=2.0)[0] == said(LAG)[0]
    assert '1 ms' in tie(LAG).note
    both = {name: {number: Parameter(LAG, 1e-6, 's')}, other: {}}
    assert lag(name, both, DT) is None


def test_no_other_effect_is_tied():
    assert lag('accel_delay', {'accel_delay': {'delay': Parameter(LAG, 1e-6, 's')}}, DT) is None
    assert lag('wrench_delay', {'wrench_delay': {}}, DT) is None


def test_no_motion_is_asked_for_that_would_not_tell_them_apart():
    numbers = {'time_constant': Parameter(LAG, 1e-6, 's')}
    diagnosis = SimpleNamespace(
        effects=[SimpleNamespace(name='wrench_lowpass')], verdict='ambiguous', not_excited=(),
        candidates=[('wrench_lowpass', 0.49), ('wrench_delay', 0.49)],
        ties=(lag('wrench_lowpass', {'wrench_lowpass': numbers}, DT),))
    assert advice(diagnosis, load_rig()) == ''
