"""Damaged recordings: what is left is read and said, or one line says why not. Nothing else."""

import struct

from bag_samples import (
    assert_same_recording,
    header,
    small_recording,
    START_NS,
    STORE,
    wrench_message,
    write_messages,
)
from damage_samples import CHUNK, damaged, KINDS, make, N, records
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.bags.header_stamps import increasing
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

MCAP, SQLITE3 = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('damage')


@pytest.fixture(scope='module', params=KINDS)
def kind(request, tmp_path_factory):
    """One intact file of each kind."""
    return make(request.param, tmp_path_factory.mktemp('kind'))


def or_one_line(read):
    """Return the recording, or None after one clear line."""
    try:
        recording = read()
    except DataError as error:
        assert '\n' not in str(error)
        return None
    for stream in (recording.wrench, recording.accelerometer, recording.pose):
        if stream is not None:
            assert (np.diff(stream.t) > 0).all()
    return recording


def read_or_one_line(path):
    return or_one_line(lambda: read_recording(path))


def test_every_kind_of_file_holds_the_same(kind):
    recording = kind.damaged(kind.content)()
    np.testing.assert_array_equal(recording.wrench.values, small_recording(N).wrench.values)
    assert recording.notes == ()


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_truncated_file_gives_a_part_or_one_line(kind, data):
    size = data.draw(st.integers(0, len(kind.content) - 1))
    recording = or_one_line(kind.damaged(kind.content[:size]))
    if recording is not None and recording.wrench is not None:
        n = len(recording.wrench)
        assert n <= N
        # the last number of a text may be cut short
        n -= kind.path.suffix == '.csv'
        np.testing.assert_array_equal(recording.wrench.values[:n],
                                      small_recording(N).wrench.values[:n])


FUZZED = 20_000
"""Damaged copies of a file of each kind that `./run test -m long` reads, other ones each time."""


@pytest.mark.parametrize('copies', [
    10, pytest.param(FUZZED, marks=[pytest.mark.long, pytest.mark.timeout(3600)])])
def test_no_damage_escapes_as_a_traceback(kind, copies):
    seed = np.random.SeedSequence().entropy if copies == FUZZED else 1
    random = np.random.default_rng(seed)
    for count in range(copies):
        read = kind.damaged(damaged(kind.content, random))
        try:
            or_one_line(read)
        except Exception as error:
            raise AssertionError(f'seed {seed}, copy {count}') from error


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(content=st.binary(max_size=300), magic=st.sampled_from(
    [b'', b'\x89MCAP0\r\n', b'SQLite format 3\0', b'\x28\xb5\x2f\xfd', b'#ROSBAG V2.0\n']))
def test_noise_is_no_recording(folder, content, magic):
    path = folder / 'noise.mcap'
    path.write_bytes(magic + content)
    assert read_or_one_line(path) is None


MESSAGES = 24000


@pytest.fixture(scope='module')
def chunks(folder):
    """Return a file of several chunks, and where each begins and ends."""
    values = np.arange(MESSAGES)[:, np.newaxis] * np.ones(6)
    write_recording(folder / 'chunks', Recording(
        wrench=Stream(1e-3 * values[:, 0], values, 'ft_sensor'), start_ns=START_NS))
    path = folder / 'chunks' / 'chunks.mcap'
    places = [(start, end) for opcode, start, end in records(path.read_bytes()) if opcode == CHUNK]
    assert len(places) >= 3
    return path, places


def read_content(folder, content):
    (folder / 'damaged.mcap').write_bytes(content)
    return read_recording(folder / 'damaged.mcap')


def test_file_without_index_is_read_whole(folder, chunks):
    path, places = chunks
    recording = read_content(folder, path.read_bytes()[:places[-1][1]])
    assert len(recording.wrench) == MESSAGES
    assert any('has no index' in note for note in recording.notes)


