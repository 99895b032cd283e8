"""A calibration of another package, with what its user states of gravity, sign and sensor."""

from dataclasses import replace
import json
import re

from forcecal_ros.cli.main import main
from forcecal_ros.core.geometry import quaternion_from_matrix, rotation_from_vector
from forcecal_ros.core.streams import JointStream
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import load
import moving_arm
from moving_arm import moving
import numpy as np
import pytest
from wrong_recordings import at_wrench, in_base, log, orientations, recording_of, write
import yaml

TILT = rotation_from_vector(np.radians([20.0, 0.0, 0.0]))
TURN = rotation_from_vector(np.radians([0.0, 0.0, 40.0]))


def kth(path, com=moving_arm.COM, bias=moving_arm.BIAS):
    """Write a file as force_torque_tools does."""
    path.write_text(yaml.safe_dump({
        'bias': bias.tolist(), 'gripper_mass': moving_arm.MASS,
        'gripper_com_frame_id': 'ft_sensor', 'gripper_com_child_frame_id': 'gripper_com',
        'gripper_com_pose': [*com.tolist(), 0.0, 0.0, 0.0]}))
    return str(path)


def leaning(one):
    return replace(one, place=one.place @ TILT.T,
                   q=quaternion_from_matrix(TILT @ orientations(one)))


@pytest.fixture(scope='module')
def one():
    """Record an arm so slow that it shows its weight and little else."""
    return moving(5, seconds=16.0, rate=100.0)


def contact_of(tmp_path, one, calibration, *options):
    """Return the contact force that is estimated, RMS [N]."""
    out = str(tmp_path / 'out')
    assert main(['estimate', str(write(one, tmp_path / 'bag')), '--calibration', calibration,
                 '--filter', 'static', '-o', out, *options]) == 0
    found = read_recording(out, topics={'wrench': 'observer/contact_wrench'}).wrench
    return float(np.sqrt((found.values[50:, :3]**2).mean()))


@pytest.fixture(scope='module')
def sound(tmp_path_factory, one):
    folder = tmp_path_factory.mktemp('sound')
    return contact_of(folder, one, kth(folder / 'kth.yaml'))


DOWN = [f'{x:.6f}' for x in TILT @ [0.0, 0.0, -1.0]]
STATED = {
    'gravity-direction': (leaning, moving_arm.COM, moving_arm.BIAS, DOWN),
    'wrench-sign': (lambda one: replace(one, wrench=-one.wrench), moving_arm.COM,
                    moving_arm.BIAS, ['-1']),
    'sensor-rotation': (lambda one: replace(one, wrench=one.wrench @ np.kron(np.eye(2), TURN)),
                        TURN.T @ moving_arm.COM, np.kron(np.eye(2), TURN.T) @ moving_arm.BIAS,
                        ['0', '0', '40']),
}


@pytest.mark.parametrize('option', STATED)
def test_what_is_stated_of_a_file_of_others_is_kept(tmp_path, one, sound, option):
    change, com, bias, numbers = STATED[option]
    read = kth(tmp_path / 'kth.yaml', com, bias)
    written = str(tmp_path / 'c.yaml')
    assert main(['calibrate', read, f'--{option}', *numbers, '-o', written]) == 0
    assert contact_of(tmp_path, change(one), written) == pytest.approx(sound, abs=1e-3)


def test_gravity_of_a_file_of_others_is_that_stated(tmp_path):
    written = str(tmp_path / 'c.yaml')
    assert main(['calibrate', kth(tmp_path / 'kth.yaml'), '--gravity', '9.78', '-o',
                 written]) == 0
    assert load(written).gravity == 9.78


@pytest.mark.long
def test_estimate_takes_a_direction_of_gravity_of_its_own(tmp_path, one, sound, capsys):
    read = kth(tmp_path / 'kth.yaml')
    found = contact_of(tmp_path, leaning(one), read, '--gravity-direction', *DOWN)
    assert found == pytest.approx(sound, abs=1e-3)
    assert contact_of(tmp_path, leaning(one), read) > 3.0 * sound
    assert 'the base is tilted: gravity is 20.' in capsys.readouterr().err


def test_a_calibration_of_this_package_keeps_its_own_sign_and_axes(tmp_path, one, capsys):
    write(log(3, poses=6), tmp_path / 'cal')
    made = str(tmp_path / 'own.yaml')
    assert main(['calibrate', str(tmp_path / 'cal'), '-o', made]) == 0
    assert main(['calibrate', made, '--wrench-sign', '-1', '-o',
                 str(tmp_path / 'c.yaml')]) == 2
    assert '--wrench-sign cannot change a calibration' in capsys.readouterr().err


