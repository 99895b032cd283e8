"""What the tool of a MuJoCo model touches: which numbers it has, and what they do."""

from dataclasses import replace

from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import JointStream
from forcecal_ros.diagnose.sources.simulator import SimulatorSource
from forcecal_ros.sim.mujoco import load_mujoco
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.third_party import third_party
import numpy as np
import pytest
from small_arm import mjcf, NAMES, nominal, told, TOOL

pytest.importorskip('mujoco')

TIP = TOOL.replace('<site', '<geom name="tip" size="0.02" mass="0" solref="{soft} 1" '
                   'friction="{rubs}"/><site')
TABLE = ('<worldbody><geom name="table" type="box" size="1 1 0.1" pos="2 2 3" '
         'solref="{soft} 1" friction="{rubs}"/>'
         '<geom name="shelf" type="box" size="1 1 0.1" pos="2 2 8"/>')
TOUCHES = 0.2
"""Of the joint that lifts, where the tip touches the table [rad]."""


def scene(path, soft=0.05, rubs=0.6):
    """Write the arm with a table under it, and a shelf out of reach."""
    text = mjcf(tool=TIP).replace('<worldbody>', TABLE).format(soft=soft, rubs=rubs)
    path.write_text(text)
    return str(path)


def pressed(free=0.0, deep=0.01):
    """Return commands: free motion, then down onto the table, along it and up again."""
    def rising(t, begin, seconds):
        x = np.clip((t - begin) / seconds, 0.0, 1.0)
        return x ** 3 * (10.0 - 15.0 * x + 6.0 * x ** 2)

    t = np.arange(0.0, 10.0, 0.01)
    down = rising(t, 0.5, 2.0) - rising(t, 7.5, 2.0)
    along = 0.1 * np.sin(1.5 * (t - 3.5)) * rising(t, 3.5, 0.5) * rising(-t, -7.0, 0.5)
    into = (TOUCHES + deep * (1.0 + 0.5 * np.sin(6.0 * t))) * down
    q = np.stack([along, into, np.zeros(len(t))], axis=1)
    if free:
        q = np.concatenate([told(free).values, q])
    return JointStream(0.01 * np.arange(len(q)), q, '', NAMES)


def inputs_of(joints):
    return Inputs(0.0, float(joints.t[-1]), joints=joints)


def on_table(robot, changed):
    """Return how strongly a tip that slides to and fro pushes, and how strongly it rubs [N]."""
    streams = robot.simulate(inputs_of(pressed()), {**nominal(robot), **changed})
    t, wrench = streams['wrench']
    rows = (t > 4.0) & (t < 7.0)
    x, y, z, w = streams['pose'][1][rows, 3:].T
    up = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    force = wrench[rows, :3] + 1.5 * 9.80665 * up
    push = np.sum(force * up, axis=1)
    rub = np.linalg.norm(force - push[:, np.newaxis] * up, axis=1)
    return np.mean(push), np.quantile(rub, 0.8)


@pytest.mark.long
def test_only_what_is_touched_may_be_softer_or_smoother(tmp_path):
    arm = third_party('arm', load_mujoco(scene(tmp_path / 'arm.xml')))
    listed = {p.name: p for p in arm.parameters if p.stage == 'environment'}
    assert set(listed) == {f'geom_{what}' for name in ('table', 'shelf') for what in (
        f'solref[{name}]', f'friction[{name}]', *(f'pos[{name}].{a}' for a in 'xyz'))}
    assert listed['geom_solref[table]'].nominal == 0.05
    assert listed['geom_solref[table]'].unit == 's'
    assert listed['geom_friction[table]'].nominal == 0.6

    def left(*commands):
        acting = arm.acting([inputs_of(one) for one in commands])
        return {p.name for p in acting.parameters if p.stage == 'environment'}

    assert left(told(4.0)) == set()
    assert left(pressed()) == {'geom_solref[table]', 'geom_friction[table]', 'geom_pos[table].z'}
    assert left(told(4.0), pressed()) == left(pressed())


def test_a_longer_time_constant_is_softer_and_friction_rubs(tmp_path):
    robot = load_mujoco(scene(tmp_path / 'arm.xml'))
    push, rub = on_table(robot, {})
    assert push > 20.0
    assert rub == pytest.approx(0.6 * push, rel=0.1)
    softer, _ = on_table(robot, {'geom_solref[table]': 0.07})
    assert softer < 0.97 * push
    _, smoother = on_table(robot, {'geom_friction[table]': 0.4})
    assert smoother == pytest.approx(0.4 / 0.6 * rub, rel=0.1)
    assert on_table(robot, {}) == (push, rub)


