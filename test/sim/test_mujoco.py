"""A model in MuJoCo as a simulator: what is found in it, and what it says."""

from dataclasses import replace
from importlib.resources import files
import json
from pathlib import Path
import re

from forcecal_ros.cli.main import main
from forcecal_ros.cli.sample import recorded
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import matrix_from_quaternion, rotation_from_vector
from forcecal_ros.diagnose.dataset import span
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.recordings import require_axes_of
from forcecal_ros.diagnose.result import Diagnosis
from forcecal_ros.diagnose.sources.simulated_tool import simulated_tool
from forcecal_ros.diagnose.sources.simulator import inputs_of, SimulatorSource
from forcecal_ros.io.bags import write_recording
from forcecal_ros.sim.mujoco import load_mujoco
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.rerun import (
    INTEGRATION_STEP,
    library_of,
    nuisances_of,
    Runs,
    simulated_robot,
)
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_rig
from forcecal_ros.sim.third_party import third_party, with_priors
from longer import first
import numpy as np
import pytest
from small_arm import GRAVITY, mjcf, NAMES, nominal, told, TOOL

pytest.importorskip('mujoco')


@pytest.fixture
def model(tmp_path):
    def written(**changes):
        (tmp_path / 'arm.xml').write_text(mjcf(**changes))
        return str(tmp_path / 'arm.xml')
    return written


@pytest.fixture
def load(tmp_path):
    def loaded(text):
        (tmp_path / 'arm.xml').write_text(text)
        return load_mujoco(str(tmp_path / 'arm.xml'))
    return loaded


@pytest.fixture
def check_patched(load):
    """Return a check that numbers act, and that a model patched by them does the same."""
    def check(robot, values, seconds=3.0, atol=1e-6):
        inputs = Inputs(0.0, seconds, joints=told(seconds))
        before, after = (robot.simulate(inputs, one)['pose'][1]
                         for one in (nominal(robot), values))
        assert np.abs(after - before).max() > 1e-4
        own = load(robot.patched(values))
        assert nominal(own) == pytest.approx(values)
        np.testing.assert_allclose(own.simulate(inputs, nominal(own))['pose'][1], after, atol=atol)
    return check


def test_at_rest_the_wrench_is_the_weight_in_the_frame_of_the_site(model):
    robot = load_mujoco(model())
    inputs = Inputs(0.0, 1.0, joints=told(1.0, 0.0))
    streams = robot.simulate(inputs, {**nominal(robot), 'body_mass[gripper]': 2.0})
    (t, wrench), (_, pose) = streams['wrench'], streams['pose']
    R = matrix_from_quaternion(pose[-1, 3:])
    weight = -2.0 * GRAVITY * R[2]
    np.testing.assert_allclose(wrench[-1, :3], weight, atol=0.05)
    np.testing.assert_allclose(wrench[-1, 3:], np.cross([0.01, 0.0, 0.05], weight), atol=0.005)
    np.testing.assert_allclose(pose[-1, :3], [0.7, 0.0, 0.2], atol=0.02)  # in the base
    assert t[1] - t[0] == pytest.approx(0.002)


def test_its_numbers_are_parameters_by_their_own_names(model):
    robot = load_mujoco(model())
    found = {p.name: p for p in robot.parameters()}
    assert found['body_mass[gripper]'].nominal == 1.5
    assert found['body_mass[gripper]'].stands_for == ('tool_mass',)
    assert found['dof_frictionloss[lift]'].nominal == 0.5
    assert found['kp[pan]'].nominal == 4000.0
    assert found['kv[twist]'].nominal == 150.0
    assert found['backlash[twist]'].nominal == found['backlash[twist]'].low == 0.0
    assert len(found) == 4 + 3 * 4 + 2
    assert robot.notes == ()


def test_each_number_acts_and_leaves_nothing_behind(model):
    robot = load_mujoco(model())
    inputs = Inputs(0.0, 3.0, joints=told(3.0))
    before = robot.simulate(inputs, nominal(robot))
    for name, value in (('dof_frictionloss[lift]', 3.0), ('kp[lift]', 2000.0), ('kv[lift]', 500.0),
                        ('body_ipos[gripper].z', 0.08), ('tilt.y', 0.1)):
        changed = robot.simulate(inputs, {**nominal(robot), name: value})
        assert np.abs(changed['wrench'][1] - before['wrench'][1]).max() > 0.01, name
    again = robot.simulate(inputs, nominal(robot))
    for stream in ('wrench', 'pose'):
        np.testing.assert_array_equal(again[stream][1], before[stream][1])


@pytest.mark.parametrize('tool', [TOOL, (
    '<body name="gripper" pos="0.1 0 0" quat="0 0.6 0 0.8"><geom type="box" size="0.03 0.04 0.06" '
    'pos="0.01 0 0.05" density="1500"/><site name="ft"/></body>')])
