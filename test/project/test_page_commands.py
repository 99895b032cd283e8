"""Every command in a block of a page is one that its program takes; cheap ones run."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
import re
import shlex

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.cli.main import main, parse
from forcecal_ros.core.geometry import (
    matrix_from_quaternion,
    rotation_about,
    rotation_vector,
)
from forcecal_ros.core.topics import read_preset
from forcecal_ros.io.bags import write_recording
from forcecal_ros.io.calibration_file import save
from forcecal_ros.motion.plan import outline, prepare, SEQUENCES
from forcecal_ros.motion.plan import preview as sampled
from forcecal_ros.motion.profiles import Pose
from forcecal_ros.nodes.config import TABLES
from forcecal_ros.nodes.sequencer import settings_of
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
import numpy as np
import pytest
from rig_recordings import FREE, own_recording
from scipy.optimize import least_squares
import yaml

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
REFERENCE = (ROOT / 'docs/reference/nodes.md').read_text()


def commands(page, *programs):
    """Yield the words of each command in a page's blocks that begins with one of the programs."""
    for line in re.findall(r'^    +(\S.*)$', page.read_text(), re.MULTILINE):
        for part in line.split(' && '):
            if part.startswith(programs):
                yield shlex.split(part, comments=True)


ALL = {f'{page.stem}: {" ".join(words)}': words for page in PAGES
       for words in commands(page, 'forcecal ', './run ', '~/forcecal_env/bin/forcecal ')
       if words[1] != 'test'}


def test_pages_have_commands():
    assert len(ALL) > 35


@pytest.mark.parametrize('words', ALL.values(), ids=ALL)
def test_forcecal_takes_the_command(words):
    assert parse(words[1:]).run


def launched():
    """Yield name, values, and files that have it if not all, of each argument of launch files."""
    section = REFERENCE.partition('## Arguments of the launch files')[2].partition('\n## ')[0]
    for line in re.sub(r' \(`[\w/]+`\)', '', section).splitlines():  # names of topics in nodes
        if found := re.match(r'- (`.+?`)(?: \((`.+`)\))?: .+?\.(?: Of (.+)\.)?$', line):
            names, values, files = found.groups(default='')
            for name in re.findall(r'`(\w+)`', names):
                yield name, (re.findall('`(.+?)`', values), files.split(', '))


LAUNCHED = dict(launched())


@pytest.mark.parametrize('words', [
    pytest.param(words, id=' '.join(words[3:5])) for page in PAGES
    for words in commands(page, 'ros2 launch ')])
def test_a_launch_file_takes_its_arguments(words):
    _, _, package, file, *arguments = words
    assert package == 'forcecal_ros' and (ROOT / 'launch' / file).is_file()
    for name, value in (one.split(':=') for one in arguments):
        values, files = LAUNCHED[name]
        assert value in values or not values, name
        assert file.partition('.')[0] in files or files == [''], name


@pytest.mark.parametrize('words', [
    pytest.param(words, id=' '.join(words)) for page in PAGES
    for words in commands(page, 'ros2 run ', 'ros2 param set ')])
def test_a_node_takes_its_parameters(words):
    if words[1] == 'param':
        node, given = words[3].strip('/'), [words[4:]]
    else:
        node = words[3]
        given = [one.split(':=') for flag, one in pairwise(words) if flag == '-p']
    rows = {row.name: row for row in TABLES[node][0]}
    for name, value in given:
        assert value in rows[name].choices or not rows[name].choices


@pytest.fixture(scope='module')
def cell(tmp_path_factory):
    """Return a folder with the recording and calibrations that pages name."""
    folder = tmp_path_factory.mktemp('cell')
    write_recording(folder / 'BAG', recording := own_recording(1, FREE))
    calibration = identify(recording)
    for name in ('calibration.yaml', 'new.yaml'):
        save(calibration, folder / name)
    (folder / 'my_bag').symlink_to(folder / 'BAG')
    return folder