def without_pose(path, **streams):
    t = np.arange(0.0, 5.0, 0.01)
    joints = JointStream(t, np.sin(t)[:, None] * np.ones(6), '', tuple('abcdef'))
    write_recording(path, replace(
        recording_of(log(1, poses=2)), pose=None, joints=joints, **streams))


def test_joints_alone_say_what_they_can_be_used_for(tmp_path, capsys):
    without_pose(tmp_path / 'bag', wrench=None)
    assert main(['calibrate', str(tmp_path / 'bag'), '-o', str(tmp_path / 'c.yaml')]) == 1
    assert 'pose=urdf:FILE:BASE:LINK' in capsys.readouterr().err
    main(['check', str(tmp_path / 'bag')])
    said = capsys.readouterr().out
    assert 'no wrench was recorded, and every use requires it; compute it from' in said


def test_joints_and_a_wrench_say_how_to_get_the_pose(tmp_path, capsys):
    without_pose(tmp_path / 'bag')
    assert main(['calibrate', str(tmp_path / 'bag'), '-o', str(tmp_path / 'c.yaml')]) == 1
    way = 'compute it from joint states with --topic pose=urdf:FILE:BASE:LINK'
    assert way in capsys.readouterr().err
    main(['check', str(tmp_path / 'bag')])
    assert f'pose was recorded; {way}' in capsys.readouterr().out


def test_a_robot_at_rest_with_a_noisy_pose_touches_nothing(tmp_path, one, capsys):
    rng, still = np.random.default_rng(3), np.zeros(len(one.t), dtype=int)
    noise = np.repeat([0.08, 0.004], 3) * rng.standard_normal((len(one.t), 6))
    held = np.zeros(len(one.pose_t), dtype=int)
    R = orientations(one)[:1]
    weight = -moving_arm.MASS * 9.80665 * R[0, 2]
    wobble = rotation_from_vector(2e-4 * rng.standard_normal((len(held), 3)))
    rest = replace(
        one, wrench=(np.hstack([weight, np.cross(moving_arm.COM, weight)]) + moving_arm.BIAS)[
            None][still] + noise, q=quaternion_from_matrix(R @ wobble),
        place=one.place[held] + 1e-4 * rng.standard_normal((len(held), 3)))
    read = kth(tmp_path / 'kth.yaml')
    assert contact_of(tmp_path, rest, read) < 0.16
    capsys.readouterr()
    assert main(['estimate', str(tmp_path / 'bag'), '--calibration', read, '--filter', 'ukf',
                 '-o', str(tmp_path / 'out'), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert 5.0 < found['nis'] < 8.0
    assert found['contact_share'] < 0.01


def scaled(*factors):
    return lambda one: replace(one, wrench=one.wrench * np.repeat(factors, 3))


SPOILT = {
    'sign': (scaled(-1.0, -1.0), 'sign'),
    'kgf': (scaled(1.0 / 9.80665, 1.0), 'kgf'),
    'N mm': (scaled(1.0, 1e3), 'N mm'),
    'sign of the torques': (scaled(1.0, -1.0), 'torques'),
    'base': (lambda one: replace(one, wrench=in_base(one, np.ones(len(one.t), bool))), 'base'),
    'rotated': (lambda one: replace(one, wrench=one.wrench @ np.kron(np.eye(2), TURN)),
                'rotated by (39.9|40.0)'),
    'mirrored': (lambda one: replace(one, wrench=one.wrench * [1, -1, 1, 1, -1, 1]), 'mirrored'),
    'weight': (lambda one: replace(one, wrench=one.wrench - weight(one)), 'weight')}


def weight(one):
    force = -moving_arm.MASS * 9.80665 * at_wrench(one)[:, 2]
    return np.hstack([force, np.cross(moving_arm.COM, force)])


@pytest.mark.parametrize('fault', SPOILT)
def test_a_known_tool_on_a_moving_arm_shows_what_is_wrong(tmp_path, fault, capsys):
    spoil, words = SPOILT[fault]
    bag = str(write(spoil(moving(9, seconds=25.0)), tmp_path / 'bag'))
    known = '--calibration', kth(tmp_path / 'kth.yaml'), '-o', str(tmp_path / 'out')
    assert main(['estimate', bag, *known]) == 1
    assert re.search(words, capsys.readouterr().err)
    assert not (tmp_path / 'out').exists()
    main(['diagnose', bag, *known])
    assert re.search(words, capsys.readouterr().out)
    found = json.loads((tmp_path / 'out' / 'diagnosis.json').read_text())
    assert found['verdict'] == 'invalid_data'
