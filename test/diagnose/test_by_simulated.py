"""The robot's recording beside what another simulator recorded of the same commands."""

from dataclasses import replace
from functools import cache
import json
import re

from changed import with_values
from forcecal_ros.cli.main import main
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import JointStream, Stream
from forcecal_ros.diagnose.dataset import span
from forcecal_ros.diagnose.judge.residual_summary import summarise_residual
from forcecal_ros.diagnose.localise import compare_motions
from forcecal_ros.diagnose.recordings import keep_comparable_imus
from forcecal_ros.diagnose.sources.pair import (
    align,
    PairSource,
    prepare_pair,
    shift_times,
    UNTESTED,
)
from forcecal_ros.diagnose.sources.simulated_tool import simulated_tool
from forcecal_ros.diagnose.verdict import tolerated
from forcecal_ros.effects import with_effects
from forcecal_ros.io.bags import write_recording
from forcecal_ros.report.diagnosis import next_step
from forcecal_ros.sim.measured_motion import _above_band, express_in_base, merge_poses
from forcecal_ros.sim.rig.simulator import simulate
from forcecal_ros.sim.rigid_tool import CarriedTool
from moving_arm import MASS, moving
import numpy as np
from own_arm import commands, GRIPPER, LATE, real, RIG, simulated, TOLERANCES, with_imu
import pytest
from rig_recordings import shaken, switched
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation
from wrong_recordings import at_wrench, recording_of

WEIGHT = GRIPPER.mass * np.array(RIG.gravity)

ALONE = 'diagnose real --simulated sim -o gap'
JUDGED = 'diagnose real --simulated sim --heldout real2 --heldout-simulated sim2 -o gap'


@pytest.fixture(scope='module')
def clean():
    return PairSource(TOLERANCES, simulated()).diagnose(real({}))


def test_a_sound_robot_that_moves_a_little_otherwise_has_no_gap(clean):
    assert clean.diagnosis.verdict == 'no_gap'
    motion, = clean.diagnosis.not_compared
    assert motion.startswith('the motions, ')
    assert next_step(clean.diagnosis, 'bag', 'out', ()).words == (
        f'Nothing has to be changed in what was compared. Not compared: {motion}.')
    assert not clean.diagnosis.effects
    assert UNTESTED in clean.diagnosis.notes
    assert clean.diagnosis.reason.endswith('mrad (RMS) from the simulated one')


def test_the_tolerance_is_how_exact_the_motion_is_unless_a_finer_one_is_given(clean):
    model = clean.outcome.selection.model
    assert model.tolerance == model.datasets[0].simulation.exact == 0.2
    assert tolerated(0.05, 0.2) == 0.05 and tolerated(None, 0.0) == 0.1
    fine = summarise_residual(replace(model, tolerance=0.05))
    assert fine.exact == fine.tolerance == 0.05


def test_the_tool_is_that_of_the_simulator_and_its_unknown_zero_is_told(clean):
    tool = clean.ready[0].tool.rigid_tool.tool
    assert tool.mass == pytest.approx(GRIPPER.mass, rel=1e-3)
    np.testing.assert_allclose(tool.com, GRIPPER.com, atol=1e-4)
    assert any(note.startswith('bias of the wrench against the simulated: 4.')
               for note in clean.diagnosis.notes)
    assert clean.diagnosis.gap.nominal < 0.2


def test_the_robots_delay_is_told_by_the_commands(clean):
    found = clean.ready[0].tracking
    recording = simulate(RIG, commands(), seed=3)
    other, alignment = align(recording, simulated())
    assert alignment.by == 'target'
    # of the rig's loop and servo
    own = compare_motions(recording.pose, other.pose, own_delay=True)
    for part, without in zip(found, own):
        assert part.delay_std < 1e-3
        assert part.delay - without.delay == pytest.approx(0.008, abs=5e-4)
        assert part.unexplained < 0.15 * part.rms


@pytest.mark.parametrize('change, part', [
    (-0.125, 0.5), pytest.param(0.125, 0.7, marks=pytest.mark.long),
    pytest.param(0.04, 0.5, marks=pytest.mark.long)])