def test_a_patched_model_does_what_it_did_with_the_numbers(load, tool):
    robot = load(mjcf(tool=tool))
    inputs = Inputs(0.0, 3.0, joints=told(3.0))
    values = nominal(robot) | {
        'body_mass[gripper]': 1.7, 'body_ipos[gripper].z': 0.07, 'dof_frictionloss[lift]': 2.0,
        'kp[pan]': 3000.0, 'kv[twist]': 200.0, 'tilt.x': 0.01}
    expected = robot.simulate(inputs, values)
    robot.simulate(inputs, {**values, 'tilt.y': 0.2})  # of which nothing may stay
    text = robot.patched({**values, 'backlash[lift]': 0.01})
    assert 'backlash[lift]: MuJoCo has no such number; command the joint through play' in text
    own = load(text)
    found = nominal(own)
    assert found['body_mass[gripper]'] == pytest.approx(1.7)
    assert found['dof_frictionloss[lift]'] == 2.0
    found = own.simulate(inputs, found)
    for stream in ('wrench', 'pose'):
        np.testing.assert_allclose(found[stream][1], expected[stream][1], atol=2e-3)


def test_a_joint_is_driven_by_its_position_and_not_by_its_velocity_or_torque(load):
    beside = '<velocity joint="pan" kv="0.1"/><motor joint="lift"/></actuator>'
    inputs, made = Inputs(0.0, 3.0, joints=told(3.0), measured_joints=NAMES), []
    for end in ('</actuator>', beside):
        robot = load(mjcf().replace('</actuator>', end))
        made.append(robot.simulate(inputs, nominal(robot))['joints'][1])
    # the velocity's actuator, told nothing, drags by 0.1 N m s beside 150
    np.testing.assert_allclose(made[1], made[0], atol=1e-3)


HELD = {
    'position': '<position joint="{}" kp="4000" kv="150"/>',
    'geared': '<position joint="{}" kp="1000" kv="37.5" gear="2"/>',
    'scaled': '<general joint="{}" gainprm="40" biastype="affine" biasprm="0 -4000 -150"/>',
    'intvelocity': '<intvelocity joint="{}" kp="4000" kv="150"/>',
    'velocity': '<velocity joint="{}" kv="100"/>',
    'torque': '<motor joint="{}" gear="10"/>'}
"""Actuators of a joint, told positions: all as stiff, but for that of velocity."""

GAINS = '<custom>{}</custom>'


def driven(actuator):
    """Return the arm with another actuator of each joint."""
    text = mjcf()
    for name in NAMES:
        text = text.replace(f'<position joint="{name}" kp="4000" kv="150"/>',
                            actuator.format(name))
    return text


def driven_by(kind):
    """Return the arm with other actuators, and their controller's gains where they want one."""
    text = driven(HELD[kind]).replace('armature="0.4" frictionloss="0.5"', 'armature="0.4"')
    gains = {'velocity': (('p', 40.0),), 'torque': (('p', 4000.0), ('d', 150.0))}.get(kind, ())
    numerics = ''.join(f'<numeric name="{letter}[{name}]" data="{gain}"/>'
                       for letter, gain in gains for name in NAMES)
    return text.replace('</mujoco>', GAINS.format(numerics) + '</mujoco>')


def test_actuators_follow_in_other_numbers_or_by_their_controllers_gains(load):
    inputs, joints = Inputs(0.0, 6.0, joints=told(6.0), measured_joints=NAMES), {}
    for kind in HELD:
        robot = load(driven_by(kind))
        t, joints[kind] = robot.simulate(inputs, nominal(robot))['joints']
    assert np.ptp(joints['position'], axis=0).min() > 0.4
    for kind in ('geared', 'scaled', 'intvelocity'):
        np.testing.assert_allclose(joints[kind], joints['position'], atol=1e-9)
    commanded = np.stack([np.interp(t, inputs.joints.t, q) for q in inputs.joints.values.T])
    # weight and inertia, 20 N m at most, by the gains: 20 / 4000, and 20 / 100 / 40 rad
    for kind in ('velocity', 'torque'):
        np.testing.assert_allclose(joints[kind].T, commanded, atol=0.006)


@pytest.mark.parametrize('actuator', [
    '<pid joint="{}" kp="1000" kv="37.5" gear="2"/>',
    '<pid joint="{}" kp="4000" kv="150" ki="500"/>'])
