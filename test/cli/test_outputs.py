"""What a command writes: checked before any work, nothing else touched, nothing stale left."""

from dataclasses import replace
import json
import os
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


@pytest.mark.parametrize('arguments', [
    ('calibrate', 'no_bag', '--gravity', '9810'),
    ('calibrate', 'no_bag', '--gravity', 'nan'),
    ('calibrate', 'no_bag', '--gravity', '1'),
    ('calibrate', 'no_bag', '--gravity-direction', '0', '0', '0'),
    ('calibrate', 'no_bag', '--cutoff', '0'),
    ('calibrate', 'no_bag', '--cutoff', '3'),
    ('calibrate', 'no_bag', '--accelerometer-position', '30', '5', '120'),
    ('calibrate', 'no_bag', '--topic', 'wrench'),
    ('calibrate', 'no_bag', '--topic', 'wrench=/wrench', '--topic', 'wrench=/ft/wrench'),
    ('calibrate', 'no_bag', '--jobs', '0'),
    ('calibrate', 'no_bag', '--jobs', '2', '--dask', 'tcp://host:8786'),
    ('calibrate', 'no_bag', '--dask', 'host'),
    ('calibrate', 'no_bag', 'no_bag', '-o', 'out'),
    ('calibrate', 'no_bag', '-o', '/proc/calibration.yaml'),
    ('calibrate', 'no_bag', '-o', 'no/calibration.yaml'),
    ('calibrate', 'no_bag', '-o', 'folder'),
    ('calibrate', 'no_bag', '-o', ''),
    ('calibrate', 'file', '-o', 'file'),
    ('calibrate', 'no_bag', '--matrix', 'file', '-o', 'folder/../file'),
    ('calibrate', 'folder', '-o', 'folder/metadata.yaml'),
    ('calibrate', 'no_bag', '-o', 'socket'),
    ('calibrate', 'no_bag', '-o', 'x', '-o', 'y'),
    ('calibrate', 'no_bag', '--robot', ''),
    ('calibrate', 'no_bag', '--gravity', '9,81'),
    ('calibrate', 'no_bag', 'folder/../no_bag', '-o', 'out'),
    ('diagnose', 'no_bag', '-o', 'x', '--rig', ''),
    ('estimate', 'no_bag', '--calibration', '', '-o', 'x'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', 'file'),
    ('plan', '-o', 'x', '--for', 'calibration', '--duration', '1e9'),
    ('plan', '-o', 'x', '--set', 'limits.speed=0.1', '--set', 'limits.speed=0.2'),
    ('play', ''),
    ('record', '-o', 'folder/metadata.yaml'),
    ('calibrate', 'no_bag', '-o', 'x', '--report', 'x'),
    ('calibrate', 'no_bag', '-o', '-', '--json'),
    ('calibrate', 'no_bag', '-o', 'stdout', '--json'),
    ('calibrate', 'no_bag', 'other', '-o', '-'),
    ('calibrate', 'no_bag', 'other', '-o', 'no/out'),
    ('calibrate', '@list', '-o', 'out'),
    ('calibrate', '@no_list', '-o', 'out'),
    ('calibrate', '@binary', '-o', 'out'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', '-'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', 'pipe'),
    ('estimate', 'folder/in', '--calibration', 'no.yaml', '-o', 'folder'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', '.'),
    ('estimate', 'folder', 'file', '--calibration', 'no.yaml', '-o', '.'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', 'x', '--bandwidth', '-3'),
    ('estimate', 'no_bag', '--calibration', 'no.yaml', '-o', 'x', '--bandwidth', '9',
     '--filter', 'newton'),
    ('estimate', 'no_bag', '-o', 'x', '--payload', '1', '--orientation', 'pose'),
    ('simulate', '--commands', 'no_bag', '-o', 'x', '--seed', '-1'),
    ('simulate', '--commands', 'no_bag', '-o', 'no/x'),
    ('demo', '--seed', '-1'),
    ('demo', '--out', 'file'),
    ('diagnose', 'no_bag', '-o', 'file'),
    ('diagnose', 'no_bag', '-o', 'x', '--heldout', 'folder/../no_bag'),
    ('plan', '-o', '-', '--json'),
    ('insitu', 'no.yaml', '-o', '/proc/x'),
    ('fit-rig', 'no_bag', 'other', '--for', 'impedance', '-o', 'x'),
    ('diagnose', 'no_bag', '--check'),
    ('check', 'no_bag', '--preset', 'scara'),
    ('export', 'file', '--for', 'ur', '-o', 'file'),
    ('export', 'no.yaml', '--for', 'ur', '--sensor-in-flange', *'0000000'),
    ('export', 'no.yaml', '--for', 'kth', '--sensor-in-flange', *'0000001'),
    ('export', 'no.yaml', '--for', 'kth', '--node', 'node'),
    ('export', 'no.yaml', '--for', 'admittance', '--node', 'a node'),
    ('export', 'no.yaml', '--for', 'broadcaster', '--base-frame', 'world'),
    ('export', 'no.yaml', '--for', 'admittance', '--base-frame', ''),
    ('import', 'no.yaml', '-o', 'no/x'),
    ('record', '-o', 'x', '--duration', '-5'),
    ('record', '-o', 'x', '--only', '--all', '/wrench'),
    ('record', '-o', 'x', 'a topic'),
    ('play', 'no_bag', '--rate', '0'),
    ('play', 'no_bag', '--namespace', 'a name'),
    ('play', 'no_bag', '--only', '/wrench/'),
    ('play', 'no_bag', '--delay', '-1'),
], ids=' '.join)
def test_what_cannot_be_right_is_found_before_the_data_are_looked_at(
        capsys, tmp_path, monkeypatch, arguments):
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
    status = status_of(arguments)
    out, err = capsys.readouterr()
    assert status == 2 and out == ''
    assert err.startswith('forcecal') and err.count('\n') == 1
    assert everything_in(tmp_path) == before


def test_a_single_file_goes_to_standard_output_alone(capfd, bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['calibrate', str(bag), '-o', 'c.yaml']) == 0
    table = capfd.readouterr().out
    assert 'written to c.yaml' in table
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


def test_a_pipe_takes_what_a_command_writes_and_stays(bag, tmp_path, capsys):
    os.mkfifo(tmp_path / 'pipe')
    heard = []
    reader = Thread(target=lambda: heard.append((tmp_path / 'pipe').read_text()),
                    daemon=True)  # where nothing is written, it waits for ever
    reader.start()
    assert main(['calibrate', str(bag), '-o', str(tmp_path / 'pipe')]) == 0
    reader.join()
    assert float(parse(heard[0], 'pipe').mass) > 0
    assert stat.S_ISFIFO((tmp_path / 'pipe').lstat().st_mode)
    capsys.readouterr()


def test_a_recording_named_through_its_parent_has_its_result_in_the_folder_named(
        bag, tmp_path, monkeypatch, capsys):
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
    capsys.readouterr()


def test_a_name_as_long_as_they_may_be_is_written(brief, tmp_path, capsys):
    place = tmp_path / ('é' * 120 + '.yaml')
    for _ in range(2):  # the second keeps the first
        assert status_of(['export', brief / 'c.yaml', '--for', 'ur', '-o', place]) == 0
    assert sorted(os.listdir(tmp_path)) == [place.name, place.name + '~']
    capsys.readouterr()


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