def test_a_higher_table_is_pushed_more(tmp_path):
    robot = load_mujoco(scene(tmp_path / 'arm.xml'))
    low, as_it_is, high = (on_table(robot, {'geom_pos[table].z': 3.0 + x})[0]
                           for x in (-0.001, 0.0, 0.001))
    assert as_it_is - low > 5.0
    assert high - as_it_is == pytest.approx(as_it_is - low, rel=0.1)


def test_a_stiffness_is_told_by_a_negative_number(tmp_path):
    path = tmp_path / 'arm.xml'
    scene(path)
    path.write_text(path.read_text().replace('solref="0.05 1"', 'solref="-40 -12"'))
    robot = load_mujoco(str(path))
    found = {p.name: p for p in robot.parameters()}['geom_solref[table]']
    assert found.nominal == -40.0
    assert (found.low, found.high) == (-200.0, -8.0)
    assert on_table(robot, {found.name: -20.0})[0] < 0.97 * on_table(robot, {})[0]


def test_a_patched_model_touches_as_it_did_with_the_numbers(tmp_path):
    robot = load_mujoco(scene(tmp_path / 'arm.xml'))
    changed = {'geom_solref[table]': 0.08, 'geom_friction[table]': 0.3,
               'geom_pos[table].z': 2.998}
    (tmp_path / 'patched.xml').write_text(robot.patched({**nominal(robot), **changed}))
    own = load_mujoco(str(tmp_path / 'patched.xml'))
    assert nominal(own)['geom_solref[table]'] == pytest.approx(0.08)
    assert nominal(own)['geom_solref[shelf]'] == 0.02
    np.testing.assert_allclose(on_table(own, {}), on_table(robot, changed), rtol=1e-4)


def test_what_knocks_or_sticks_on_a_table_is_left_out_and_a_steady_push_is_not(tmp_path):
    arm = third_party('arm', load_mujoco(scene(tmp_path / 'arm.xml')))
    commands = pressed(free=6.0)
    real = replace(arm.run(inputs_of(commands), arm.nominal), joint_commands=commands)
    one, = SimulatorSource(arm, load_rig('rigid_tool.yaml')).prepare([real])
    t = one.dataset.measured.start + 0.004 * np.arange(len(one.dataset.groups)) - 6.0
    kept = one.dataset.measured.present[:, 0]
    # it pushes steadily, then slides to and fro, which in MuJoCo it does by hops
    assert kept[(t > 2.2) & (t < 3.0)].all()
    assert not kept[(t > 5.2) & (t < 6.0)].any()
    assert kept[(t < 1.0) | (t > 9.5)].all()
    assert one.notes[-1][0].isdigit()
    assert 's of impacts or stick-slip' in one.notes[-1]


@pytest.mark.long
@pytest.mark.parametrize('name, value', [
    (None, None), ('geom_solref[table]', 0.065)])
def test_what_the_table_has_otherwise_is_named(tmp_path, name, value):
    robot, rng = load_mujoco(scene(tmp_path / 'arm.xml')), np.random.default_rng(5)
    arm, joints = third_party('arm', robot), pressed(free=10.0)
    # what is not touched stays: the tip's own softness is that of all it may touch
    acting = arm.acting([inputs_of(joints)])
    robot.model.opt.timestep = 0.0005
    made = acting.run(inputs_of(joints), [
        value if p.name == name else p.nominal + 0.3 * rng.choice([-1.0, 1.0]) * p.sigma
        if p.nominal > p.low else p.nominal for p in acting.parameters])
    robot.model.opt.timestep = 0.002
    noise = rng.normal(size=(len(made.wrench), 6)) * np.repeat([0.15, 0.006], 3)
    place, turn = 1e-4 * rng.normal(size=(2, len(made.pose), 3))
    found = SimulatorSource(arm, load_rig('rigid_tool.yaml')).diagnose(replace(
        made, joint_commands=joints,
        wrench=replace(made.wrench, values=made.wrench.values + noise),
        pose=replace(made.pose, position=made.pose.position + place,
                     R_base_sensor=made.pose.R_base_sensor @ rotation_from_vector(turn))))
    diagnosis = found.diagnosis
    if name is None:
        assert diagnosis.verdict == 'no_gap'
        return
    assert [one['name'] for one in found.details['parameters']] == [name]
    changed, = found.details['parameters']
    assert changed['after'] == pytest.approx(value, abs=3.0 * changed['std'])
    assert changed['std'] < 0.1 * (value - nominal(robot)[name])