CHEAP = {name: words for name, words in ALL.items() if words[1] in (
    'check', 'init', 'export', 'compare', 'calibrate')
    and not {'--report', '--robot'} & {*words}}
"""The others run in test_tutorial."""



@pytest.mark.parametrize('words', CHEAP.values(), ids=CHEAP)
def test_a_cheap_command_runs(words, cell, tmp_path, monkeypatch, capsys):
    for file in cell.iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / 'first').mkdir()
    (tmp_path / 'first/bag').symlink_to(cell / 'BAG')
    monkeypatch.chdir(tmp_path)
    assert main([*words[1:], *['--offline'] * (words[1] == 'init')]) == 0
    assert capsys.readouterr().out


def planned(page, *presets, start):
    """Return the settings of a page's parameter file over its presets, and its plan."""
    block, = re.findall(r'```yaml\n(.*?)```', (ROOT / 'docs' / page).read_text(), re.DOTALL)
    found = yaml.safe_load(block)['/**/sequencer']['ros__parameters']
    values = {row.name: row.default for row in TABLES['sequencer'][0]}
    assert {*found} <= {*values}
    for name in presets:
        values |= read_preset(name)['sequencer']
    settings = settings_of(values | found)
    goals, away = settings.goals(start)
    return settings, prepare(SEQUENCES[settings.sequence](goals, away, settings.timing),
                             start, settings.pace, settings.limits)


def test_the_file_of_the_first_robot_is_within_its_limits_and_calibrates():
    start = Pose(np.array([0.45, 0.0, 0.5]), matrix_from_quaternion(np.array([1.0, 0, 0, 0])))
    settings, plan = planned('tutorials/first-robot.md', 'ur', 'moveit_servo', start=start)
    assert 'the tip within' in outline(plan, settings.limits.tip)
    target, phases = sampled(plan, 250.0, 0.5)
    rig = load_rig('rehearsal.yaml')
    recorded = replace(simulate(rig, target, seed=1), phases=phases, accelerometer=None)
    found = identify(recorded)
    assert abs(float(found.mass) - rig.tool.mass) < 4.0 * float(found.mass.std)
    assert not found.quality['warnings']


def ur5e(q):
    """Return the flange of a UR5e in ``base``, by the maker's DH parameters."""
    d = 0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996
    a = 0.0, -0.425, -0.3922, 0.0, 0.0, 0.0
    turn = 0.5 * np.pi * np.array([1, 0, 0, 1, -1, 0])
    R, p = np.eye(3), np.zeros(3)
    for i in range(6):
        R = R @ rotation_about('z', q[i])
        p = p + R @ (a[i], 0.0, d[i])
        R = R @ rotation_about('x', turn[i])
    return p, R


def test_a_ur5e_reaches_the_poses_of_the_first_robot_away_from_singular_ones():
    start = Pose(np.array([0.45, 0.0, 0.5]), matrix_from_quaternion(np.array([1.0, 0, 0, 0])))
    settings, _ = planned('tutorials/first-robot.md', 'ur', 'moveit_servo', start=start)
    goals, _ = settings.goals(start)
    assert len(goals) == 4
    for goal in goals.values():
        def off(q, goal=goal):
            p, R = ur5e(q)
            return np.concatenate([p - goal.position,
                                   rotation_vector(R.T @ goal.R_base_sensor)])
        found = least_squares(off, np.pi * np.array([0.9, -0.5, 0.5, -0.5, -0.5, -0.6]))
        assert found.cost < 1e-12 and np.abs(found.x).max() < np.pi
        assert np.linalg.svd(found.jac)[1][-1] > 0.1


def test_the_file_for_abb_is_within_its_limits():
    _, plan = planned('how-to/robots.md', 'broadcaster', 'joint_trajectory_controller',
                      start=np.zeros(6))
    assert len(plan) > 5
