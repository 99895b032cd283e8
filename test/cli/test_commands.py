"""What a user types first, and what scripts rely on: check, init, --debug, --fail-on."""

from dataclasses import replace
import json
import os
import re
import shlex
import subprocess
import sys

from calibration_runs import brief_run
from forcecal_ros.cli.check import as_text, inspect
from forcecal_ros.cli.common import as_started
from forcecal_ros.cli.diagnose import _likewise
from forcecal_ros.cli.main import main, parse
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import rotation_from_vector
from forcecal_ros.core.streams import Stream
from forcecal_ros.diagnose.dataset import require_wrench_and_pose
from forcecal_ros.io.bags import write_recording
from forcecal_ros.io.calibration_file import load, save
import numpy as np
import pytest
import yaml


@pytest.fixture(scope='module')
def recording():
    return brief_run()


@pytest.mark.parametrize('options', [
    ['--bandwidth-max', '1'], ['--bandwidth-min', '300'], ['--bandwidth-min', '9', '--debug',
                                                           '--bandwidth-max', '1']])
def test_a_bandwidth_beyond_the_limits_is_one_line_and_a_traceback_only_on_request(
        brief, tmp_path, capsys, options):
    assert main(['calibrate', str(brief / 'bag'), '-o', str(tmp_path / 'c.yaml'),
                 *options]) in (1, 2)
    said = capsys.readouterr().err
    assert ('Traceback' in said) is ('--debug' in options)
    line = said.splitlines()[-1]
    assert line.startswith('forcecal: ') and 'bandwidth' in line and not list(tmp_path.iterdir())


def test_check_shows_what_is_there_and_the_next_command(brief, capsys):
    assert main(['check', str(brief / 'bag')]) == 0
    said = capsys.readouterr().out
    row = next(line.split() for line in said.splitlines() if line.startswith('pose'))
    assert row[1:5] == ['/current_pose', 'PoseStamped', '250', 'Hz'] and row[-1] == 'base'
    assert 'calibrate: yes' in said and 'diagnose: yes, against a model\n' in said
    assert 'wrench sign: 1, environment on tool' in said
    assert f'next: forcecal calibrate {brief / "bag"} --report report.html' in said
    assert f'or: forcecal diagnose {brief / "bag"} -o diagnosis' in said


