"""Effects that do the same to a wrench along a measured motion, each on a simulated recording."""

from dataclasses import replace

from forcecal_ros.diagnose.inputs.motion_dataset import held_out, prepare_motion
from forcecal_ros.diagnose.judge.equivalents import equivalent, FORMS, odds, TOLD_BY, untold, why
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.judge.probabilities import probabilities
from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.judge.ties import with_tie
from forcecal_ros.diagnose.model.linearised import linearised_model
from forcecal_ros.effects import EFFECTS
from forcecal_ros.geometry import skew
from forcecal_ros.recording.streams import PoseStream
from forcecal_ros.simulators.rig.file import load_rig
from forcecal_ros.simulators.rig.offline import simulate
from forcecal_ros.simulators.rigid_tool import rigid_tool_of_rig
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

FORCES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
DT, SECONDS = 0.004, 12.0
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
            t = DT * np.arange(round(SECONDS / DT))
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


def asked(model, name, values):
    """Put an effect into a model as found, and ask for its equivalent."""
    whole = {q.name: float(values.get(q.name, q.nominal)) for q in EFFECTS[name].parameters}
    found = replace(model, effects={name: whole})
    found.evaluate()
    return equivalent(found, name, {k: Parameter(v, 0.0, '1') for k, v in whole.items()}, 0.0)


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
            assert other in why(name, other)
    assert {frozenset((a, b)) for a, others in FORMS.items() for b in others} == set(TOLD_BY)


def test_what_has_no_partner_is_the_same_as_nothing(models):
    assert asked(models(rest=True, accelerometer=True), 'wrench_delay', {'delay': 0.004}) == ''


def test_numbers_that_would_have_to_agree_are_less_likely():
    slots = [('tool_mass', with_tie({}, 'wrench_gain', odds('tool_mass', 'wrench_gain')))]
    candidates = dict(probabilities(slots, UnexplainedPart(0.1, 'nothing'), 0.99)[1])
    assert candidates['tool_mass'] == pytest.approx(4.0 * candidates['wrench_gain'])
    assert odds('accel_misalignment', 'wrench_crosstalk') == 1.0


def test_what_ranking_tells_apart_is_no_tie_however_strong_an_effect_is():
    weak, strong = untold(1e3), untold(1e8)
    assert 25.0 < weak < 50.0
    assert 2400.0 < strong < 2500.0
