"""A calibration as other packages take it: what they compute with it is the contact wrench."""

from dataclasses import replace

from forcecal_ros.cli.main import main
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import matrix_from_quaternion
from forcecal_ros.io.calibration_file import load, save
from forcecal_ros.io.exports import CONSUMERS, export, Place
import numpy as np
import pytest
import yaml

CALIBRATION = Calibration(
    mass=Estimate(1.3, 1e-3, 'kg'), com=Estimate([0.03, -0.01, 0.14], 1e-4, 'm'),
    wrench_bias=Estimate([4, -3, 8, 0.3, -0.2, 0.1], 1e-2, 'N, N m'),
    inertia=Estimate([[0.12, 0.01, 0], [0.01, 0.15, 0], [0, 0, 0.06]], 1e-3, 'kg m^2'),
    sensor_frame='wrist')
TURNED = replace(CALIBRATION, wrench_sign=-1)
MATRIX = replace(CALIBRATION, matrix=Estimate(np.eye(6), 0.0, '1'),
                 matrix_offset=Estimate(np.zeros(6), 0.0, '1'))
R_BASE_SENSOR = matrix_from_quaternion([0.1, 0.7, -0.3, 0.4])
CONTACT = np.array([10.0, -20.0, 5.0, 1.0, 2.0, -3.0])


def wire(c):
    """Return what the sensor says while it touches something, and g as it sees it."""
    g = R_BASE_SENSOR.T @ [0.0, 0.0, -c.gravity]
    weight = float(c.mass) * g
    load_ = np.concatenate([weight, np.cross(c.com.value, weight)])
    return c.wrench_sign * (CONTACT + load_ + c.wrench_bias.value), g


def parameters(c, consumer, **place):
    document = yaml.safe_load(export(c, consumer, Place(**place)))
    (node, inside), = document.items()
    return node, inside['ros__parameters']


def numbers(axes):
    return np.array([axes[kind][axis] for kind in ('force', 'torque') for axis in 'xyz'])


@pytest.mark.parametrize('c', [CALIBRATION, TURNED], ids=['as defined', 'opposite sign'])
def test_broadcaster_and_its_gravity_filter_leave_the_contact(c):
    raw, _ = wire(c)
    node, broadcaster = parameters(c, 'broadcaster')
    same, chain = parameters(c, 'gravity_filter', base_frame='world')
    assert node == same == 'force_torque_sensor_broadcaster'
    published = (raw + numbers(broadcaster['offset'])) * numbers(broadcaster['multiplier'])
    one = chain['sensor_filter_chain']['filter1']
    assert one['type'] == 'control_filters/GravityCompensationWrench'
    tool = one['params']['tool']
    pull = R_BASE_SENSOR.T @ (np.array(tool['gravity_field']) * tool['mass'])
    load_ = np.concatenate([pull, np.cross(tool['CoG'], pull)])
    np.testing.assert_allclose(published - load_, CONTACT, atol=1e-6)
    assert one['params']['sensor_frame'] == broadcaster['frame_id'] == 'wrist'
    assert one['params']['world_frame'] == 'world'


def test_admittance_controller_takes_the_weight_off():
    raw, _ = wire(CALIBRATION)
    _, values = parameters(CALIBRATION, 'admittance')
    cog = values['gravity_compensation']['CoG']
    pull = np.array([0, 0, -cog['force']])
    turned = np.concatenate([R_BASE_SENSOR @ part for part in np.split(
        raw - CALIBRATION.wrench_bias.value, 2)])
    rest = turned - np.concatenate([pull, np.cross(R_BASE_SENSOR @ cog['pos'], pull)])
    np.testing.assert_allclose(
        np.concatenate([R_BASE_SENSOR.T @ part for part in np.split(rest, 2)]), CONTACT, atol=1e-6)
    assert values['gravity_compensation']['frame']['id'] == values['ft_sensor']['frame']['id']


def test_kth_and_ft_tools_take_bias_and_weight_off():
    raw, g = wire(CALIBRATION)
    kth = yaml.safe_load(export(CALIBRATION, 'kth'))
    pull = kth['gripper_mass'] * g
    load_ = np.concatenate([pull, np.cross(kth['gripper_com_pose'][:3], pull)])
    np.testing.assert_allclose(raw - kth['bias'] - load_, CONTACT, atol=1e-6)
    tools = yaml.safe_load(export(CALIBRATION, 'ft_tools'))
    pull = tools['mass'] * g
    load_ = np.concatenate([pull, np.cross(tools['sensor_frame_to_com'], pull)])
    offset = [*tools['force_offset'], *tools['torque_offset']]
    np.testing.assert_allclose(raw - offset - load_, CONTACT, atol=1e-6)


