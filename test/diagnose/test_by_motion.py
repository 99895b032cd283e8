"""Recordings without commands: the wrench is compared with the measured motion."""

from dataclasses import replace
import json
from pathlib import Path

from calibration_runs import run
from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.cli.main import main
from forcecal_ros.core.streams import PoseStream, Recording, Stream
from forcecal_ros.diagnose.sources.rig import ToolSource
from forcecal_ros.effects import with_effects
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.rigid_tool import (
    CarriedTool,
    rigid_tool_of_calibration,
    rigid_tool_of_rig,
    UNKNOWN_DELAY,
)
import numpy as np
import pytest
from rig_recordings import shaken, shaking, swaying
from scipy.signal import cont2discrete, lfilter
from scipy.spatial.transform import Rotation

GRAVITY = '9.8209'
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def kuka(kuka_data, tmp_path_factory):
    """Calibrated on the poses and diagnosed on a trajectory, by the commands."""
    folder = tmp_path_factory.mktemp('kuka')
    for name in ('poses', 'baseline'):
        assert main(['import', str(ROOT / f'config/examples/kuka_{name}.yaml'),
                     '--tables', str(kuka_data), '-o', str(folder / name)]) == 0
    known = folder / 'calibration.yaml'
    assert main(['calibrate', str(folder / 'poses'), '--gravity', GRAVITY, '-o', str(known)]) == 0
    assert main(['diagnose', str(folder / 'baseline'), '--calibration', str(known),
                 '-o', str(folder / 'out')]) == 0
    return folder


@pytest.fixture(scope='module')
def found(kuka):
    return json.loads((kuka / 'out' / 'diagnosis.json').read_text())


def recalibrated(document, name):
    note, = (n for n in document['notes'] if n.startswith(f'recalibrated: {name} by'))
    value, interval = note.split(' by ')[1].split()[0:3:2]
    return float(value), float(interval)


def test_delay_and_offset_of_a_real_arm_come_out_by_themselves(found):
    delay, interval = recalibrated(found, 'accelerometer.delay')  # [ms], 95 %
    # by an engine that judged slow motion only it was 6.8 +- 1.0 ms, 1 sigma
    assert abs(delay - 6.8) < interval < 2.0
    # the zero moved since the calibration, after the turning arm's centripetal force is taken off
    assert recalibrated(found, 'wrench.bias.fz')[0] == pytest.approx(0.21, abs=0.05)


def test_the_gap_of_a_real_arm_shrinks_on_every_axis_held_out(found):
    for axis, least in zip('xyz', (0.5, 0.3, 0.7)):
        channel = found['gap']['per_channel'][f'force.{axis}']
        assert channel['explained_rms'] < (1.0 - least) * channel['nominal_rms']


def test_an_arm_to_which_nothing_was_done_is_not_given_an_effect(found):
    # what is left of it is told, be it a gap or no more than slow noise
    assert found['verdict'] == 'unknown' or any('slow noise or' in n for n in found['notes'])
    assert all(c['probability'] < 0.5 for c in found['candidates'] if c['name'] != 'unknown')
    assert all(e['name'] == 'unknown' for e in found['effects'])


@pytest.mark.long
def test_the_patched_calibration_leaves_what_was_claimed(kuka, found):
    patched = load(kuka / 'out' / 'calibration_patched.yaml')
    tool = rigid_tool_of_calibration(patched, load_rig('rigid_tool.yaml'))
    again = ToolSource(tool, patched).diagnose(read_recording(kuka / 'baseline')).outcome
    assert again.diagnosis.gap.nominal < 0.2 * found['gap']['nominal']
    delay, std = again.recalibrations['accelerometer.delay']
    assert abs(delay) < 3.0 * std
    for axis in 'xyz':
        more, std = again.recalibrations[f'tool.inertia.{axis}']
        assert abs(more) < 3.0 * std


@pytest.mark.long
def test_the_patched_calibration_knows_the_delay_as_well_as_it_was_found(kuka, found, capsys):
    delay = load(kuka / 'out' / 'calibration_patched.yaml').accelerometer.delay
    value, interval = recalibrated(found, 'accelerometer.delay')  # [ms], 95 %
    assert float(delay) == pytest.approx(1e-3 * value, rel=0.01)
    assert delay.std == pytest.approx(1e-3 * interval / 1.96, rel=0.05)
    capsys.readouterr()
    assert main(['estimate', str(kuka / 'baseline'), '--calibration',
                 str(kuka / 'out' / 'calibration_patched.yaml'), '-o', str(kuka / 'contact')]) == 0
    assert 'does not know the delay' not in capsys.readouterr().err


