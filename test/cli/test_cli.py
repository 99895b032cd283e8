"""The command line as its user meets it: results on stdout, one line of complaint, statuses."""

from dataclasses import replace
import json
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import forcecal_ros
from forcecal_ros.cli import COMMANDS
from forcecal_ros.cli.main import build_parser, main
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.streams import Stream
from forcecal_ros.core.topics import ROLES
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import load, save
import numpy as np
import pytest

PACKAGE = Path(forcecal_ros.__file__).parent


def run(capsys, *arguments):
    """Return status, stdout and stderr of one command."""
    try:
        status = main([str(a) for a in arguments])
    except SystemExit as stop:
        status = stop.code
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture(scope='module')
def sample(brief):
    return brief / 'bag'


@pytest.fixture(scope='module')
def calibration(brief):
    return brief / 'c.yaml'


def test_json_is_what_the_file_says_and_the_report_has_its_pictures(brief, calibration):
    document = json.loads((brief / 'c.json').read_text())
    assert document['mass']['value'] == float(load(calibration).mass)
    assert document['format'] == 'forcecal-calibration/1'
    assert np.shape(document['observer']['K']['value']) == (2, 3)
    assert document['observer']['K']['value'][1][2] == 1
    assert (brief / 'c.html').read_text().count('<img') == 5


def test_raw_channels_are_calibrated_and_observed_through_their_matrix(
        capsys, sample, calibration, tmp_path):
    matrix = np.eye(6) + 0.1 * np.random.default_rng(2).standard_normal((6, 6))
    offset = np.arange(6.0)
    recording = read_recording(sample)
    wire = recording.wrench
    write_recording(tmp_path / 'raw', replace(recording, wrench=Stream(
        wire.t, wire.values @ np.linalg.inv(matrix).T + offset, wire.frame)))
    save(replace(load(calibration), matrix=Estimate(matrix, 0.0, 'N, N m per count'),
                 matrix_offset=Estimate(offset, 0.0, 'count')), tmp_path / 'six.yaml')
    assert run(capsys, 'calibrate', tmp_path / 'raw', '--matrix', tmp_path / 'six.yaml',
               '-o', tmp_path / 'c.yaml')[0] == 0
    found, direct = load(tmp_path / 'c.yaml'), load(calibration)
    assert float(found.mass) == pytest.approx(float(direct.mass), rel=1e-6)
    np.testing.assert_allclose(found.matrix.value, matrix)
    outs = []
    for bag, c in ((tmp_path / 'raw', tmp_path / 'c.yaml'), (sample, calibration)):
        assert run(capsys, 'estimate', bag, '--calibration', c, '-o', tmp_path / 'o')[0] == 0
        outs.append(read_recording(tmp_path / 'o', {'wrench': '/observer/contact_wrench'}))
    np.testing.assert_allclose(outs[0].wrench.values, outs[1].wrench.values, atol=1e-4)


def test_a_terminal_that_lacks_a_letter_shows_another(calibration, tmp_path):
    done = subprocess.run(
        [sys.executable, '-m', 'forcecal_ros.cli.main', 'export', calibration, '--for', 'ur',
         '-o', tmp_path / 'Länge.yaml'], env={**os.environ, 'PYTHONIOENCODING': 'ascii'},
        capture_output=True, check=False)
    assert done.returncode == 0 and not done.stderr
    assert done.stdout.endswith(b'L?nge.yaml\n') and (tmp_path / 'Länge.yaml').exists()


