"""``forcecal calibrate`` of a wrench in other axes: the options that a refusal names, or right."""

from dataclasses import replace
import json
import re

from forcecal_ros.cli.main import main
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import Stream
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import load
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from static_sets import static_set

ON_FLANGE = Rotation.from_euler('z', 30, degrees=True)
FROM_POSE = ['--sensor-from-pose', '0', '0', '0.1', *map(str, ON_FLANGE.as_quat())]

TURN = rotation_from_vector(np.radians([10.0, -20.0, 35.0]))
"""From the axes of the wire to those of the pose."""


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return a folder with a sound set, one of turned axes, one of a flange, one of both."""
    folder = tmp_path_factory.mktemp('frames')
    sound = replace(static_set(4, rate=100.0)[0], accelerometer=None)
    wrench, pose = sound.wrench, sound.pose
    pose = replace(pose, position=np.zeros_like(pose.position))
    write_recording(folder / 'sound', replace(sound, pose=pose))
    write_recording(folder / 'turned', replace(
        sound, pose=pose, wrench=Stream(wrench.t, wrench.values @ np.kron(np.eye(2), TURN))))
    R = pose.R_base_sensor @ ON_FLANGE.as_matrix().T
    flange = replace(sound, pose=replace(pose, R_base_sensor=R, position=-R @ [0.0, 0.0, 0.1]))
    write_recording(folder / 'flange', flange)
    write_recording(folder / 'both', replace(flange, wrench=Stream(
        wrench.t, wrench.values @ np.kron(np.eye(2), TURN))))
    assert main(['calibrate', str(folder / 'sound'), '-o', str(folder / 'sound.yaml')]) == 0
    return folder


def test_the_rotation_that_a_refusal_names_is_that_of_the_sensor(bags, tmp_path, capsys):
    assert main(['calibrate', str(bags / 'turned'), '-o', str(tmp_path / 'c.yaml')]) == 1
    said = capsys.readouterr().err
    stated = re.search(r'--sensor-rotation (\S+) (\S+) (\S+)', said).groups()
    np.testing.assert_allclose(np.array(stated, dtype=float), [10.0, -20.0, 35.0], atol=0.5)


def test_a_transform_that_was_given_is_set_right_by_the_one_that_a_refusal_names(
        bags, tmp_path, capsys):
    calibrate, path = ['calibrate', str(bags / 'both'), '-o', str(tmp_path / 'c.yaml')], tmp_path
    assert main([*calibrate, *FROM_POSE]) == 1
    right = re.search(r'--sensor-from-pose( \S+){7}', capsys.readouterr().err).group(0).split()
    assert right[1:4] == FROM_POSE[1:4] and main([*calibrate, *right]) == 0
    assert float(load(path / 'c.yaml').mass) == pytest.approx(
        float(load(bags / 'sound.yaml').mass), rel=1e-3)


@pytest.mark.parametrize('bag, given', [('turned', []), ('both', FROM_POSE)])
@pytest.mark.long
def test_a_turned_sensor_is_calibrated_once_its_rotation_is_stated(
        bags, tmp_path, capsys, bag, given):
    calibrate = ['calibrate', str(bags / bag), *given, '-o', str(tmp_path / 'turned.yaml')]
    turned, sound = tmp_path / 'turned.yaml', bags / 'sound.yaml'
    assert main([*calibrate, '--sensor-rotation', '10', '-20', '35']) == 0
    found, wanted = load(turned), load(sound)
    np.testing.assert_allclose(found.wrench_bias.value, wanted.wrench_bias.value, atol=1e-6)
    assert float(found.mass) == pytest.approx(float(wanted.mass))
    for name, known in ((bag, turned), ('sound', sound)):
        assert main(['estimate', str(bags / name), '--calibration', str(known),
                     '-o', str(tmp_path / name)]) == 0
    contact = [read_recording(
        tmp_path / name, {'wrench': '/observer/contact_wrench'}).wrench.values
        for name in (bag, 'sound')]
    np.testing.assert_allclose(contact[0], contact[1], atol=1e-6)


def test_an_export_that_cannot_turn_readings_is_refused(bags, tmp_path, capsys):
    known = tmp_path / 'turned.yaml'
    assert main(['calibrate', str(bags / 'turned'), '--sensor-rotation', '10', '-20', '35',
                 '-o', str(known)]) == 0
    capsys.readouterr()
    assert main(['export', str(known), '--for', 'broadcaster',
                 '-o', str(tmp_path / 'b.yaml')]) == 1
    assert 'sensor.rotation' in capsys.readouterr().err


@pytest.mark.long
def test_poses_of_a_flange_want_the_transform_and_the_calibration_keeps_it(
        bags, tmp_path, capsys):
    flange, path, out = str(bags / 'flange'), tmp_path / 'c.yaml', str(tmp_path / 'out')
    assert main(['calibrate', flange, '-o', str(path)]) == 1
    assert '--sensor-from-pose' in capsys.readouterr().err
    assert main(['calibrate', flange, *FROM_POSE, '-o', str(path)]) == 0
    np.testing.assert_allclose(load(path).com.value, load(bags / 'sound.yaml').com.value,
                               atol=1e-9)
    estimate = ['estimate', flange, '--calibration', str(path), '--filter', 'static', '-o', out]
    assert main([*estimate, '--json']) == 0
    said = capsys.readouterr().out
    found = json.loads(said[said.index('{'):])
    assert f'poses are converted to ft_sensor with sensor.from_pose of {path}' in found['notes']
    np.testing.assert_allclose(found['mean'][:3], 0.0, atol=0.05)
    assert main([*estimate, *FROM_POSE[:3], '0.12', *FROM_POSE[4:]]) == 1
    assert 'was made with sensor.from_pose 0 0 0.1' in capsys.readouterr().err