def test_payload_of_a_universal_robot_is_in_the_flange():
    turn = matrix_from_quaternion([0, 0, 1, 1])
    payload = yaml.safe_load(export(CALIBRATION, 'ur', Place(
        R_flange_sensor=turn, sensor_in_flange=np.array([0, 0, 0.05]))))
    assert payload['mass'] == 1.3
    assert payload['center_of_gravity'] == pytest.approx({'x': 0.01, 'y': 0.03, 'z': 0.19})
    assert [payload[key] for key in ('ixx', 'iyy', 'izz', 'ixy')] == pytest.approx(
        [0.15, 0.12, 0.06, -0.01])
    bare = yaml.safe_load(export(replace(CALIBRATION, inertia=None), 'ur'))
    assert set(bare) == {'mass', 'center_of_gravity'}


@pytest.mark.parametrize('consumer', CONSUMERS)
def test_every_number_is_a_float_for_ros(consumer):
    def leaves(value):
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        return [leaf for item in value for leaf in leaves(item)] if isinstance(value, list) \
            else [value]
    whole = replace(CALIBRATION, mass=Estimate(2, 0, 'kg'), gravity=10.0)
    found = leaves(yaml.safe_load(export(whole, consumer)))
    assert {type(leaf) for leaf in found} <= {float, str}


@pytest.mark.parametrize('consumer', ['kth', 'ft_tools'])
def test_what_goes_out_comes_back(consumer, capsys, tmp_path):
    save(CALIBRATION, tmp_path / 'c.yaml')
    there = tmp_path / 'there.yaml'
    assert main(['export', str(tmp_path / 'c.yaml'), '--for', consumer, '-o', str(there)]) == 0
    assert main(['calibrate', str(there), '-o', str(tmp_path / 'back.yaml')]) == 0
    back = load(tmp_path / 'back.yaml')
    for name in ('mass', 'com', 'wrench_bias'):
        np.testing.assert_allclose(getattr(back, name).value, getattr(CALIBRATION, name).value)
        assert np.isnan(getattr(back, name).std).all()
    assert back.sensor_frame == ('wrist' if consumer == 'kth' else 'ft_sensor')
    capsys.readouterr()
    assert main(['export', str(tmp_path / 'back.yaml'), '--for', consumer]) == 0
    assert yaml.safe_load(capsys.readouterr().out) == yaml.safe_load(there.read_text())


def test_files_as_their_owners_write_them_are_read(tmp_path):
    path = tmp_path / 'ft_calib_data.yaml'
    path.write_text('bias: [1, 2.5, 3,\n  0.1, 0.2, 0.3]\ngripper_com_frame_id: /wrist_ft\n'
                    'gripper_com_pose: [0.01, 0.02, 0.03, 0.0, 0.0, 0.0]\ngripper_mass: 0.7\n')
    c = load(path)
    assert float(c.mass) == 0.7 and c.sensor_frame == 'wrist_ft'
    np.testing.assert_allclose(c.wrench_bias.value, [1, 2.5, 3, 0.1, 0.2, 0.3])
    path.write_text('mass: 0.7\nsensor_frame_to_com:\n  - 0.01\n  - 0.02\n  - 0.03\n'
                    'force_offset:\n  - 1\n  - 2\n  - 3\ntorque_offset: [0.1, 0.2, 0.3]\n')
    np.testing.assert_allclose(load(path).com.value, [0.01, 0.02, 0.03])


@pytest.mark.parametrize('text', [
    'gripper_mass: 0.7\nbias: [1, 2]\ngripper_com_pose: [0, 0, 0, 0, 0, 0]\n',
    'gripper_mass: 0.7\n', 'gripper_mass: heavy\n',
    'gripper_mass: -1\nbias: [1, 2, 3, 4, 5, 6]\ngripper_com_pose: [0, 0, 0, 0, 0, 0]\n',
    ('mass: 0.7\nsensor_frame_to_com: [0, 0, .nan]\nforce_offset: [0, 0, 0]\n'
     'torque_offset: [0, 0, 0]\n')])
def test_a_damaged_file_is_refused_with_its_key(tmp_path, text):
    path = tmp_path / 'c.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match=r'c\.yaml: .*(expected|missing key)'):
        load(path)


@pytest.mark.parametrize('c, refusing', [
    (TURNED, {'admittance', 'kth', 'ft_tools'}),
    (MATRIX, {'broadcaster', 'admittance', 'kth', 'ft_tools'})], ids=['sign', 'matrix'])
def test_who_would_be_misled_is_refused(c, refusing):
    for consumer in CONSUMERS:
        if consumer in refusing:
            with pytest.raises(ConfigError, match=consumer):
                export(c, consumer)
        else:
            export(c, consumer)


@pytest.mark.parametrize('consumer', ['gravity_filter', 'admittance'])
def test_a_frame_that_is_not_level_is_not_taken_for_upright(consumer):
    on_wall = replace(CALIBRATION, gravity_direction=(0.0, 1.0, 0.0))
    with pytest.raises(ConfigError, match='--base-frame'):
        export(on_wall, consumer)
    text = export(on_wall, consumer, Place(base_frame='world'))
    assert 'along [0.0, 1.0, 0.0] of base' in text