def test_a_full_device_is_told_from_a_wrong_path(calibration):
    with open('/dev/full', 'w') as full:  # noqa: PTH123 - a device
        done = subprocess.run(
            [sys.executable, '-m', 'forcecal_ros.cli.main', 'export', calibration, '--for', 'ur'],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == 'forcecal: No space left on device; free some space [FC0004]\n'


def test_what_was_there_is_kept(capsys, sample, tmp_path):
    out = tmp_path / 'simulated'
    out.mkdir()
    (out / 'precious').write_text('data')
    assert run(capsys, 'simulate', '--commands', sample, '-o', out)[0] == 0
    assert (tmp_path / 'simulated~' / 'precious').read_text() == 'data'


@pytest.mark.parametrize('arguments', [
    ('calibrate', '/nowhere'),
    ('calibrate', '{sample}', '--topic', 'wrench=/no/such/topic'),
    ('estimate', '{sample}', '--calibration', '/nowhere.yaml', '-o', '{tmp}/out'),
    ('estimate', '{sample}', '--calibration', '{sample}/metadata.yaml', '-o', '{tmp}/out'),
    ('simulate', '--commands', '{sample}', '--rig', '/nowhere.yaml', '-o', '{tmp}/out'),
    ('simulate', '--commands', '{empty}', '-o', '{tmp}/out'),
])
def test_what_cannot_be_answered_is_one_line_and_status_1(capsys, sample, tmp_path, arguments):
    (tmp_path / 'empty').mkdir()
    filled = [a.format(sample=sample, tmp=tmp_path, empty=tmp_path / 'empty') for a in arguments]
    status, out, err = run(capsys, *filled)
    assert status == 1 and out == ''
    assert err.startswith('forcecal: ') and err.count('\n') == 1
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('arguments, said', [
    (('dance',), 'forcecal: dance is not a command; forcecal --help'),
    (('calibrat', 'bag'), 'calibrat is not a command (did you mean calibrate?)'),
    (('fit_rig',), '(did you mean fit-rig?)'),
    (('calibrate',), 'forcecal calibrate: the following arguments are required: BAG'),
    (('estimate', 'bag'), 'required: -o'),
    (('calibrate', 'bag', '--gravty', '9.8'), ('--gravty is not an argument here (did you mean '
                                               '--gravity?); forcecal calibrate --help')),
    (('estimate', 'bag', '-o', 'x', '--track_tool=1'), '(did you mean --track-tool?)'),
    (('play', 'bag', 'another'), 'another is not an argument here;'),
    (('calibrate', 'bag', '--topic', 'wrnch=/w'), 'wrnch is not a role (did you mean wrench?)'),
    (('estimate', 'bag', '-o', 'x', '--filter', 'uk'), "invalid choice: 'uk'"),
    (('sim', 'bag'), 'sim is not a command (did you mean simulate?)'),
    (('plan', '--effects', 'magic', '-o', 'p'), 'magic is not an effect; choose one of wrench'),
    (('--verbose', 'calibrate', 'bag'), '--verbose is not an argument here; forcecal --help'),
])
def test_wrong_usage_is_status_2_and_one_line_with_the_nearest_name(capsys, arguments, said):
    status, out, err = run(capsys, *arguments)
    assert status == 2 and out == ''
    assert said in err and err.count('\n') == 1 and err.endswith(' --help shows more [FC0001]\n')


@pytest.mark.parametrize('arguments, said', [
    (('calibrate', 'a', 'b', '-o', '{tmp}/c.yaml'), (2, 'several BAGs require a folder, not ')),
    (('compare', '{tmp}/spec.yaml', '{tmp}/spec.yaml'),
     (1, 'is not a calibration (format forcecal-insitu/1, expected forcecal-calibration/1)')),
    (('simulate', '--commands', '{sample}', '--rig', '{tmp}/spec.yaml', '-o', '{tmp}/s'),
     (1, "has format 'forcecal-insitu/1', which is not supported here; compare"))])
def test_a_file_of_another_kind_is_called_what_it_is(capsys, sample, tmp_path, arguments, said):
    (tmp_path / 'spec.yaml').write_text('format: forcecal-insitu/1\n')
    status, out, err = run(capsys, *(a.format(tmp=tmp_path, sample=sample) for a in arguments))
    assert (status, out) == (said[0], '') and said[1] in err and err.count('\n') == 1
    assert [*tmp_path.iterdir()] == [tmp_path / 'spec.yaml']


def test_a_default_is_shown_once_with_its_unit(capsys):
    for command in COMMANDS:
        _, out, _ = run(capsys, command, '--help')
        assert '(default: )' not in out and not re.search(r'default: [\d.]+\.0\b', out), command
    said = ' '.join(run(capsys, 'start', '--help')[1].split())
    assert 'for its answer (default: 10 s)' in said


def test_no_command_at_all_shows_the_help_as_wrong_usage(capsys):
    status, out, err = run(capsys)
    assert status == 2 and out == '' and err.startswith('usage: forcecal')
    assert all(f' {command} ' in err or f' {command}\n' in err for command in COMMANDS)


@pytest.mark.parametrize('command', COMMANDS)
def test_help_shows_an_example(capsys, command):
    status, out, _ = run(capsys, command, '--help')
    assert status == 0 and f'example:\n  forcecal {command}' in out
    for example in re.findall(r'^  forcecal (.*)$', out.partition('example:')[2], re.MULTILINE):
        build_parser(command).parse_args(shlex.split(example, comments=True))


def test_advice_names_options_and_roles_that_there_are():
    of_others = {'--ros-args', '--params-file', '--show-args', '--system-site-packages'}
    options = {'--version', *of_others}.union(*(
        build_parser(command).commands[command].options for command in COMMANDS))
    for file in {*PACKAGE.rglob('*.py')}:
        text = file.read_text()
        assert {*re.findall(r'(?<![\w-])--[a-z][\w-]*', text)} <= options, file
        assert {*re.findall(r'--topic (\w+)=', text)} <= {*ROLES, 'role'}, file


def test_help_loads_nothing_that_computes_or_speaks_ros():
    code = ('import sys\nfrom forcecal_ros.cli.main import main\ntry: main({})\n'
            'except SystemExit: print(sorted({{"numpy", "scipy", "rclpy"}} & {{*sys.modules}}))')
    for arguments in (['--help'], ['calibrate', '--help']):
        said = subprocess.run([sys.executable, '-c', code.format(arguments)], check=True,
                              capture_output=True, text=True).stdout
        assert said.splitlines()[-1] == '[]'
