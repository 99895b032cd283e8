"""Every command over damaged recordings: an answer, or one line and status 1; no traceback."""

from dataclasses import replace
import shutil

from bag_samples import copy_bag, START_NS, STORE, wrench_message, write_messages
from calibration_runs import brief_run
from forcecal_ros.cli.main import main
from forcecal_ros.core.streams import Phase, Stream
from forcecal_ros.io.bags import write_recording
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
from insitu_leg import Leg, PROTOCOL, record
from leg_files import write_leg
from longer import but, first
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin

MCAP, SQLITE3 = StoragePlugin.MCAP, StoragePlugin.SQLITE3
KINDS = {'mcap': (MCAP, CompressionMode.NONE), 'chunks': (MCAP, CompressionMode.STORAGE),
         'sqlite3': (SQLITE3, CompressionMode.NONE)}


@pytest.fixture(scope='module')
def folder(tmp_path_factory, brief):
    folder = tmp_path_factory.mktemp('damage')
    shutil.copy(brief / 'c.yaml', folder)
    return folder


@pytest.fixture(scope='module')
def recording():
    return brief_run()


@pytest.fixture(scope='module')
def source(brief):
    return brief / 'bag'


@pytest.fixture(scope='module', params=but(KINDS, ['chunks']))
def intact(request, folder, source):
    path = copy_bag(source, folder / request.param, *KINDS[request.param])
    return next(file for file in path.iterdir() if file.suffix != '.yaml')


def commands(folder, bag):
    return (['calibrate', bag, '-o', folder / 'out.yaml'],
            ['calibrate', bag, '-o', folder / 'out.yaml', '--coupling', 'ac'],
            ['estimate', bag, '--calibration', folder / 'c.yaml', '-o', folder / 'estimated'],
            ['estimate', bag, '--filter', 'static', '-o', folder / 'compensated'],
            ['check', bag],
            ['simulate', '--commands', bag, '-o', folder / 'simulated'],
            ['fit-rig', bag, '--for', 'impedance', '-o', folder / 'plant.yaml'])


def answers_or_one_line(capsys, arguments):
    """Run one command; return its status and what it said."""
    status = main([str(argument) for argument in arguments])
    out, said = capsys.readouterr()
    assert status in (0, 1), said
    if status == 1:
        assert said.startswith('forcecal: ') and len(said.strip().splitlines()) == 1, said
    return status, out + said


