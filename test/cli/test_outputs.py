"""What a command writes: checked before any work, nothing else touched, nothing stale left."""

from dataclasses import replace
import json
import os
import shlex
from shutil import copytree
import stat
import subprocess
import sys
from threading import Thread

from forcecal_ros.cli.main import main
from forcecal_ros.core.files import write_results
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import load, parse
import pytest


@pytest.fixture(scope='module')
def bag(brief):
    return brief / 'bag'


def status_of(arguments):
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return stop.code


def everything_in(folder):
    """Return every name in a folder, with kind, time of change and content."""
    return {path: (path.lstat().st_mode, path.lstat().st_mtime_ns,
                   path.read_bytes() if path.is_file() else None) for path in folder.rglob('*')}


WRONG = {
    'calibrate no_bag': (
        '--gravity 9810', '--gravity nan', '--gravity 1', '--gravity 9,81',
        '--gravity-direction 0 0 0', '--cutoff 0', '--cutoff 3',
        '--accelerometer-position 30 5 120', '--topic wrench',
        '--topic wrench=/wrench --topic wrench=/ft/wrench', '--jobs 0',
        '--jobs 2 --dask tcp://host:8786', '--dask host', '--matrix file -o folder/../file',
        'no_bag -o out', 'folder/../no_bag -o out', 'other -o -', 'other -o no/out',
        '-o /proc/calibration.yaml', '-o no/calibration.yaml', '-o folder', '-o socket',
        '-o x -o y', '-o x --report x', '-o - --json', '-o stdout --json', "-o ''", "--robot ''"),
    'calibrate': ('file -o file', 'folder -o folder/metadata.yaml', '@list -o out',
                  '@no_list -o out', '@binary -o out'),
    'estimate no_bag --calibration no.yaml': (
        '-o file', '-o -', '-o pipe', '-o .', '-o x --bandwidth -3',
        '-o x --bandwidth 9 --filter newton'),
    'estimate': ("no_bag --calibration '' -o x", 'folder/in --calibration no.yaml -o folder',
                 'folder file --calibration no.yaml -o .',
                 'no_bag -o x --payload 1 --orientation pose'),
    'diagnose no_bag': ('-o file', "-o x --rig ''", '-o x --heldout folder/../no_bag', '--check'),
    'plan': ('-o x --for calibration --duration 1e9', '-o - --json',
             '-o x --set limits.speed=0.1 --set limits.speed=0.2'),
    'simulate --commands no_bag': ('-o x --seed -1', '-o no/x'),
    'demo': ('--seed -1', '--out file'),
    'export no.yaml --for': (
        'ur --sensor-in-flange 0 0 0 0 0 0 0', 'kth --sensor-in-flange 0 0 0 0 0 0 1',
        'kth --node node', "admittance --node 'a node'", 'broadcaster --base-frame world',
        "admittance --base-frame ''"),
    'record -o': ('folder/metadata.yaml', 'x --duration -5', 'x --only --all /wrench',
                  "x 'a topic'"),
    'play': ("''", 'no_bag --rate 0', "no_bag --namespace 'a name'", 'no_bag --only /wrench/',
             'no_bag --delay -1'),
    '': ('insitu no.yaml -o /proc/x', 'fit-rig no_bag other --for impedance -o x',
         'check no_bag --preset scara', 'export file --for ur -o file', 'import no.yaml -o no/x')}


@pytest.mark.parametrize('line', [
    f'{command} {words}' for command, wrong in WRONG.items() for words in wrong])
def test_what_cannot_be_right_is_found_before_the_data_are_looked_at(
        capsys, tmp_path, monkeypatch, line):
    # none of the inputs exists, which would be status 1
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'folder' / 'in').mkdir(parents=True)
    (tmp_path / 'file').write_text('file')
    (tmp_path / 'list').write_text('# nothing\n\n')
    (tmp_path / 'binary').write_bytes(b'\xff\xfe')
    (tmp_path / 'folder' / 'metadata.yaml').write_text('of a recording')
    (tmp_path / 'stdout').symlink_to('/proc/self/fd/1')
    os.mkfifo(tmp_path / 'pipe')
    os.mknod(tmp_path / 'socket', stat.S_IFSOCK | 0o600)
    before = everything_in(tmp_path)
    status = status_of(shlex.split(line))
    out, err = capsys.readouterr()
    assert status == 2 and out == ''
    assert err.startswith('forcecal') and err.count('\n') == 1
    assert everything_in(tmp_path) == before


