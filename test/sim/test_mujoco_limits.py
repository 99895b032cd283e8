"""Drives of a MuJoCo model at the limit of their force: found, told, and a number like others."""

from dataclasses import replace

from forcecal_ros.sim.mujoco import load_mujoco
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.rerun import Runs
from forcecal_ros.sim.third_party import third_party
from longer import first
import numpy as np
import pytest
from small_arm import GRAVITY, mjcf, NAMES, nominal, told

pytest.importorskip('mujoco')

INPUTS = Inputs(0.0, 6.0, joints=told(6.0), measured_joints=NAMES)

LIFT = '<position joint="lift" kp="4000" kv="150"{}/>'

WAYS = {
    'actuator_forcerange': lambda text, most: text.replace(
        LIFT.format(''), LIFT.format(f' forcerange="-{most} {most}"')),
    'jnt_actfrcrange': lambda text, most: text.replace(
        'name="lift" axis="0 1 0"', f'name="lift" axis="0 1 0" actuatorfrcrange="-{most} {most}"'),
    'actuator_ctrlrange': lambda text, most: text.replace(
        LIFT.format(''), f'<motor joint="lift" gear="10" ctrlrange="-{most / 10} {most / 10}"/>'
    ).replace('</mujoco>', '<custom><numeric name="p[lift]" data="4000"/>'
              '<numeric name="d[lift]" data="150"/></custom></mujoco>')}
"""Fields of a model that limit a drive, and how its source says so."""


def limited(path, field, most):
    """Return an arm whose joint that lifts gives so much, at most [N m]."""
    path.write_text(WAYS[field](mjcf(), most))
    return load_mujoco(str(path))


@pytest.fixture
def arm_xml(tmp_path):
    return tmp_path / 'arm.xml'


def most_needed(path):
    """Return the largest torque that the motion wants of that joint [N m]."""
    robot = limited(path, 'actuator_forcerange', 1000.0)
    return 1000.0 * float(robot._looked_at(INPUTS).forces.most[0])


@pytest.mark.parametrize('field', first(WAYS))
def test_a_drive_at_its_limit_is_said_with_its_joint_and_its_field(arm_xml, field):
    needed = most_needed(arm_xml)
    assert limited(arm_xml, field, round(1.3 * needed, 2)).remarks(INPUTS) == []
    scarce = limited(arm_xml, field, round(0.8 * needed, 2))
    said, = scarce.remarks(INPUTS)
    assert said.startswith(f'in the model the drive of lift is at its {field} (')
    assert f'{field}[lift]' in nominal(scarce)


@pytest.mark.parametrize('field', first(WAYS))
def test_a_limit_that_is_come_to_is_a_number_and_one_that_is_not_is_left_out(arm_xml, field):
    needed = most_needed(arm_xml)
    for part, acts in ((0.8, True), (1.05, True), (1.3, False)):
        arm = third_party('arm', limited(arm_xml, field, round(part * needed, 2)))
        names = {p.name for p in arm.acting([INPUTS]).parameters}
        assert (f'{field}[lift]' in names) == acts


@pytest.mark.parametrize('field', WAYS)
def test_a_lower_limit_holds_the_joint_back_and_is_patched(arm_xml, field):
    robot = limited(arm_xml, field, round(1.3 * most_needed(arm_xml), 2))
    name = f'{field}[lift]'
    values = nominal(robot) | {name: 0.6 * nominal(robot)[name]}
    before, after = (robot.simulate(INPUTS, one)['joints'][1] for one in (nominal(robot), values))
    assert np.abs(after - before)[:, 1].max() > 0.01
    arm_xml.write_text(robot.patched(values))
    own = load_mujoco(str(arm_xml))
    assert nominal(own) == pytest.approx(values)
    np.testing.assert_allclose(own.simulate(INPUTS, nominal(own))['joints'][1], after, atol=1e-6)


def test_a_limit_that_acts_only_lower_down_is_tried_lower_down(arm_xml):
    robot = limited(arm_xml, 'actuator_forcerange', round(1.05 * most_needed(arm_xml), 2))
    name = 'actuator_forcerange[lift]'
    arm = third_party('arm', robot)
    arm = replace(arm, parameters=tuple(p for p in arm.parameters if p.name == name))
    runs = Runs(arm, INPUTS, arm.run(INPUTS, arm.nominal).pose)
    runs.try_all(arm.nominal)
    change, = runs.changes(arm.nominal)
    # by one sigma less it sags, which is said as what one sigma more would lift
    lower = arm.run(INPUTS, (arm.nominal[0] - arm.parameters[0].sigma,)).joints
    here = runs.exact(arm.nominal).joints
    assert np.abs(lower.values - here.values).max() > 1e-4
    np.testing.assert_allclose(change['joints'], here.values - lower.values, atol=1e-12)


def test_an_arm_that_does_not_come_to_rest_is_said(arm_xml):
    arm_xml.write_text(mjcf().replace(' kv="150"', '').replace(' frictionloss="0.5"', ''))
    said, = load_mujoco(str(arm_xml)).remarks(INPUTS)
    assert 'still moves at' in said
    assert said.endswith('add the damping of the robot to its drive (kv) or joint')
    arm_xml.write_text(mjcf())
    assert load_mujoco(str(arm_xml)).remarks(INPUTS) == []


def test_a_body_that_is_held_against_gravity_weighs_on_the_sensor_as_it_did(arm_xml):
    weights = []
    for held in ('', ' gravcomp="1"'):
        arm_xml.write_text(mjcf().replace('<body name="gripper"', f'<body name="gripper"{held}'))
        robot = load_mujoco(str(arm_xml))
        weights.append(robot.simulate(INPUTS, nominal(robot))['wrench'][1][0])
    np.testing.assert_allclose(weights[1], weights[0], atol=0.05)
    assert np.linalg.norm(weights[0][:3]) == pytest.approx(1.5 * GRAVITY, rel=0.01)