def test_unchunked_file_is_read_whole(folder, chunks):
    path, places = chunks
    content = path.read_bytes()
    loose = content[:8] + b'\x01' + struct.pack('<Q', 8) + bytes(8)
    for start, end in places:
        loose += content[start + 9 + 40:end]
    recording = read_content(folder, loose)
    np.testing.assert_array_equal(recording.wrench.values[:, 0], np.arange(MESSAGES))


@pytest.mark.parametrize('at', [0, 1, 2, 3, 8])
def test_damaged_length_of_a_chunk_costs_nothing(folder, chunks, at):
    path, places = chunks
    content = bytearray(path.read_bytes())
    content[places[1][0] + 1 + at % 8] ^= 0xff
    assert len(read_content(folder, content).wrench) == MESSAGES


def test_damaged_record_costs_its_chunk_only(folder, chunks):
    path, places = chunks
    content = bytearray(path.read_bytes())
    start, end = places[1]
    content[start] = 0xff
    recording = read_content(folder, content)
    lost = MESSAGES - len(recording.wrench)
    share = (end - start) / sum(stop - begin for begin, stop in places)
    assert 0 < lost < MESSAGES * share * 1.5
    assert any('damaged or cut off at byte' in note for note in recording.notes)
    assert not any('ends early' in note for note in recording.notes)


def test_last_chunk_of_a_cut_file_gives_what_it_holds(folder, chunks):
    path, places = chunks
    start, end = places[-1]
    content = path.read_bytes()
    cut = read_content(folder, content[:(start + end) // 2])
    half, without = len(cut.wrench), len(read_content(folder, content[:start]).wrench)
    assert half - without == pytest.approx((MESSAGES - without) / 2, abs=2)
    assert (f'the recording ends early, at {cut.wrench.t[-1]:.1f} s: its file is damaged or cut '
            'off') in cut.notes


def test_chunk_that_claims_to_be_huge_is_left_out(folder, chunks):
    path, places = chunks
    content = bytearray(path.read_bytes())
    start = places[1][0]
    content[start + 25:start + 33] = struct.pack('<Q', 1 << 60)
    recording = read_content(folder, content)
    assert 0 < len(recording.wrench) < MESSAGES
    assert any('is damaged (1152921504606846976 bytes are stated)' in note
               for note in recording.notes)


def test_sqlite_is_read_from_both_sides_of_the_damage(folder):
    path = write_messages(folder / 'pages', [
        ('/wrench', START_NS + i * 10**6, wrench_message(START_NS + i * 10**6, np.full(6, i)))
        for i in range(5000)], SQLITE3) / 'pages.db3'
    content = bytearray(path.read_bytes())
    middle = content.index(struct.pack('<d', 2500.0) * 6) // 4096 * 4096
    content[middle:middle + 4096] = b'\xff' * 4096
    (folder / 'hole.db3').write_bytes(content)
    recording = read_recording(folder / 'hole.db3')
    rows = recording.wrench.values[:, 0]
    assert 4900 < len(rows) < 5000
    assert (rows[0], rows[-1]) == (0, 4999)
    assert any('damaged or cut off' in note for note in recording.notes)


def test_missing_and_damaged_metadata_is_said(tmp_path):
    write_recording(tmp_path / 'bag', small_recording())
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text('rosbag2_bagfile_information: [' + '[' * 5000)
    recording = read_recording(tmp_path / 'bag')
    assert_same_recording(recording, small_recording())
    assert any('metadata.yaml is damaged' in note for note in recording.notes)
    metadata.unlink()
    recording = read_recording(tmp_path / 'bag')
    assert_same_recording(recording, small_recording())
    assert any('metadata.yaml is missing' in note for note in recording.notes)


def test_missing_part_is_said(tmp_path):
    write_recording(tmp_path / 'bag', small_recording())
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace(
        'relative_file_paths:\n', 'relative_file_paths:\n  - bag_1.mcap\n'))
    assert any('bag_1.mcap' in note for note in read_recording(tmp_path / 'bag').notes)


@pytest.mark.parametrize('storage', [MCAP, SQLITE3])
def test_recording_without_messages_says_so(tmp_path, storage):
    write_messages(tmp_path / 'bag', [], storage)
    with pytest.raises(DataError, match='nothing to read; it has no topics'):
        read_recording(tmp_path / 'bag')


def test_topics_of_other_names_are_named_in_a_command(tmp_path):
    text = STORE.types['std_msgs/msg/String']('x')
    types = STORE.types
    wrench = wrench_message(START_NS, np.zeros(6))
    pose = types['geometry_msgs/msg/PoseStamped'](
        header(START_NS, 'base'), types['geometry_msgs/msg/Pose'](
            types['geometry_msgs/msg/Point'](0.0, 0.0, 0.0),
            types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0)))
    folder = tmp_path / 'my bag'
    write_messages(folder, [
        ('/ati/ft_data', START_NS, wrench), ('/arm/ee_pose', START_NS, pose),
        ('/note', START_NS, text)])
    with pytest.raises(DataError) as error:
        read_recording(folder)
    assert (f"to roles (wrench, pose, accelerometer, target, joint_commands, ...): "
            f"forcecal check '{folder}' --topic wrench=/ati/ft_data --topic pose=/arm/ee_pose; "
            "in Python topics={'wrench': '/ati/ft_data', 'pose': '/arm/ee_pose'}"
            ) in str(error.value)
    write_messages(tmp_path / 'two', [
        ('/a', START_NS, wrench), ('/b', START_NS, wrench), ('/c', START_NS, pose)])
    with pytest.raises(DataError, match=r'/a, /b, /c; .*--topic wrench=NAME --topic pose=/c; '):
        read_recording(tmp_path / 'two')


