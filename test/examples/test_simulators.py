"""The examples of third-party simulators: a payload that is off is named."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
import sys

import forcecal_ros as fc
from forcecal_ros.cli.sample import commands, SECONDS
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.sim.protocol import Inputs
from forcecal_ros.sim.third_party import third_party
import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
JOINTS = ('pan', 'lift', 'elbow', 'wrist_1', 'wrist_2', 'wrist_3')
HEAVIER_KG, FORCE_N, TORQUE_NM = 1.26, 0.15, 0.006
PLACE_M, TURN_RAD = 2e-5, 5e-5
"""Noise of a pose from encoders: where it has none, micrometres of sag outweigh newtons."""


@pytest.mark.parametrize('path', sorted(EXAMPLES.glob('*_arm.py')), ids=lambda path: path.stem)
def test_an_example_has_at_most_60_lines(path):
    assert len(path.read_text().splitlines()) <= 60


@pytest.mark.parametrize('way', ['--drake', '--drake-mujoco'])
def test_without_drake_its_benchmark_is_skipped(way, tmp_path, monkeypatch, capsys):
    benchmark = EXAMPLES.parent / 'benchmark'
    if not benchmark.is_dir():
        pytest.skip('benchmarks are not part of what is installed')
    monkeypatch.syspath_prepend(benchmark)
    pytest.importorskip('mujoco', reason='requires mujoco, which is not installed')
    monkeypatch.setitem(sys.modules, 'pydrake', None)  # as on a machine without it
    monkeypatch.setattr(sys, 'argv', ['any_simulator.py', '--out', str(tmp_path / 'out'), way])
    import_module('any_simulator').main()
    said, = capsys.readouterr().out.splitlines()
    assert said.startswith('skipped: pydrake is not installed (') and 'pip install' in said
    assert not (tmp_path / 'out').exists()


@pytest.mark.long
@pytest.mark.parametrize(
    ('name', 'module'), [('drake_arm', 'pydrake'), ('pybullet_arm', 'pybullet')])
def test_a_heavier_payload_is_named(name, module, monkeypatch):
    pytest.importorskip(module, reason=f'requires {module}, which is not installed')
    monkeypatch.syspath_prepend(EXAMPLES)
    arm = third_party(name, import_module(name).make())
    joints = commands(JOINTS, 1)
    robot = arm.run(Inputs(0.0, SECONDS, joints=joints), [HEAVIER_KG, 1.0])
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(len(robot.wrench), 6)) * (3 * [FORCE_N] + 3 * [TORQUE_NM])
    place, turn = rng.normal(size=(2, len(robot.pose), 3))
    robot = replace(
        robot, joint_commands=joints,
        wrench=replace(robot.wrench, values=robot.wrench.values + noise),
        pose=replace(robot.pose, position=robot.pose.position + PLACE_M * place,
                     R_base_sensor=robot.pose.R_base_sensor @ rotation_from_vector(
                         TURN_RAD * turn)))
    gap = fc.diagnose(robot, against=arm)
    assert gap.to_dict()['verdict'] in ('identified', 'ambiguous')  # a gain looks like a mass
    payload, = gap.value.effects
    value, = payload.parameters.values()
    assert payload.name == 'payload' and payload.probability > 0.8
    assert abs(value.value - HEAVIER_KG) < 4.0 * value.std < 0.03