def by_calibration(recording, calibration):
    tool = rigid_tool_of_calibration(calibration, load_rig('rigid_tool.yaml'))
    return ToolSource(tool, calibration).diagnose(recording).outcome.diagnosis


@pytest.fixture(scope='module')
def calibrated():
    recording = run(seed=1)
    return recording, identify(recording)


def test_a_compliant_tool_has_no_gap_to_its_own_calibration(calibrated):
    found = by_calibration(*calibrated)
    assert found.verdict == 'no_gap' and not found.effects


@pytest.fixture(scope='module')
def commands():
    """Poses of different orientation and some steps, without phases and contact."""
    return swaying(load_rig(), 0.8, [0.005, 0.0025, 0.0035], 3.0)


@pytest.mark.parametrize('rig_name, effects, name', [
    ('rig.yaml', {}, None),
    pytest.param('rigid_tool.yaml', {'tool_mass': {'change': 0.05}}, 'tool_mass',
                 marks=pytest.mark.long),
    pytest.param('rigid_tool.yaml', {'accel_bias': {'y': 0.2}}, 'accel_bias',
                 marks=pytest.mark.long),
])
def test_one_effect_is_named_and_none_without(commands, rig_name, effects, name):
    rig = load_rig(rig_name)
    recording = simulate(with_effects(rig, effects), commands, seed=1)
    diagnosis = ToolSource(rigid_tool_of_rig(rig)).diagnose(
        replace(recording, target=None)).diagnosis
    assert [e.name for e in diagnosis.effects] == ([name] if name else [])
    if name is None:
        assert diagnosis.verdict == 'no_gap'


@pytest.mark.long
def test_a_wrench_that_is_late_is_no_accelerometer_that_is_early(commands):
    rig = load_rig('rigid_tool.yaml')
    tool = rigid_tool_of_rig(rig)
    unknown = replace(tool, spreads=replace(tool.spreads, accel_behind=UNKNOWN_DELAY))
    late = with_effects(rig, {'wrench_delay': {'delay': 0.012}})
    outcome = ToolSource(unknown).diagnose(
        replace(simulate(late, commands, seed=1), target=None)).outcome
    assert outcome.diagnosis.effects[0].name in ('wrench_delay', 'wrench_lowpass')
    assert outcome.recalibrations['accelerometer.delay'][0] >= 0.0


def test_without_accelerometer_the_position_says_how_the_tool_moves(commands):
    rig = load_rig('rigid_tool.yaml')
    recording = replace(simulate(rig, commands, seed=1), target=None, accelerometer=None)
    diagnosis = ToolSource(rigid_tool_of_rig(rig)).diagnose(recording).diagnosis
    assert diagnosis.verdict == 'no_gap'
    assert not {n for n, _ in diagnosis.candidates} | {
        n for n in diagnosis.not_excited if n.startswith('accel')}


@pytest.mark.parametrize('rate, size, shown, effects', [
    (9.0, 3e-4, 0.7, {'tool_mass': {'change': 0.05}}),
    pytest.param(9.0, 3e-4, 1.0, {}, marks=pytest.mark.long),
    pytest.param(9.0, 3e-4, 1.4, {}, marks=pytest.mark.long),
    pytest.param(11.0, 2e-4, 1.0, {'tool_mass': {'change': 0.05}}, marks=pytest.mark.long),
    pytest.param(8.0, 5e-4, 1.0, {}, marks=pytest.mark.long)])
def test_a_robot_that_shakes_is_judged_by_its_tool(commands, rate, size, shown, effects):
    """Its acceleration is as exact there as poses are clear of noise, and show it."""
    rig = load_rig('rigid_tool.yaml')
    recording = replace(shaken(with_effects(rig, effects), commands, rate, size, 2, shown),
                        target=None, accelerometer=None)
    result = ToolSource(rigid_tool_of_rig(rig)).diagnose(recording)
    assert {e.name for e in result.diagnosis.effects} == set(effects)
    assert result.diagnosis.verdict == ('identified' if effects else 'no_gap')
    more, std = result.outcome.recalibrations.get('pose.shake', (0.0, 0.1))
    assert more == pytest.approx(1.0 / shown - 1.0, abs=0.03) and std <= 0.1
    for effect in result.diagnosis.effects:
        found = effect.parameters['change']
        assert found.value == pytest.approx(0.05, abs=3.0 * found.std) and found.std < 2e-3