def test_a_payload_picked_up_on_the_way_is_no_gain_and_no_cable(change, part):
    # its mean is recalibrated: all the time nothing shows
    light, heavy = real({}), real({'tool_mass': {'change': change}})
    t = light.wrench.t
    at = t[0] + part * (t[-1] - t[0])
    effect, = PairSource(TOLERANCES, simulated()).diagnose(
        switched(light, heavy, at)).diagnosis.effects
    found = effect.parameters['change']
    assert effect.name == 'tool_mass'
    assert found.value == pytest.approx(change, abs=4.0 * found.std) and found.std < 1e-3
    assert effect.begin == pytest.approx(at, abs=2e-3)


@cache
def shaken_quickly():
    """Return commands that also shake faster than any pose is clear of noise."""
    target = commands()
    rise = np.clip(np.minimum(target.t - 2.0, 9.0 - target.t), 0.0, 1.0)
    shake = 1e-3 * rise * np.sin(2.0 * np.pi * (9.0 + target.t) * target.t)
    return replace(target, position=target.position + np.outer(shake, [0.0, 1.0, 0.6]))


def test_effects_act_on_what_is_clear_of_the_simulators_noise_and_all_is_compared():
    other = simulate(RIG, shaken_quickly(), seed=4)
    own = CarriedTool(replace(other, accelerometer=None), 0.1, 2900, 'acc1')
    above, clear = _above_band(other, own)
    shakes, rests = (own.t > 4.0) & (own.t < 7.0), (own.t < 1.5) | (own.t > 9.5)
    assert np.abs(clear[rests]).max() == 0.0 < above[rests, :3].std()
    assert above[shakes, 1].std() > 2.0
    np.testing.assert_allclose(clear[shakes, 1], above[shakes, 1],
                               atol=0.05 * above[shakes, 1].std())


@pytest.mark.parametrize('seed, shown, effects', [
    (1, 0.7, {}), pytest.param(6, 0.7, {'tool_mass': {'change': 0.08}}, marks=pytest.mark.long),
    pytest.param(1, 1.0, {}, marks=pytest.mark.long),
    pytest.param(3, 1.4, {}, marks=pytest.mark.long),
    pytest.param(9, 1.4, {'wrench_crosstalk': {'fx_of_fz': 0.05}}, marks=pytest.mark.long),
    pytest.param(8, 1.0, {'wrench_delay': {'delay': 0.006}}, marks=pytest.mark.long)])
def test_a_robot_that_shakes_more_than_its_simulation_is_judged_by_its_tool(seed, shown, effects):
    """Effects act on what is clear of the noise of poses, instant by instant."""
    robot = with_imu(shaken(with_effects(RIG, {**LATE, **effects}), commands(), 9.0, 3e-4, seed,
                            shown))
    diagnosis = PairSource(TOLERANCES, simulated(imu=True)).diagnose(robot).diagnosis
    assert [e.name for e in diagnosis.effects] == list(effects)
    assert (diagnosis.verdict == 'no_gap') == (not effects)
    for effect in diagnosis.effects:
        (name, true), = effects[effect.name].items()
        found = effect.parameters[name]
        assert found.value == pytest.approx(true, abs=3.0 * found.std) and found.std < 0.06 * true


@pytest.mark.parametrize('seed, size, late, effects', [
    (7, 1.0, 0.009, {}), (1, 0.3, 0.009, {'accel_delay': {'delay': 0.006}}),
    pytest.param(1, 0.3, 0.009, {}, marks=pytest.mark.long),
    pytest.param(5, 1.0, -0.009, {}, marks=pytest.mark.long),
    pytest.param(3, 0.3, 0.0, {'accel_delay': {'delay': 0.006}}, marks=pytest.mark.long)])