@settings(max_examples=4, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_files_cut_short_or_with_flipped_bits(capsys, folder, intact, data):
    content = bytearray(intact.read_bytes())
    if data.draw(st.booleans()):
        content = content[:data.draw(st.integers(0, len(content) - 1))]
    for bit in data.draw(st.lists(st.integers(0, max(0, 8 * len(content) - 1)), max_size=6)):
        if content:
            content[bit // 8] ^= 1 << bit % 8
    path = folder / f'bad{intact.suffix}'
    path.write_bytes(content)
    answers_or_one_line(capsys, data.draw(st.sampled_from(commands(folder, path))))


@pytest.fixture(scope='module')
def legs(folder):
    """Return the file of a leg's log, and what it holds, by kind."""
    files = {}
    for kind in ('csv', 'mcap'):
        (folder / f'leg {kind}').mkdir()
        files[kind] = write_leg(folder / f'leg {kind}', record(
            PROTOCOL[0], Leg(duration=20.0), 1), kind)
    return {kind: (path, path.read_bytes()) for kind, path in files.items()}


@pytest.mark.parametrize('kind', [pytest.param('csv', marks=pytest.mark.long), 'mcap'])
@settings(max_examples=8, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_logs_of_a_leg_cut_short_or_garbled(capsys, folder, legs, kind, data):
    path, whole = legs[kind]
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(0, 3))):
        at = data.draw(st.integers(0, len(content)))
        content[at:at + data.draw(st.integers(0, 200))] = data.draw(st.binary(max_size=40))
    content = content[:data.draw(st.integers(0, len(content)) | st.just(len(content)))]
    path.write_bytes(content)
    status, said = answers_or_one_line(capsys, [
        'insitu', folder / f'leg {kind}' / 'leg.yaml', '-o', folder / 'insitu', '--quiet'])
    assert status == 0 or content != whole, said


def thinned(stream, keep):
    return replace(stream, t=stream.t[keep], values=stream.values[keep])


def absurd(values):
    values = np.array(values)
    values[::50] = np.resize([np.nan, np.inf, -np.inf, 1e308, 1e12], values[::50].shape)
    return values


BROKEN = {
    'one wrench': lambda r: replace(r, wrench=thinned(r.wrench, slice(1))),
    'no wrench': lambda r: replace(r, wrench=None),
    'no pose': lambda r: replace(r, pose=None),
    'no commands': lambda r: replace(r, target=None),
    'two of the accelerometer': lambda r: replace(
        r, accelerometer=thinned(r.accelerometer, slice(2))),
    'accelerometer at 5 Hz': lambda r: replace(
        r, accelerometer=thinned(r.accelerometer, slice(None, None, 50))),
    'half the recording': lambda r: replace(r, wrench=thinned(r.wrench, slice(1000))),
    'absurd wrenches': lambda r: replace(r, wrench=Stream(r.wrench.t, absurd(r.wrench.values))),
    'absurd slides': lambda r: replace(
        r, optidrive=Stream(r.optidrive.t, absurd(r.optidrive.values))),
    'absurd volts': lambda r: replace(
        r, accelerometer=Stream(r.accelerometer.t, absurd(r.accelerometer.values))),
    'phases of no length': lambda r: replace(r, phases=tuple(
        Phase(p.name, 1e-3 * p.start, 1e-3 * p.end) for p in r.phases)),
    'no phases': lambda r: replace(r, phases=()),
    'only contact': lambda r: replace(r, phases=(Phase('contact', 0.0, 9.0),)),
}


@pytest.mark.parametrize('name', first(BROKEN))
def test_recordings_that_lack_or_twist_something(capsys, folder, source, recording, name):
    bag = folder / 'broken'
    write_recording(bag, BROKEN[name](recording))
    for arguments in commands(folder, bag)[:3]:
        answers_or_one_line(capsys, arguments)


@pytest.mark.parametrize('name, against', [
    ('one wrench', 'model'), pytest.param('one wrench', 'calibration', marks=pytest.mark.long),
    pytest.param('half the recording', 'calibration', marks=pytest.mark.long)])
def test_diagnosis_answers_or_says_what_is_invalid(
        capsys, folder, source, recording, name, against):
    bag = folder / 'broken'
    write_recording(bag, BROKEN[name](recording))
    known = (['--rig', 'nominal'] if against == 'model'
             else ['--calibration', str(folder / 'c.yaml')])
    status = main(['diagnose', str(bag), '-o', str(folder / 'diagnosis'), *known])
    out, err = capsys.readouterr()
    assert all(line.startswith('forcecal: ') for line in err.splitlines()), err
    assert status in (0, 1) and out.startswith('invalid_data: ') is (status == 1)
    assert 'invalid_data' not in err


@pytest.mark.long
def test_messages_out_of_order_with_stamps_that_come_twice(capsys, folder, source):
    with Reader(source) as reader:
        messages = [(connection.topic, log_ns, STORE.deserialize_cdr(data, connection.msgtype))
                    for connection, log_ns, data in reader.messages()]
    rng = np.random.default_rng(0)
    order = np.argsort(np.arange(len(messages)) + rng.uniform(0, 30, len(messages)))
    twice = np.repeat(order, 1 + (np.arange(len(order)) % 40 == 0))
    write_messages(folder / 'twice', [messages[i] for i in twice])
    status, said = answers_or_one_line(capsys, commands(folder, folder / 'twice')[0])
    assert status == 0, said


def test_no_messages_and_two_types_on_one_topic(capsys, folder, source):
    write_messages(folder / 'empty', [])
    message = wrench_message(START_NS, range(6))
    text = STORE.types['std_msgs/msg/String']('x')
    write_messages(folder / 'mixed', [('/wrench', START_NS, message), ('/wrench', START_NS, text)])
    for arguments in commands(folder, folder / 'empty'):
        assert answers_or_one_line(capsys, arguments)[0] == 1
    for arguments in commands(folder, folder / 'mixed'):
        status, said = answers_or_one_line(capsys, arguments)
        assert status == 1 or 'std_msgs/msg/String' in said