def test_pid_actuators_follow_position_and_rate_and_their_numbers_are_patched(
        load, check_patched, actuator):
    mujoco = pytest.importorskip('mujoco')
    if not hasattr(mujoco.mjtGain, 'mjGAIN_PID'):
        pytest.skip('this MuJoCo has no <pid>')
    robot = load(driven(actuator))
    inputs = Inputs(0.0, 4.0, joints=told(4.0), measured_joints=NAMES)
    t, joints = robot.simulate(inputs, nominal(robot))['joints']
    commanded = np.stack([np.interp(t, inputs.joints.t, q) for q in inputs.joints.values.T])
    # weight alone, 20 N m at most, by kp; a position actuator drags behind by kv
    np.testing.assert_allclose(joints.T, commanded, atol=0.006)
    values = nominal(robot) | {'kp[lift]': 0.5 * nominal(robot)['kp[lift]']}
    if 'ki[lift]' in values:
        values['ki[lift]'] = 100.0
    check_patched(robot, values, 4.0)


@pytest.mark.parametrize('actuator, said', [
    ('<dcmotor joint="{}" motorconst="0.5 0.5" resistance="1"/>', 'kind dcmotor'),
    (('<general joint="{}" gaintype="affine" gainprm="1 1 0" biastype="affine" '
     'biasprm="0 -10 -1"/>'), 'kind affine')])
def test_an_actuator_that_is_not_supported_is_named(load, actuator, said):
    with pytest.raises(ConfigError, match=f'joint pan has an actuator of {said}.+not supported'):
        load(driven(actuator))


def test_delays_of_actuators_and_sensors_are_noted(load):
    text = driven('<position joint="{}" kp="4000" kv="150" delay="0.01" nsample="10"/>')
    actuators, sensors = load(text.replace(
        '</sensor>', '<accelerometer site="ft" delay="0.01" nsample="10"/></sensor>')).notes
    assert 'pan 10 ms' in actuators and 'robot_delay' in actuators
    assert 'wrench_delay' in sensors


@pytest.mark.parametrize('kind, changed', [
    ('scaled', {'kp[lift]': 2000.0, 'kv[pan]': 300.0}), ('geared', {'kp[lift]': 300.0}),
    ('intvelocity', {'kp[lift]': 2000.0}), ('velocity', {'p[lift]': 10.0, 'kv[pan]': 150.0}),
    ('torque', {'p[lift]': 2000.0, 'd[pan]': 300.0})])
def test_numbers_of_every_kind_of_actuator_act_and_are_patched(
        load, check_patched, kind, changed):
    robot = load(driven_by(kind))
    assert set(changed) <= set(nominal(robot))
    check_patched(robot, nominal(robot) | changed, atol=1e-5)


def test_an_actuator_that_wants_a_controller_says_which_gains_to_state(load):
    for kind, said in (('velocity', r'joint pan has one of velocity.+<numeric name="p\[pan\]"'),
                       ('torque', r'joint pan has one of torque.+name="p\[pan\]".+"d\[pan\]"')):
        with pytest.raises(ConfigError, match=said):
            load(re.sub('<custom>.+</custom>', '', driven_by(kind)))
    robot = load(mjcf().replace('<position joint="lift" kp="4000" kv="150"/>',
                                '<motor joint="lift"/>'))
    with pytest.raises(ConfigError, match='joint lift is commanded, but joint lift has one of '
                                          'torque; put the gains'):
        robot.simulate(Inputs(0.0, 3.0, joints=told(3.0)), nominal(robot))


def test_what_mujoco_would_clip_in_silence_is_refused(load):
    robot = load(mjcf().replace('joint="twist"', 'joint="twist" ctrlrange="-0.5 0.5"'))
    with pytest.raises(ConfigError, match='joint twist is commanded from -.+ctrlrange of its'):
        robot.simulate(Inputs(0.0, 6.0, joints=told(6.0)), nominal(robot))