def test_a_shake_that_is_later_than_poses_show_is_no_delay_of_the_imu(seed, size, late, effects):
    """Of 8 to 25 Hz, at 1 m/s^2: poses at 125 Hz are clear of noise below 16 Hz."""
    target = commands()
    shake = sosfiltfilt(butter(4, [8.0, 25.0], 'bandpass', fs=250.0, output='sos'),
                        np.random.default_rng(seed).normal(size=(len(target), 3)), axis=0)
    shake *= np.clip(np.minimum(target.t - 2.0, 9.5 - target.t), 0.0, 1.0)[:, np.newaxis]
    shake *= size / np.diff(shake, 2, axis=0)[750:2250].std() * 0.004 ** 2
    shown, moved = (replace(target, position=target.position + Stream(target.t + by, shake).at(
        target.t)) for by in (0.0, late))
    robot, told = (simulate(with_effects(RIG, {**LATE, **effects}), one, seed=seed)
                   for one in (moved, shown))
    robot = with_imu(replace(robot, pose=told.pose.rows(slice(None, None, 2))))
    diagnosis = PairSource(TOLERANCES, simulated(imu=True)).diagnose(robot).diagnosis
    assert {e.name: e.parameters['delay'].value for e in diagnosis.effects} == pytest.approx(
        {name: values['delay'] for name, values in effects.items()}, abs=3e-4)
    assert diagnosis.verdict == ('identified' if effects else 'no_gap')


def with_pull(recording, shape, size):
    """Pull along y by a function of orientation and angle turned about z, of a size [N RMS]."""
    R = np.array(recording.pose.R_base_sensor)
    turns = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).as_rotvec()[:, 2]
    pull = shape(R, np.concatenate([[0.0], np.cumsum(turns)]))
    wrench = recording.wrench
    values = wrench.values.copy()
    values[:, 1] += size / pull.std() * np.interp(wrench.t, recording.pose.t, pull)
    return replace(recording, wrench=replace(wrench, values=values))


@pytest.mark.parametrize('effect, name, true', [
    ('wrench_gain', 'fz', 0.04), ('wrench_crosstalk', 'fx_of_fz', 0.03)])
def test_a_cable_that_winds_up_hides_no_small_gain_or_crosstalk(effect, name, true):
    robot = with_pull(real({effect: {name: true}}), lambda R, turned: turned, 0.026)
    diagnosis = PairSource(TOLERANCES, simulated()).diagnose(robot).diagnosis
    first = diagnosis.effects[0]
    found = first.parameters[name]
    assert first.name == effect and first.probability > 0.8 and found.std < 0.1 * true
    assert found.value == pytest.approx(true, abs=3.0 * found.std)
    # the wind-up itself has no name: at most it is a bias that wanders
    assert {e.name for e in diagnosis.effects[1:]} <= {'wrench_bias_drift'}