@pytest.mark.long
def test_a_tool_is_weighed_on_an_arm_that_gives_behind_its_encoders(commands):
    """A resonance at 20 Hz: what is fast is more, the faster the more."""
    rig, target = load_rig('rigid_tool.yaml'), shaking(commands, 9.0, 3e-4, 6)
    spring, damped = behind_encoders((2.0 * np.pi * 20.0) ** -2, 0.05, target.t[1] - target.t[0])
    start = target.position[0]
    moved = replace(target, position=start + lfilter(spring, damped, target.position - start,
                                                     axis=0))
    heavier = simulate(with_effects(rig, {'tool_mass': {'change': 0.05}}), moved, seed=6)
    recording = replace(heavier, pose=simulate(rig, target, seed=56).pose.rows(
        slice(None, None, 2)), target=None, accelerometer=None)
    result = ToolSource(rigid_tool_of_rig(rig)).diagnose(recording)
    found = {e.name: e.parameters for e in result.diagnosis.effects}
    # the resonance's damping delays the motion by 0.7 ms
    assert 'tool_mass' in found and set(found) <= {'tool_mass', 'wrench_delay', 'wrench_lowpass'}
    mass = found['tool_mass']['change']
    assert mass.value == pytest.approx(0.05, abs=3.0 * mass.std) and mass.std < 2e-3


@pytest.mark.long
@pytest.mark.parametrize('effect, number', [
    ('wrench_delay', 'delay'), ('wrench_lowpass', 'time_constant')])
def test_a_late_wrench_along_noisy_poses_is_no_low_pass_for_sure(commands, effect, number):
    """By 14 of 2,265 a low-pass explains more of it, which smooths what noise a prediction has."""
    rig = load_rig('rigid_tool.yaml')
    recording = replace(shaken(with_effects(rig, {effect: {number: 0.006}}), commands, 9.0, 3e-4,
                               9), target=None, accelerometer=None)
    found = ToolSource(rigid_tool_of_rig(rig)).diagnose(recording).diagnosis
    assert effect in dict(found.candidates)
    assert (found.verdict == 'identified') == (effect == 'wrench_lowpass')


def behind_encoders(compliance, damping, period):
    """Return the filter of a spring, by its compliance [s^2] and damping ratio."""
    (spring,), damped, _ = cont2discrete(
        ([1.0], [compliance, 2.0 * damping * compliance ** 0.5, 1.0]), period, 'bilinear')
    return spring, damped


@pytest.mark.parametrize('number, value, left', [
    ('shake', 0.5, 0.15), ('shake_delay', 0.009, 0.15),
    ('compliance', (2.0 * np.pi * 20.0) ** -2, 0.3)])
def test_a_wrench_follows_what_poses_do_not_show_of_a_shake(number, value, left):
    """They show a part, or show it early, or an arm resonates behind its encoders at 20 Hz."""
    t = 0.001 * np.arange(10_000)
    slow = 0.05 * np.sin(np.pi * t) * np.exp(-0.5 * ((t - 5.0) / 1.5) ** 2)

    def fast(u):
        return 3e-4 * np.sin(2.0 * np.pi * 8.0 * u) * np.exp(-0.5 * ((u - 5.0) / 0.5) ** 2)

    def moved(way):
        turn = Rotation.from_rotvec(np.outer(10.0 * way, [1.0, 0.5, -0.3])).as_matrix()
        poses = PoseStream(t, np.outer(way, [1.0, -0.6, 0.4]), np.diag([1.0, -1.0, -1.0]) @ turn)
        return CarriedTool(Recording(pose=poses), 0.0, 2490, 'acc1')

    true = {'shake': lambda: slow + (1.0 + value) * fast(t),
            'shake_delay': lambda: slow + fast(t - value),
            'compliance': lambda: lfilter(*behind_encoders(value, 0.02, 0.001), slow + fast(t))}
    tool = rigid_tool_of_rig(load_rig('rigid_tool.yaml'))
    wanted, carried = moved(true[number]()).wire(tool), moved(slow + fast(t))
    before, after = (np.std(carried.wire(one) - wanted, axis=0)
                     for one in (tool, replace(tool, **{number: value})))
    assert (after < left * before).all()


def test_a_robot_that_stands_still_excites_nothing():
    t = 0.002 * np.arange(4000)
    rng = np.random.default_rng(0)
    still = Recording(wrench=Stream(t, rng.standard_normal((len(t), 6))),
                      pose=PoseStream(t, np.zeros((len(t), 3)), np.tile(np.eye(3),
                                                                         (len(t), 1, 1))))
    rig = load_rig('rigid_tool.yaml')
    assert ToolSource(rigid_tool_of_rig(rig)).diagnose(still).diagnosis.verdict == 'not_excited'
