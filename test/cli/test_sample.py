"""What is made to try the commands on is what they say of it."""

import json
from pathlib import Path

from forcecal_ros.cli.main import main
from forcecal_ros.cli.sample import LOADS, MASS
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.sim.rig.file import load_rig
import numpy as np
import pytest


def test_tables_of_a_limb_come_out_with_the_masses_that_were_added(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['sample', 'insitu', '-o', 'limb']) == 0
    tried = capsys.readouterr().out.partition('try: forcecal ')[2].split()
    assert {path.stem for path in Path('limb').glob('*.csv')} == set(LOADS)
    assert main([*tried[:-1], 'found']) == 0
    assert 'Held-out added masses are found within 0.' in capsys.readouterr().out
    found = load('found/calibration.yaml')
    assert abs(float(found.mass) - MASS) < 4 * float(found.mass.std)


@pytest.mark.long
def test_the_recordings_of_a_rig_differ_by_what_the_second_is_late(tmp_path):
    assert main(['sample', 'rig', '-o', str(tmp_path)]) == 0
    sound, late = (read_recording(tmp_path / name) for name in ('sound', 'late'))
    assert sound.phases == late.phases and 'contact' in {p.name for p in sound.phases}
    t = np.arange(5.0, 49.0, 0.001)
    ahead, behind = sound.wrench.at(t)[:, 0], late.wrench.at(t + 0.004)[:, 0]
    noise = np.hypot(*2 * [load_rig().wrench_sensor.force_noise])
    assert np.std(ahead - behind) < 1.1 * noise < np.std(ahead - late.wrench.at(t)[:, 0])


def test_the_gripper_of_the_second_arm_is_heavier_than_its_model_says(tmp_path, capsys):
    pytest.importorskip('mujoco')
    assert main(['sample', 'rigid_arm', '-o', str(tmp_path)]) == 0
    assert f'--mujoco {tmp_path}/rigid_arm.xml' in capsys.readouterr().out
    masses = []
    for name in ('sound', 'heavier'):
        recording = read_recording(tmp_path / name)
        assert recording.joint_commands.names[2] == 'elbow'
        at_rest = recording.wrench.between(0.0, 0.9).values[:, :3].mean(axis=0)
        masses.append(np.linalg.norm(at_rest - (3.0, -1.0, 2.0)) / 9.80665)
    assert masses[0] == pytest.approx(1.2, abs=0.003)
    assert masses[1] == pytest.approx(1.26, abs=0.003)


def test_the_robot_that_was_shaken_is_identified_by_the_command_that_it_says(
        tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['sample', 'shaken', '-o', 'sample']) == 0
    tried = capsys.readouterr().out.partition('try: forcecal ')[2].split()
    assert main([*tried, '--json']) == 0
    found, rig = json.loads(capsys.readouterr().out), load_rig()
    for name, truth in (('mass', rig.tool.mass), ('stiffness', rig.optidrive.stiffness),
                        ('damping', rig.optidrive.damping)):
        estimate = found['slide'][name]
        assert abs(estimate['value'] - truth) < 4 * estimate['std']