def test_what_is_left_is_a_gap_or_not_by_the_stated_tolerance(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_recording('real', with_pull(real({}), lambda R, turned: R[:, 2, 0]**2, 0.05))
    write_recording('sim', simulated())
    for options, verdict in (([], 'unknown'), (['--tolerance', '0.5'], 'no_gap')):
        assert main([*ALONE.split(), *options]) == 0
        assert json.loads((tmp_path / 'gap' / 'diagnosis.json').read_text())[
            'verdict'] == verdict
    assert 'up to 0.5 is within the tolerance' in capsys.readouterr().out


def test_what_carries_a_simulated_tool_for_a_while_is_not_taken_for_its_mass():
    one = moving(201, seconds=25.0)
    held = (one.t > 8.0) & (one.t < 12.0)  # no phase states it; by least squares 0.78 kg
    wrench = one.wrench.copy()
    wrench[held, :3] += 10.0 * at_wrench(one)[held, 2]
    recording = recording_of(replace(one, wrench=wrench))
    found = simulated_tool(recording, *span(recording), TOLERANCES)
    assert found.simulated.tool.mass == pytest.approx(MASS, rel=0.02)


@pytest.mark.parametrize('effects, noisy, named', [
    pytest.param({}, True, [], marks=pytest.mark.long),
    pytest.param({'robot_delay': {'delay': 0.006}}, True, [], marks=pytest.mark.long),
    ({'wrench_delay': {'delay': 0.004}}, False, ['wrench_delay'])])
def test_what_a_simulator_does_in_quick_motion_is_compared(effects, noisy, named):
    robot = simulate(with_effects(RIG, effects), shaken_quickly(), seed=3)
    other = simulate(RIG, shaken_quickly(), seed=4, noise=noisy)
    d = PairSource(TOLERANCES, shift_times(other, 50.0)).diagnose(robot).diagnosis
    assert [e.name for e in d.effects] == named
    assert d.verdict in (('identified', 'ambiguous') if named else ('no_gap',))
    for effect in d.effects:
        found = effect.parameters['delay']
        assert found.value == pytest.approx(0.004, abs=3.0 * found.std) and found.std < 1e-4


@pytest.mark.long
def test_a_strong_cable_is_named_wherever_it_is_tied():
    pull = {'x': -2.0, 'y': 10.0, 'z': 14.0, 'stiffness': 20.0, 'point_x': -0.1, 'point_z': 0.0}
    effect, = PairSource(TOLERANCES, simulated()).diagnose(
        real({'cable_force': pull})).diagnosis.effects
    assert effect.name == 'cable_force' and effect.probability > 0.9
    for key, value in pull.items():
        found = effect.parameters[key]
        assert found.value == pytest.approx(value, abs=4.0 * found.std), key


def test_two_recordings_are_brought_to_one_clock_by_commands_and_else_by_poses():
    recording, other = real({}), simulated(start=-77.0)
    t = 0.008 * np.arange(1500)
    q = np.stack([np.sin(1.3 * t), np.cos(0.7 * t) - 1.0], axis=1)
    joints = (replace(recording, target=None, joint_commands=JointStream(t, q, '', ('a', 'b'))),
              replace(other, target=None, joint_commands=JointStream(
                  t - 77.0, q[:, ::-1], '', ('b', 'a'))))
    for by, given in (('target', (recording, other)), ('joint_commands', joints)):
        _, alignment = align(*given)
        assert alignment.by == by
        assert alignment.shift == pytest.approx(77.0, abs=1e-4)
    _, alignment = align(recording, replace(other, target=None))
    assert alignment.by == 'pose'
    # the rig's own lag and delay are in it
    assert 77.0 < alignment.shift < 77.05


@pytest.mark.long
def test_the_zero_of_the_sensor_is_that_of_the_first_recording_in_the_second_too():
    first, second = ((real({}, seed, phase), shift_times(simulated(phase), -1000.0))
                     for seed, phase in ((3, 0.0), (4, 0.7)))
    _, tool = prepare_pair(*first, None, TOLERANCES)
    case, _ = prepare_pair(*second, tool, TOLERANCES)
    left = case.measured.residual(case.nominal)[:, :6]
    assert np.abs(tool.zero).max() > 2.0
    assert np.abs(np.median(left, axis=0)).max() < 0.1


@pytest.mark.long
@pytest.mark.parametrize('bias', [0.2, 0.0])
def test_imus_of_both_are_compared_in_motion(bias):
    robot, other = with_imu(real({}), bias), simulated(imu=True)
    d = PairSource(TOLERANCES, other).diagnose(robot).diagnosis
    assert d.used['accelerometer'] > 0.9
    assert 'accelerometer' not in d.reason
    if not bias:
        assert d.verdict == 'no_gap'
    else:
        found, = d.effects
        assert found.name == 'accel_bias'
        assert found.parameters['x'].value == pytest.approx(bias, abs=0.03)
        assert found.parameters['x'].unit == 'm/s^2'


def in_base(w, R):
    return np.hstack([np.einsum('nij,nj->ni', R, part) for part in (w[:, :3], w[:, 3:])])


def weightless(w, R):
    force = WEIGHT @ R
    return w - np.hstack([force, np.cross(GRIPPER.com, force)])


def orientations_at(t, pose):
    return pose.R_base_sensor[np.searchsorted(pose.t, t).clip(max=len(pose) - 1)]


def with_wrench(recording, change):
    R = orientations_at(recording.wrench.t, recording.pose)
    return with_values(recording, lambda values: change(values, R))


@pytest.mark.parametrize('of_robot, change, said', [
    (True, lambda w, R: w / 9.80665, 'its forces are in kgf'),
    pytest.param(True, weightless, 'the driver subtracts its weight; disable this in the driver',
                 marks=pytest.mark.long),
    (False, weightless,
     r'the simulated wrench: its inertia is that of 1\.2.+ without compensating gravity'),
    pytest.param(False, lambda w, R: -w, '--simulated-wrench-sign -1', marks=pytest.mark.long),
    (False, in_base, 'the simulated wrench: it is expressed in the base')])
def test_frame_sign_and_units_of_both_wrenches_are_checked_first(of_robot, change, said):
    robot, other = real({}), simulated()
    robot, other = ((with_wrench(robot, change), other) if of_robot else
                    (robot, with_wrench(other, change)))
    wrong = PairSource(TOLERANCES, other).diagnose(robot)
    assert wrong.diagnosis.verdict == 'invalid_data'
    assert re.search(said, wrong.diagnosis.reason)


@pytest.mark.long
def test_where_the_simulated_tool_touches_something_nothing_is_compared(clean):
    def pressed(recording, stiffness):
        t = recording.wrench.t - recording.wrench.t[0]
        push = stiffness * np.clip(1e-3 - 1e-3 * np.abs(t - 8.0) / 0.5, 0.0, None)
        return with_values(recording, lambda w: w + np.outer(push, [0, 0, 1, 0, 0, 0]))

    case, _ = prepare_pair(pressed(real({}), 7e3), pressed(
        shift_times(simulated(), -1000.0), 1e4), None, TOLERANCES)
    left_out = case.times[~case.measured.present[:, 2]]
    assert 7.2 < left_out.min() < 7.6 and 8.4 < left_out.max() < 8.9
    free = case.measured.present[:, 2]
    assert np.abs(case.measured.residual(case.nominal)[free, 2]).max() < 1.0
    assert clean.ready[0].dataset.measured.present[:, 2].all()


def test_an_imu_that_cannot_be_compared_is_left_out_with_the_reason():
    given, made = with_imu(real({})), shift_times(simulated(imu=True), -1000.0)
    turned = with_values(given, lambda felt: felt[:, [1, 2, 0]], 'accelerometer')
    gravity = np.array(RIG.gravity) @ orientations_at(made.accelerometer.t, made.pose)
    fallen = with_values(made, lambda felt: felt + gravity, 'accelerometer')
    for one, other, why in (
            (turned, made, "the robot's measures gravity [0-9]+ deg away from that of .+"),
            (given, fallen, "the simulator's measures 0[.0-9]* m/s.2, not gravity; publish .+"),
            (replace(given, accelerometer_unit='V'), made, "the robot's is recorded in volts.+")):
        *both, note = keep_comparable_imus(one, other)
        assert [kept.accelerometer for kept in both] == [None, None]
        assert re.fullmatch(f'accelerometer not compared: {why}', note)
    assert keep_comparable_imus(given, made)[2] == ''


def test_another_motion_is_refused():
    with pytest.raises(DataError, match='run the simulator with the recorded commands'):
        align(real({}), simulated(phase=1.5))
    bare = replace(simulated(), target=None, pose=None)
    with pytest.raises(DataError, match='neither commands nor poses'):
        align(real({}), bare)


def test_a_wrench_of_the_other_sign_or_without_weight_is_refused_by_name():
    recording = shift_times(simulated(), -1000.0)
    for factor, sign, why in ((-1.0, None, '--simulated-wrench-sign -1$'), (-1.0, -1, 'sign 1$'),
                              (1e-3, None, 'has no weight')):
        wrong = with_values(replace(recording, wrench_sign=sign), lambda w: factor * w)
        with pytest.raises(DataError, match=why):
            simulated_tool(wrong, 0.2, 2500, TOLERANCES)


def turned(pose, base=(0.0, 0.0, 0.0), sensor=(0.0, 0.0, 0.0)):
    B, S = (Rotation.from_rotvec(v).as_matrix() for v in (base, sensor))
    return replace(pose, position=pose.position @ B.T, R_base_sensor=B @ pose.R_base_sensor @ S)


def test_a_base_turned_about_the_vertical_is_brought_back_and_other_frames_are_refused():
    measured, made = real({}).pose, shift_times(simulated(), -1000.0).pose
    assert express_in_base(measured, made) is made
    back = express_in_base(measured, turned(made, base=(0.0, 0.0, 2.0)))
    # as far as the robot is from its simulation on the mean
    assert np.abs(back.R_base_sensor - made.R_base_sensor).max() < 0.03
    for how, why in (({'sensor': (0.0, 0.0, np.pi / 2)}, 'rotated by 90 deg to each other'),
                     ({'base': (1.0, 0.0, 0.0)}, 'simulator are rotated by 57 deg')):
        with pytest.raises(DataError, match=why):
            express_in_base(measured, turned(made, **how))


@pytest.mark.parametrize('every', [(1, 1), (2, 5)], ids=['250 and 500 Hz', '125 and 100 Hz'])
def test_a_merged_motion_has_less_noise_than_the_measured_and_none_of_the_simulations_error(every):
    noisy = real({}).pose.rows(slice(None, None, every[0]))
    made = shift_times(simulated(), -1000.0).pose.rows(slice(None, None, every[1]))
    sound = replace(RIG, pose_sensor=replace(
        RIG.pose_sensor, position_noise=1e-9, orientation_noise=1e-9))
    quiet = simulate(with_effects(sound, LATE), commands(), seed=3).pose
    both = merge_poses(noisy, made)
    truth = CubicSpline(quiet.t, quiet.position)(both.t)
    error = (both.position - truth)[250:-250]
    assert np.sqrt(np.mean(error ** 2)) < 2e-5
    assert np.diff(error, 2, axis=0).std() < 0.03 * np.diff(noisy.position - CubicSpline(
        quiet.t, quiet.position)(noisy.t), 2, axis=0).std()
    there = CubicSpline(made.t, made.position)(both.t)[250:-250]
    assert np.abs(there - truth[250:-250]).max() > 1e-3


def test_the_commands_write_what_was_found(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / 'real', real({'tool_mass': {'change': 0.05}}))
    write_recording(tmp_path / 'sim', simulated())
    assert main(ALONE.split()) == 0
    document = json.loads((tmp_path / 'gap' / 'diagnosis.json').read_text())
    assert document['explained_by'] == 'simulated recording'
    effect, = document['effects']
    assert effect['name'] == 'tool_mass'
    found = effect['parameters']['change']
    assert found['value'] == pytest.approx(0.05, abs=max(3.0 * found['std'], 0.05 * 0.05))
    assert document['tracking'][0]['aligned_by'] == 'target'
    assert document['simulated_tool']['mass'] == pytest.approx(1.2, rel=1e-3)
    assert (tmp_path / 'gap' / 'report.html').is_file()
    assert 'tool_mass' in capsys.readouterr().out
    write_recording(tmp_path / 'real2', real({}, seed=4, phase=0.7))
    write_recording(tmp_path / 'sim2', simulated(phase=1.5))
    assert main(JUDGED.split()) == 1
    assert 'run the simulator with the recorded commands' in capsys.readouterr().out


PAIR, RERUN = ['--simulated', 'sim'], ['--simulator', 'm:f']


@pytest.mark.parametrize('options, why', [
    (['--rig', 'rigid_tool.yaml', *PAIR], 'give either --'),
    (['--calibration', 'c.yaml', *PAIR], 'give either --'),
    (['--rig', 'rigid_tool.yaml', *RERUN], 'give either --'),
    ([*PAIR, *RERUN], 'give either --'),
    (['--heldout', 'x', *PAIR], 'require each other'),
    (['--mujoco', 'm.xml', '--simulated-wrench-sign', '-1'],
     '--simulated-wrench-sign requires --simulated'),
    (['more', *PAIR], 'exactly one BAG'), (['more', *RERUN], 'exactly one BAG'),
    ([*PAIR, '--simulated-topic', 'wrench=a', '--simulated-topic', 'wrench=b'], 'keep one')])
def test_what_does_not_go_with_a_simulator_is_wrong_usage(options, why, tmp_path, capsys):
    assert main(['diagnose', 'real', *options, '-o', str(tmp_path / 'o')]) == 2
    assert why in capsys.readouterr().err