@pytest.mark.parametrize('make, message', [
    (lambda path: None, 'does not exist'),
    (lambda path: path.mkdir(), 'no recording found'),
    (lambda path: path.write_bytes(b''), 'is empty'),
    (lambda path: path.write_bytes(b'#ROSBAG V2.0\n'), 'ROS 1 bag.*rosbags-convert'),
    (lambda path: path.write_bytes(b'\x7fELF'), 'not a recording'),
], ids=['absent', 'empty folder', 'empty file', 'ros1', 'other'])
def test_what_is_no_recording_is_one_line(tmp_path, make, message):
    path = tmp_path / 'bag'
    make(path)
    with pytest.raises(DataError, match=message):
        read_recording(path)


def test_messages_that_are_too_short_are_counted(tmp_path):
    message = wrench_message(START_NS, np.zeros(6))
    text = STORE.types['std_msgs/msg/String']('x' * 30)
    path = write_messages(tmp_path / 'bag', [
        ('/wrench', START_NS, message), ('/other', START_NS, text)]) / 'bag.mcap'
    content = path.read_bytes()
    path.write_bytes(content.replace(b'std_msgs/msg/String', b'std_msgs/msg/Strin_')
                     .replace(b'ft_sensor\0', b'ft_sensor' + b'\xff'))
    assert read_or_one_line(path) is not None
    broken = content.replace(struct.pack('<I', 10) + b'ft_sensor\0',
                             struct.pack('<I', 9999) + b'ft_sensor\0')
    path.write_bytes(broken)
    with pytest.raises(DataError, match='/wrench: 1 messages could not be decoded'):
        read_recording(path)


@given(st.lists(st.integers(0, 3 * 86400 * 10**9), min_size=0, max_size=60))
def test_stamps_kept_increase_and_all_others_are_counted(stamps):
    stamps = np.array(stamps, dtype=np.int64)
    order = increasing(stamps)
    assert (np.diff(stamps[order.kept]) > 0).all()
    assert len(order.kept) + order.jumped + order.repeated == len(stamps)


@given(st.lists(st.integers(0, 10**9 - 1), min_size=1, max_size=60, unique=True))
def test_small_disorder_is_sorted_without_loss(stamps):
    order = increasing(np.array(stamps))
    assert order.jumped == order.repeated == 0
    np.testing.assert_array_equal(np.array(stamps)[order.kept], sorted(stamps))