def test_check_states_lengths_and_gaps_in_handy_units_and_what_a_mass_is_from(brief, capsys):
    assert main(['check', str(brief / 'bag'), '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert re.search(r'\ntool: 1\d(\.\d+)? kg from \d static poses; frame', as_text(document))
    document['motion']['range_m'] = [0.0861, 0.000146, 0.000141]
    document['estimates']['poses'] = 0
    document['streams']['wrench']['longest_gap'] = 1.3
    said = as_text(document)
    assert ', moves by 86 x 0.15 x 0.14 mm' in said
    assert ' kg from the motion (no static poses); frame' in said
    assert re.search(r'\nwrench .* 1\.30 s ', said)


def test_commands_begin_as_the_program_was_started(monkeypatch):
    text = 'next: forcecal check a/forcecal check; forcecal fit-rig --help, forcecal_ros'
    assert as_started(text) == text
    monkeypatch.setenv('FORCECAL_COMMAND', r'./a\ b/run')
    assert as_started(text) == (r'next: ./a\ b/run check a/forcecal check; ./a\ b/run fit-rig '
                                '--help, forcecal_ros')


@pytest.mark.parametrize('change, expected', [
    pytest.param(lambda r: replace(r, target=None, contact_truth=None), [
        'diagnose with a simulator: no: no commands',
        '--calibration calibration.yaml -o diagnosis'], marks=pytest.mark.long),
    pytest.param(lambda r: replace(r, contact_truth=None), ['--simulated SIM_BAG -o diagnosis'],
                 marks=pytest.mark.long),
    (lambda r: replace(r, pose=None, target=None), [
        'neither a pose nor an IMU was recorded', 'fit-rig: no: no target_frame and no pose was',
        'wrench sign: not identifiable',
        'next: record current_pose\n'])])
def test_check_says_what_cannot_be_done_and_why(tmp_path, recording, capsys, change, expected):
    write_recording(tmp_path / 'bag', change(recording))
    assert main(['check', str(tmp_path / 'bag')]) == 0
    said = capsys.readouterr().out
    assert all(one in said for one in expected), said


R = rotation_from_vector([0.0, 0.0, np.pi / 2])
TILT = rotation_from_vector([0.3, 0.0, 0.0])


def turned_and_tilted(r):
    return replace(r, wrench=replace(r.wrench, values=r.wrench.values @ np.kron(np.eye(2), R).T),
                   pose=replace(r.pose, R_base_sensor=TILT @ r.pose.R_base_sensor,
                                position=r.pose.position @ TILT.T))


@pytest.mark.parametrize('change, options, sign', [
    (lambda r: replace(r, wrench=replace(r.wrench, values=-r.wrench.values)),
     [['--wrench-sign'], ['--gravity-direction']], -1),
    (turned_and_tilted, [['--sensor-rotation', '--gravity-direction']], None)])
def test_the_command_after_a_fault_corrects_it(tmp_path, recording, capsys, change, options,
                                               sign):
    write_recording(tmp_path / 'bag', change(recording))
    assert main(['check', str(tmp_path / 'bag'), '--json']) == 1
    document = json.loads(capsys.readouterr().out)
    assert document['wrench_sign'] == sign and set(document['uses'].values()) == {
        'see the fault above'}
    commands = [shlex.split(one) for one in document['next']]
    assert [[word for word in words if word.startswith('--') and word != '--report']
            for words in commands] == options
    words = commands[0][1:commands[0].index('--report')]
    assert main([*words, '-o', str(tmp_path / 'c.yaml')]) == 0


def in_base(r):
    values = np.einsum('nij,nkj->nki', r.pose.R_base_sensor, r.wrench.values.reshape(-1, 2, 3))
    return values.reshape(-1, 6)


@pytest.mark.parametrize('values, fault, remedy', [
    (in_base, '', 'configure the driver to publish in the sensor frame, and record again'),
    (lambda r: 0 * r.wrench.values + 1.0, 'never change',
     'check the sensor, its cable and its driver, and record again')])
def test_a_fault_without_an_option_has_its_remedy_next(
        tmp_path, recording, capsys, values, fault, remedy):
    write_recording(tmp_path / 'bag', replace(recording, wrench=Stream(
        recording.wrench.t, values(recording))))
    assert main(['check', str(tmp_path / 'bag'), '--json']) == 1
    document = json.loads(capsys.readouterr().out)
    assert fault in document['fault'] and document['next'] == [remedy]


@pytest.mark.parametrize('scale', [
    pytest.param(None, id='wrench', marks=pytest.mark.long), pytest.param(2.0, id='raw channels')])
def test_removed_samples_reach_the_calibration_and_its_report(
        brief, tmp_path, recording, scale):
    values = recording.wrench.values / (scale or 1.0)
    values[1000:1003] = np.nan
    matrix = []
    if scale:
        save(replace(load(brief / 'c.yaml'), matrix=Estimate(scale * np.eye(6), 0.0, '1'),
                     matrix_offset=Estimate(np.zeros(6), 0.0, '1')), tmp_path / 'six.yaml')
        matrix = ['--matrix', str(tmp_path / 'six.yaml')]
    write_recording(tmp_path / 'bag', replace(recording, wrench=replace(
        recording.wrench, values=values)))
    assert main(['calibrate', str(tmp_path / 'bag'), '-o', str(tmp_path / 'c.yaml'),
                 '--report', str(tmp_path / 'r.html'), *matrix]) == 0
    assert load(tmp_path / 'c.yaml').quality['removed_samples'] == {'wrench': 3}
    assert 'Samples left out' in (tmp_path / 'r.html').read_text()


@pytest.mark.long
def test_compare_fails_on_drift_if_requested(brief, tmp_path):
    c = load(brief / 'c.yaml')
    save(replace(c, mass=Estimate(float(c.mass) + 1.0, c.mass.std, 'kg')), tmp_path / 'b.yaml')
    pair = [str(brief / 'c.yaml'), str(tmp_path / 'b.yaml')]
    assert main(['compare', *pair]) == 0
    assert main(['compare', *pair, '--fail-on', 'drift']) == 3
    assert main(['compare', pair[0], pair[0], '--fail-on', 'drift']) == 0


def test_a_few_samples_are_enough_for_a_calibration_and_not_for_a_comparison(recording):
    few = replace(recording, wrench=recording.wrench.rows(slice(0, None, 300)))
    assert len(few.wrench) < 100
    assert 'samples of the wrench are too few' in inspect(few)['uses']['diagnose']
    with pytest.raises(DataError, match='too few for a comparison; record 15 s of motion'):
        require_wrench_and_pose(few, '')


def test_a_change_half_way_spoils_a_calibration_alone(recording):
    wrench = recording.wrench
    after = wrench.t > np.median(wrench.t)
    jump = np.outer(after, [30.0, -20.0, 10.0, 0.0, 0.0, 0.0])
    found = inspect(replace(recording, wrench=replace(wrench, values=wrench.values + jump)))
    assert 'the bias changed' in found['fault'] == found['uses']['calibrate']
    assert found['uses']['estimate'] == '' == found['uses']['diagnose']


@pytest.mark.parametrize('robot', ['ur', 'franka', 'kuka_fri', 'broadcaster'])
def test_init_writes_every_parameter_of_a_preset_with_its_meaning(tmp_path, capsys, robot):
    pytest.importorskip('rclpy')
    from forcecal_ros.nodes.config import TABLES
    from forcecal_ros.nodes.sequencer import settings_of

    path = tmp_path / 'my_cell.yaml'
    assert main(['init', '--preset', robot, '--namespace', '/left', '--offline',
                 '-o', str(path)]) == 0
    printed = capsys.readouterr()
    assert f'namespace:=left robot:={robot}' in printed.out
    assert ('--controller' in printed.err) is (robot != 'kuka_fri')
    text = path.read_text()
    written = yaml.safe_load(text)
    sequencer = written['/**/sequencer']['ros__parameters']
    assert sequencer['motion']['require_preview'] is True
    assert sequencer['accelerometer']['source'] == 'none'
    assert len(sequencer['poses']['values']) == 7 * len(sequencer['poses']['names'])
    assert written['/**/observer']['ros__parameters']['accelerometer']['source'] == 'none'
    assert text.count('    # ') > 100
    # what nobody has measured is refused by the sequencer until it is set
    assert np.isnan(sequencer['limits']['workspace_min']).all()
    with pytest.raises(ConfigError, match='workspace_min is .*finite .*; edit the lines .* # SET'):
        settings_of({row.name: row.default for row in TABLES['sequencer'][0]}
                    | {'limits.workspace_min': sequencer['limits']['workspace_min']})
    assert ('backend: target_frame  # SET' in text) is (robot != 'kuka_fri')


@pytest.mark.parametrize('line, expected', [
    ('forcecal ch', 'check'), ('forcecal check --wr', '--wrench-sign'),
    ('forcecal estimate --filter n', 'newton')])
def test_a_shell_completes_commands_options_and_choices(tmp_path, line, expected):
    found = tmp_path / 'found'
    subprocess.run([sys.executable, '-m', 'forcecal_ros.cli.main'], check=True, env={
        **os.environ, '_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': ' ', 'COMP_LINE': line,
        'COMP_POINT': str(len(line)), '_ARGCOMPLETE_STDOUT_FILENAME': str(found)})
    assert found.read_text().strip() == expected


def test_the_command_for_the_next_recording_repeats_what_was_stated():
    stated = ['--simulated', 'sim', '--tolerance', '0.1', '--simulated-wrench-sign', '1']
    assert list(_likewise(parse(['diagnose', 'bag', '-o', 'out', *stated]))) == stated
    assert not _likewise(parse(['diagnose', 'bag', '-o', 'out']))