def test_a_single_file_goes_to_standard_output_alone(capfd, bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['calibrate', str(bag), '-o', 'c.yaml']) == 0
    table = capfd.readouterr().out
    assert 'written to c.yaml' in table
    assert all(f'residual {part} {axis} at rest' in table
               for part in ('force', 'torque') for axis in 'xyz')
    assert main(['calibrate', str(bag), '-o', '-']) == 0
    found = parse(capfd.readouterr().out, 'standard output')
    assert float(found.mass) == float(load('c.yaml').mass)
    assert main(['export', 'c.yaml', '--for', 'ur', '-o', '-']) == 0
    assert 'written' not in capfd.readouterr().out
    assert os.listdir() == ['c.yaml']


def test_a_reader_that_goes_early_is_no_error_of_the_file(brief):
    done = subprocess.run(  # noqa: S602 - a pipe, between names of this test's own
        f'{sys.executable} -m forcecal_ros.cli.main export {brief}/c.yaml --for ur -o - | true',
        shell=True, capture_output=True, text=True, check=False)
    assert 'Traceback' not in done.stderr and 'cannot be written' not in done.stderr


def test_a_pipe_takes_what_a_command_writes_and_stays(brief, tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    heard = []
    reader = Thread(target=lambda: heard.append((tmp_path / 'pipe').read_text()),
                    daemon=True)  # where nothing is written, it waits for ever
    reader.start()
    assert status_of(['export', brief / 'c.yaml', '--for', 'ur', '-o', tmp_path / 'pipe']) == 0
    reader.join()
    assert heard[0].startswith('#') and 'mass: ' in heard[0]
    assert stat.S_ISFIFO((tmp_path / 'pipe').lstat().st_mode)


def test_a_recording_named_through_its_parent_has_its_result_in_the_folder_named(
        bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'in').mkdir()
    for name in ('in/one', 'two'):
        (tmp_path / name).symlink_to(bag)
    assert status_of(['calibrate', 'in/../in/one', 'in/../two', '-o', 'out']) == 2  # one bag
    (tmp_path / 'two').unlink()
    copytree(bag, tmp_path / 'two')
    assert status_of(['calibrate', 'in/../in/one', 'in/../two', '-o', 'out']) == 0
    assert sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob('*.yaml')
                  if p.name != 'metadata.yaml') == ['out/in/one.yaml', 'out/two.yaml']


def test_a_name_as_long_as_they_may_be_is_written(brief, tmp_path):
    place = tmp_path / ('é' * 120 + '.yaml')
    for _ in range(2):  # the second keeps the first
        assert status_of(['export', brief / 'c.yaml', '--for', 'ur', '-o', place]) == 0
    assert sorted(os.listdir(tmp_path)) == [place.name, place.name + '~']


def test_results_of_an_earlier_run_are_set_aside_and_other_files_are_left(tmp_path):
    write_results(tmp_path / 'out', {'a.json': 'old', 'b.png': b'old', 'one/c.yaml': 'old'})
    (tmp_path / 'out' / 'notes.txt').write_text('mine')
    write_results(tmp_path / 'out', {'a.json': 'new'}, ['a.json', '*.png', 'one/c.yaml'])
    there = {str(path.relative_to(tmp_path / 'out')): path.read_text()
             for path in (tmp_path / 'out').rglob('*') if path.is_file()}
    assert there == {'a.json': 'new', 'a.json~': 'old', 'b.png~': 'old', 'one/c.yaml~': 'old',
                     'notes.txt': 'mine'}


@pytest.mark.parametrize('against', ['rig', 'calibration'])
def test_a_verdict_of_invalid_data_leaves_nothing_of_an_older_one(
        capsys, brief, tmp_path, against):
    recording = read_recording(brief / 'bag')
    write_recording(tmp_path / 'dead', replace(recording, wrench=replace(
        recording.wrench, values=0 * recording.wrench.values + 1.0)))
    known = ['--rig', 'nominal']
    if against == 'calibration':
        known = ['--calibration', str(brief / 'c.yaml'), '--quiet']
    out = tmp_path / 'out'
    write_results(out, dict.fromkeys(
        ('diagnosis.json', 'report.html', 'rig_patched.yaml', 'calibration_patched.yaml'),
        'identified: all is well'))
    (out / 'notes.txt').write_text('mine')
    assert main(['diagnose', str(tmp_path / 'dead'), '-o', str(out), *known]) == 1
    assert {path.name for path in out.iterdir()} == {
        'diagnosis.json', 'report.html', 'diagnosis.json~', 'report.html~', 'rig_patched.yaml~',
        'calibration_patched.yaml~', 'notes.txt'}
    document = json.loads((out / 'diagnosis.json').read_text())
    page = (out / 'report.html').read_text()
    assert document['verdict'] == 'invalid_data' and 'never change' in document['reason']
    assert '>invalid data<' in page and 'never change' in page
    assert 'identified' not in page and 'every effect' not in page
    assert ('note: reading' in capsys.readouterr().err) is (against == 'rig')