def test_an_unstable_simulation_is_told_the_time_step_with_which_it_runs(
        load, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inputs, text = Inputs(0.0, 3.0, joints=told(3.0)), mjcf().replace('kp="4000"', 'kp="4e6"')
    robot = load(text)
    with pytest.raises(ConfigError, match='unstable .* MuJoCo reports "Nan, Inf or huge.*it runs '
                                          'with timestep .*; use that') as caught:
        robot.simulate(inputs, nominal(robot))
    assert robot.model.opt.timestep == 0.002
    step = re.search('with timestep (.+) instead of 0.002', str(caught.value)).group(1)
    robot = load(text.replace('timestep="0.002"', f'timestep="{step}"'))
    assert robot.simulate(inputs, nominal(robot))
    robot = load(mjcf().replace('kp="4000"', 'kp="4e12"'))
    with pytest.raises(ConfigError, match='timestep 0.000125 instead of .* fails as well'):
        robot.simulate(inputs, nominal(robot))
    # MuJoCo's own log is not left where the user is
    assert [path.name for path in tmp_path.iterdir()] == ['arm.xml']


def test_a_second_arm_on_a_base_of_its_own_has_no_numbers(load):
    other = ('<body name="other" pos="5 0 0"><joint name="other" axis="0 1 0"/>'
             '<geom size="0.1"/></body>')
    one, two = load(mjcf()), load(mjcf().replace(
        '</worldbody><actuator>', f'{other}</worldbody><actuator><position joint="other"/>'))
    assert [p.name for p in two.parameters()] == [p.name for p in one.parameters()]
    inputs = Inputs(0.0, 3.0, joints=told(3.0))
    wrench = two.simulate(inputs, nominal(two))['wrench'][1]
    np.testing.assert_allclose(wrench, one.simulate(inputs, nominal(one))['wrench'][1], atol=1e-6)


def test_joints_that_do_not_move_the_tool_are_not_compared(load):
    other = '<body name="head"><joint name="neck"/><geom size="0.1" contype="0"/></body>'
    robot = load(mjcf().replace('<body name="link0"', other + '<body name="link0"'))
    streams = robot.simulate(Inputs(0.0, 3.0, joints=told(3.0),
                                    measured_joints=('neck', *NAMES)), nominal(robot))
    joints = streams['joints'][1]
    assert np.isnan(joints[:, 0]).all()
    assert np.isfinite(joints[:, 1:]).all()


def test_where_an_actuator_has_no_kv_the_joint_s_damping_may_be_off(load, check_patched):
    robot = load(mjcf().replace(' kv="150"', '').replace('armature', 'damping="150" armature'))
    values = nominal(robot)
    assert values['dof_damping[lift]'] == 150.0 and not any('kv[' in name for name in values)
    check_patched(robot, values | {'dof_damping[lift]': 250.0})


def test_an_accelerometer_reads_along_the_axes_of_the_wrench(model):
    turned = TOOL.replace('<site name="ft"/>', '<site name="ft" quat="0.8 0.6 0 0"/>'
                          '<site name="imu" pos="0.02 0 0" quat="0.6 0 0 0.8"/>')
    robot = load_mujoco(model(tool=turned), imu='imu')
    streams = robot.simulate(Inputs(0.0, 1.0, joints=told(1.0, 0.0)), nominal(robot))
    f, wrench = streams['accelerometer'][1][-1], streams['wrench'][1][-1]
    np.testing.assert_allclose(f, -wrench[:3] / 1.5, atol=0.05)
    assert np.linalg.norm(f) == pytest.approx(GRAVITY, abs=0.02)
    with pytest.raises(ConfigError, match=r'--imu wrist: .+ has no such site; it has ft'):
        load_mujoco(model(), imu='wrist')
    on_base = turned.replace('</body>', '</body><site name="rail"/>')
    with pytest.raises(ConfigError, match='--imu rail: the site is on body link2, expected one on '
                                          'the tool, gripper'):
        load_mujoco(model(tool=on_base), imu='rail')


def test_joints_are_said_in_the_order_asked_for_and_show_what_acts_in_them(model):
    robot = load_mujoco(model())
    inputs = Inputs(0.0, 3.0, joints=told(3.0), measured_joints=('lift', 'finger', 'pan'))
    sound, rubbed = (robot.simulate(inputs, {**nominal(robot), 'dof_frictionloss[lift]': value})
                     for value in (0.5, 5.0))
    t, joints = sound['joints']
    assert np.isnan(joints[:, 1]).all()
    commanded = np.stack([np.interp(t, inputs.joints.t, q) for q in inputs.joints.values.T])
    np.testing.assert_allclose(joints[:, [2, 0]].T, commanded[:2], atol=0.05)
    moved = np.abs(rubbed['joints'][1] - joints).max(axis=0)
    assert moved[0] > 5 * moved[2] > 0.0


GRIPPER = TOOL.replace('</body>', (
    '<body name="finger"><joint name="finger" type="slide" axis="0 1 0" damping="5"/>'
    '<inertial pos="0 0 0" mass="0.02" diaginertia="1e-6 1e-6 1e-6"/></body></body>'))
SPLIT = ('<tendon><fixed name="split"><joint joint="finger" coef="1"/></fixed></tendon>'
         '<actuator><general tendon="split" gainprm="50" biastype="affine" biasprm="0 -50"/>'
         '</actuator><keyframe><key qpos="0.4 -0.3 0.2 0.03" ctrl="0.4 -0.3 0.2 0.03"/></keyframe>'
         '</mujoco>')


def test_a_gripper_that_nobody_commands_holds_and_takes_no_joint_for_its_own(load):
    robot = load(mjcf(tool=GRIPPER).replace('</mujoco>', SPLIT))
    commands = told(4.0)
    pan = replace(commands, values=commands.values[:, :1], names=NAMES[:1])
    inputs = Inputs(0.0, 4.0, joints=pan, measured_joints=(*NAMES, 'finger'))
    t, joints = robot.simulate(inputs, nominal(robot))['joints']
    followed = np.interp(t, pan.t, pan.values[:, 0])
    assert np.abs(joints[:, 0] - followed).max() < 0.1 < np.ptp(followed)
    # the tool's weight bends the two by a hundredth
    np.testing.assert_allclose(joints[:, 1:], np.broadcast_to([-0.3, 0.2, 0.03], (len(t), 3)),
                               atol=0.02)


def test_a_file_says_how_well_numbers_are_known(model, tmp_path):
    robot, path = third_party('arm', load_mujoco(model())), tmp_path / 'priors.yaml'
    path.write_text('body_mass[gripper]: 0.2\nkp[pan]: 50\n')
    known = {p.name: p.sigma for p in with_priors(robot, str(path)).parameters}
    assert known['body_mass[gripper]'] == 0.2
    assert known['kp[pan]'] == 50.0
    assert known['kp[lift]'] == {p.name: p.sigma for p in robot.parameters}['kp[lift]']
    for text, why in (('kp[pen]: 1', r'no parameter kp\[pen\]; did you mean kp\[pan\]'),
                      ('kp[pan]: 0', r'kp\[pan\]: got 0, expected a standard deviation'),
                      ('kp[pan]: .nan', r'kp\[pan\]: got nan, expected'),
                      ('kp[pan]', 'expected lines of NAME: SIGMA, got str')):
        path.write_text(text)
        with pytest.raises(ConfigError, match=why):
            with_priors(robot, str(path))


@pytest.mark.parametrize('integrator', ['Euler', 'implicit', 'implicitfast', 'RK4'])
def test_wrench_and_accelerometer_are_those_of_the_motion(integrator, model):
    """MuJoCo's sensors show 1.52 to 1.88 kg, by the integrator."""
    com = '<site name="imu" pos="0.01 0 0.05"/><site name="ft"/>'
    path = Path(model(tool=TOOL.replace('<site name="ft"/>', com), integrator=integrator))
    path.write_text(path.read_text().replace('armature="0.4"', 'armature="0.4" damping="40"'))
    arm = third_party('arm', load_mujoco(str(path), imu='imu'))
    made = arm.run(Inputs(0.0, 8.0, joints=told(8.0)), arm.nominal)
    np.testing.assert_allclose(made.wrench.values[:, :3], -1.5 * made.accelerometer.values,
                               atol=1e-9)
    tool = simulated_tool(made, 0.0, 400, load_rig('rigid_tool.yaml'))
    assert tool.rigid_tool.tool.mass == pytest.approx(1.5, abs=0.005)
    assert tool.unexplained[0] < 0.12


def test_forces_between_samples_of_poses_are_not_lost(load):
    """Stiff drives jerk at each command; by forces of instants 22 mm/s are missing."""
    robot = load(mjcf().replace('timestep="0.002"', 'timestep="0.0005"').replace(
        'kp="4000" kv="150"', 'kp="40000" kv="400"').replace('armature="0.4"', 'armature="0.1"'))
    made = robot.simulate(Inputs(0.0, 8.0, joints=told(8.0)), nominal(robot))
    (t, wrench), (_, pose) = made['wrench'], made['pose']
    assert np.diff(t) == pytest.approx(0.002)
    R = matrix_from_quaternion(pose[:, 3:])
    force = np.einsum('nij,nj->ni', R, wrench[:, :3])
    velocity = np.diff(pose[:, :3] + R @ [0.01, 0.0, 0.05], axis=0) / 0.002
    acceleration = -force[1:-1] / 1.5 - [0.0, 0.0, GRAVITY]
    told_by_force = velocity[0] + 0.002 * np.cumsum(acceleration, axis=0)
    np.testing.assert_allclose(told_by_force, velocity[1:], atol=3e-4)


ON_LINK = '<site name="ft"/>'


@pytest.mark.parametrize('changes, why', [
    ({'tool': ON_LINK}, 'site ft is on link2, which joint twist moves'),
    ({'sensor': ''}, '0 sites have a force sensor; select one with --ft-site NAME: ft'),
    ({'actuator': 'motor'}, 'no actuator takes the position of a joint; joint pan has'),
    ({'tool': TOOL + '</body></body></body><site name="rail"/><body><body><body>',
      'sensor': '<force site="rail"/>'}, 'site rail is on base, which no joint moves'),
    ({'tool': '<body><site name="ft"/></body>'}, 'body tool below site ft has no mass'),
    ({'integrator': 'nothing'}, 'MuJoCo reports')])
def test_a_model_that_will_not_do_is_refused_in_one_line(model, changes, why):
    with pytest.raises(ConfigError, match=why) as refused:
        load_mujoco(model(**changes))
    assert '\n' not in str(refused.value)


def test_a_site_that_is_not_there_is_refused(model):
    with pytest.raises(ConfigError, match=r'--ft-site wrist: .+ has no such site; it has ft'):
        load_mujoco(model(), 'wrist')


@pytest.mark.parametrize('joints, why', [
    (None, 'requires joint commands, and the recording holds none'),
    (replace(told(3.0), names=('pan', 'lift', 'elbow')), 'joint elbow is commanded, but'),
    (replace(told(3.0), names=(), values=told(3.0).values[:, :2]), 'of 2 joints without names')])
def test_commands_of_other_joints_are_refused(model, joints, why):
    robot = load_mujoco(model())
    with pytest.raises(ConfigError, match=why):
        robot.simulate(Inputs(0.0, 3.0, joints=joints), nominal(robot))


def measured(path, seconds, changed):
    """Return what an arm with other numbers has, with noise."""
    robot, joints = third_party('robot', load_mujoco(path)), told(seconds)
    values = [changed.get(p.name, p.nominal) for p in robot.parameters]
    made = robot.run(Inputs(0.0, float(joints.t[-1]), joints=joints), values)
    return noisy(made, joints, np.random.default_rng(2))


def noisy(made, joints, rng, force=0.1, torque=0.005, angle=2e-4):
    noise = rng.normal(size=(len(made.wrench), 6)) * np.repeat([force, torque], 3)
    place, turn = rng.normal(size=(2, len(made.pose), 3))
    return replace(
        made, joint_commands=joints, start_ns=10**18,
        wrench=replace(made.wrench, values=made.wrench.values + noise),
        pose=replace(made.pose, position=made.pose.position + 1e-4 * place,
                     R_base_sensor=made.pose.R_base_sensor @ rotation_from_vector(angle * turn)))


def test_a_model_is_tried_from_the_command_line(model, tmp_path, capsys):
    path, joints = model(), told(4.0)
    write_recording(tmp_path / 'real', replace(measured(path, 4.0, {}), joints=joints))
    assert main(['diagnose', '--check', str(tmp_path / 'real')]) == 2
    for option in ('--ft-site', '--imu', '--priors'):
        assert main(['diagnose', '--check', str(tmp_path / 'real'), option, 'ft']) == 2
    place = ['--sensor-from-pose', *'0 0 0 0 0 0 1'.split()]
    assert main(['diagnose', '--check', str(tmp_path / 'real'), '--mujoco', path, *place]) == 0
    said = capsys.readouterr().out
    assert f'{path}: meets the protocol, and repeated runs are equal' in said
    assert re.search(r'body_mass\[gripper\]  0\.1', said), said
    assert 'simulates wrench, pose, joints' in said
    again = f'forcecal diagnose {tmp_path / "real"} --mujoco {path} {" ".join(place)} -o diagnosis'
    assert f'next: {again}' in said


def test_a_corrected_model_has_the_named_number_and_no_recalibrated_one(load):
    simulator = third_party('arm', load(mjcf()))
    found = NamedEffect('body_mass[gripper]', {'value': Parameter(1.62, 0.01, 'kg')}, 0.9)
    robot = simulated_robot(rigid_tool_of_rig(load_rig()), simulator.parameters)
    recalibrated = replace(robot, numbers=tuple(1.01 * one for one in robot.numbers))
    outcome = Outcome(Diagnosis('identified', '', (found,)), recalibrated)
    text = SimulatorSource(simulator, load_rig()).files(outcome)['model_patched.xml']
    given = {p.name: p.nominal for p in simulator.parameters}
    assert nominal(load(text)) == pytest.approx(given | {'body_mass[gripper]': 1.62}, rel=1e-5)


@pytest.mark.long
def test_friction_of_a_joint_is_named_with_its_number(model, tmp_path, capsys):
    path = model()
    write_recording(tmp_path / 'real', measured(path, 12.0, {'dof_frictionloss[lift]': 2.5}))
    assert main(['diagnose', str(tmp_path / 'real'), '--mujoco', path,
                 '-o', str(tmp_path / 'why')]) == 0
    document = json.loads((tmp_path / 'why' / 'diagnosis.json').read_text())
    changed, = document['parameters']
    assert changed['name'] == 'dof_frictionloss[lift]'
    assert changed['after'] == pytest.approx(2.5, abs=0.1)
    assert document['recomputed'] > 0.9
    assert 'dof_frictionloss[lift] 0.5 -> 2.5' in capsys.readouterr().out
    own = nominal(load_mujoco(str(tmp_path / 'why' / document['model'])))
    assert own['dof_frictionloss[lift]'] == pytest.approx(changed['after'], rel=1e-5)  # digits
    assert main(['diagnose', str(tmp_path / 'real'), '--mujoco',
                 str(tmp_path / 'why' / document['model']), '-o', str(tmp_path / 'again')]) == 0
    again = json.loads((tmp_path / 'again' / 'diagnosis.json').read_text())
    assert again['verdict'] == 'no_gap'


@pytest.mark.long
@pytest.mark.parametrize('name, gain', [
    ('kp[lift]', 3000.0), ('kp[lift]', 1600.0), ('kv[lift]', 225.0)])
def test_a_gain_that_is_far_off_is_named_and_found_where_it_is_no_straight_line(
        model, name, gain):
    path = model()
    arm, real = third_party('arm', load_mujoco(path)), measured(path, 7.0, {name: gain})
    found = SimulatorSource(arm, load_rig('rigid_tool.yaml')).diagnose(real)
    assert found.diagnosis.verdict == 'identified'
    changed, = found.details['parameters']
    assert changed['name'] == name and changed['std'] < 0.02 * gain
    assert changed['after'] == pytest.approx(gain, abs=3.0 * changed['std'])
    effect, = found.diagnosis.effects
    assert effect.parameters['value'].value == changed['after']


def test_signals_are_more_nearly_linear_in_the_logarithm_of_gains(model):
    given = third_party('arm', load_mujoco(model()))
    given = replace(given, parameters=tuple(
        p for p in given.parameters if p.name in ('kp[lift]', 'kv[lift]')))
    inputs = Inputs(0.0, 4.0, joints=told(4.0))
    gain, _ = given.parameters
    assert gain.logarithmic and gain.to_linear(4000.0) == 4000.0
    assert gain.from_linear(gain.to_linear(2400.0))[0] == pytest.approx(2400.0)
    step = gain.from_linear(gain.to_linear(2400.0) + 1.0)[0] - 2400.0
    assert gain.from_linear(gain.to_linear(2400.0), 1.0)[1] == pytest.approx(step, rel=1e-3)
    assert gain.to_linear(0.0) == -np.inf
    # a drive lags by kv / kp: what both change alike hardly shows, and is a straight line
    values = [0.6 * p.nominal for p in given.parameters]
    exact = given.run(inputs, values).pose.position
    left = []
    for arm, point in ((given, values), (given.on_linear_scale(), [
            p.to_linear(v) for p, v in zip(given.parameters, values)])):
        runs = Runs(arm, inputs, given.run(inputs, given.nominal).pose)
        for _ in range(2):  # at first secants, then tangents
            runs.try_all(arm.nominal)
        left.append(np.linalg.norm(runs.at(tuple(point)).pose.position - exact))
    assert left[1] < 0.65 * left[0]
    with pytest.raises(ConfigError, match=r'low 0, expected above 0, as its logarithm is used'):
        third_party('x', WithLow(gain._replace(low=0)))


class WithLow:
    def __init__(self, parameter):
        self.parameters = lambda: [parameter]

    def simulate(self, inputs, parameters):
        raise AssertionError('it is not run')


def test_what_a_finer_integration_changes_is_told_by_half_the_step(model):
    path = model().replace('arm.xml', 'hard.xml')
    # damping beside a light joint: the joint follows by a time constant of a step or so
    hard = mjcf().replace(' kv="150"', '').replace('frictionloss="0.5"', 'damping="60"')
    Path(path).write_text(hard.replace('timestep="0.002"', 'timestep="0.001"'))
    robot, joints = load_mujoco(path), told(4.0)
    inputs = Inputs(0.0, 4.0, joints=joints, measured_joints=NAMES)
    here, half = (run(inputs, nominal(robot)) for run in (robot.simulate, robot.simulate_finer))
    assert robot.model.opt.timestep == 0.001
    robot.model.opt.timestep = 0.00025
    fine = robot.simulate(inputs, nominal(robot))
    for name in ('wrench', 'joints'):
        n = min(len(one[name][0]) for one in (here, half, fine))
        np.testing.assert_allclose(half[name][0][:n], here[name][0][:n], atol=1e-12)
        makes, all_of_it = (one[name][1][:n] - here[name][1][:n] for one in (half, fine))
        # an error of first order: 1 - 1/4 of it against 1 - 1/2
        left, whole = (np.sqrt(np.mean(x ** 2, axis=0)).max()
                       for x in (all_of_it - 1.5 * makes, all_of_it))
        # along the motion the step itself makes a wrench of 3 mN
        assert left < (3e-5 if name == 'wrench' else 0.03 * whole), name
        assert whole > 0.0


def test_a_step_of_integration_is_a_nuisance_and_no_effect(model):
    robot = load_mujoco(model())
    simulator, inputs = third_party('arm', robot), Inputs(0.0, 2.5, joints=told(2.5))
    runs = Runs(simulator, inputs, simulator.run(inputs, simulator.nominal).pose)
    runs.try_all(simulator.nominal)
    assert runs.count == len(simulator.parameters) + 2
    here = runs.exact(simulator.nominal)
    moved = runs.integrated(simulator.nominal, 1.0)
    half = simulator.run_finer(inputs, simulator.nominal)
    n = len(half.wrench)
    np.testing.assert_allclose(moved.wrench.values[:n], half.wrench.values, atol=1e-9)
    assert runs.integrated(simulator.nominal, 0.0) is here
    assert INTEGRATION_STEP in {one.name for one in nuisances_of(simulator.parameters, finer=True)}
    assert INTEGRATION_STEP not in library_of(simulator.parameters)
    assert INTEGRATION_STEP not in {one.name for one in nuisances_of(simulator.parameters)}


@pytest.mark.long
def test_a_payload_is_named_and_no_other_effect_whatever_the_steps_of_model_and_robot(model):
    path = model(integrator='Euler')
    Path(path).write_text(mjcf().replace(' kv="150"', '').replace('frictionloss="0.5"',
                                                                 'damping="60"'))
    robot, rng = load_mujoco(path), np.random.default_rng(3)
    simulator, joints = third_party('arm', robot), told(20.0)
    rig = load_rig()
    found = {}
    for name, weigh in (('none', 1.0), ('payload', 1.08)):
        robot.model.opt.timestep = 0.0005
        made = simulator.run(Inputs(0.0, 20.0, joints=joints), [
            p.nominal * (weigh if p.name == 'body_mass[gripper]' else 1.0)
            for p in simulator.parameters])
        robot.model.opt.timestep = 0.002
        found[name] = SimulatorSource(simulator, rig).diagnose(
            noisy(made, joints, rng, 0.15, 0.006, 1e-4))
    assert found['none'].diagnosis.verdict == 'no_gap'
    changed, = found['payload'].details['parameters']
    assert changed['name'] == 'body_mass[gripper]'
    assert changed['after'] == pytest.approx(1.62, abs=4.0 * changed['std'])


@pytest.fixture(scope='module')
def sample():
    """Return the arm that `forcecal sample rigid_arm` makes, and a recording of it."""
    source = files('forcecal_ros') / 'config' / 'examples' / 'rigid_arm.xml'
    arm = third_party('rigid_arm.xml', load_mujoco(str(source)))
    return arm, recorded(arm, {}, seed=4)


@pytest.mark.parametrize('factors, change', first([
    ({'body_mass[gripper]': 1.4}, lambda w: w), ({}, lambda w: w),
    ({'kp[lift]': 0.5, 'kp[wrist_1]': 2.0}, lambda w: w),
    ({}, lambda w: w * [1.15, 1.0, 0.85, 1.0, 1.0, 1.0]),
    ({}, lambda w: np.roll(w, 12, axis=0)),
    ({}, lambda w: w + 0.06 * np.outer(w[:, 2], np.eye(6)[0]))]))
def test_effects_of_any_usual_size_are_no_other_frame(sample, factors, change):
    arm, _ = sample
    rig = load_rig('rigid_tool.yaml')
    real = recorded(arm, factors, 5)
    real = replace(real, wrench=replace(real.wrench, values=change(real.wrench.values)))
    made = arm.run(inputs_of(real), arm.nominal)
    require_axes_of(simulated_tool(made, *span(real), rig).rigid_tool, real)


def test_a_drive_with_play_leaves_its_joint_until_the_command_has_crossed_it(model):
    robot, inputs = load_mujoco(model()), Inputs(0.0, 6.0, joints=told(6.0), measured_joints=NAMES)
    plain = robot.simulate(inputs, nominal(robot))['joints'][1]
    behind = robot.simulate(inputs, {**nominal(robot), 'backlash[lift]': 0.02})['joints'][1]
    lag = np.abs(behind - plain)
    np.testing.assert_allclose(lag[:, 1].max(), 0.02, rtol=0.1)
    assert lag[:, [0, 2]].max() < 1e-3
    again = robot.simulate(inputs, nominal(robot))['joints'][1]
    np.testing.assert_array_equal(again, plain)


@pytest.mark.long
@pytest.mark.parametrize('name, value', [
    ('backlash[lift]', 1e-3), ('dof_frictionloss[lift]', 4.5)])
def test_play_is_not_called_friction_nor_friction_play(model, name, value):
    arm = third_party('arm', load_mujoco(model()))
    real = measured(model(), 16.0, {name: value})
    found = SimulatorSource(arm, load_rig('rigid_tool.yaml')).diagnose(real)
    effect, = found.diagnosis.effects
    assert effect.name == name
    assert effect.parameters['value'].value == pytest.approx(value, rel=0.1)
    assert [one['name'] for one in found.details['parameters']] == [name]
