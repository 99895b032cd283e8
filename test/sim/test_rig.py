"""Claims about rig files: what is read is checked, and what is dumped reads back."""

from dataclasses import replace
from pathlib import Path

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.sim.rig.file import load_rig, rewritten
import numpy as np
import pytest
import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config'
RIGS = ('rig.yaml', 'rigid_tool.yaml')


@pytest.fixture
def document():
    return yaml.safe_load((CONFIG / 'rig.yaml').read_text())


def load(tmp_path, document):
    path = tmp_path / 'changed.yaml'
    path.write_text(yaml.safe_dump(document))
    return load_rig(path)


@pytest.mark.parametrize('name', RIGS)
def test_the_files_are_those_written_from_their_rows(name):
    assert (CONFIG / name).read_text() == rewritten(CONFIG / name)


def test_no_name_and_a_bare_name_find_rigs_of_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_rig() == load_rig(CONFIG / 'rig.yaml')
    assert load_rig('rigid_tool.yaml') == load_rig(CONFIG / 'rigid_tool.yaml')


def test_rigid_tool_differs_from_nominal_by_the_optidrive_only():
    nominal, rigid = load_rig(), load_rig('rigid_tool.yaml')
    assert rigid.optidrive is None
    assert replace(rigid, optidrive=nominal.optidrive) == nominal


@pytest.mark.parametrize('path, value, expected', [
    ('tool.mass', 10 ** 400, 'expected a number above 0 [kg]'),
    ('tool.inertia', [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 'symmetric'),
    ('tool.inertia', [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 'negative'),
    ('optidrive', 'none', 'expected the keys stiffness'),
    ('accelerometer.mounted', 'acc3', 'one of acc1, acc2'),
    ('accelerometer.acc2.gain', [1.0, 0.0, 1.0], 'accelerometer.acc2.gain'),
    ('wrench_sensor.rate', 300.0, 'integer multiple of 250 Hz'),
    ('pose_sensor.rate', 50.0, 'integer multiple of 250 Hz'),
    ('robot.feedback', [1.0494, 0.0775, 0.0006], 'unstable'),
    ('robot.feedforward', [1.2348, 1.5084, 0.3011], 'static gain'),
    ('home.orientation_xyzw', [1.0, 1.0, 0.0, 0.0], 'norm 1.4142'),
])
def test_wrong_value_is_refused_in_one_line_with_the_key(
        path, value, expected, tmp_path, document):
    *groups, key = path.split('.')
    group = document
    for name in groups:
        group = group[name]
    group[key] = value
    with pytest.raises(ConfigError) as error:
        load(tmp_path, document)
    message = str(error.value)
    assert expected in message
    assert path.split('.')[0] in message
    assert 'changed.yaml' in message
    assert '\n' not in message


@pytest.mark.parametrize('text', ['tool: [1', ''])
def test_text_that_is_no_rig_is_refused(text, tmp_path):
    path = tmp_path / 'text.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError, match='text.yaml') as error:
        load_rig(path)
    assert '\n' not in str(error.value)


def test_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match='absent.yaml: cannot be read'):
        load_rig(tmp_path / 'absent.yaml')


def test_replaced_values_are_checked_and_arrays_taken():
    tool = load_rig().tool
    assert replace(tool, com=np.array([0.1, 0.2, 0.3])).com == (0.1, 0.2, 0.3)
    with pytest.raises(ConfigError, match='tool.mass'):
        replace(tool, mass=float('nan'))
