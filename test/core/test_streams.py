"""forcecal record and play: what was said comes back, whole, in order, in the time it took."""

from itertools import pairwise
import json
from pathlib import Path
import signal
import subprocess
import sys
import time

from bag_samples import copy_bag, small_recording, wrench_message, write_messages
from forcecal_ros.cli.main import main
from forcecal_ros.io.bags import BagWriter, read_messages, read_recording, write_recording
from geometry_msgs.msg import PoseStamped
from live import Live, PATIENCE
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin
from rosgraph_msgs.msg import Clock


def forcecal(*arguments):
    return subprocess.Popen(
        [sys.executable, '-m', 'forcecal_ros.cli.main', *map(str, arguments), '--json'],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def answer(process, timeout=PATIENCE):
    out, err = process.communicate(timeout=timeout)
    assert process.returncode == 0, err
    return json.loads(out)


def split_bag(path):
    """Write a recording in two files, as rosbag2 splits them."""
    path.mkdir()
    messages = [(f'/{name}', 10**18 + i * 10**6 + k, wrench_message(i + 1, [i] * 6))
                for i in range(300) for k, name in enumerate(('a', 'b'))]
    for part, some in enumerate((messages[:250], messages[250:])):
        write_messages(path / f'part_{part}', some)
        next((path / f'part_{part}').glob('*.mcap')).rename(path / f'bag_{part}.mcap')
    return path


def test_messages_of_split_files_come_in_the_order_of_recording(tmp_path):
    stamps = [message.log_ns for message in read_messages(split_bag(tmp_path / 'split'))]
    assert len(stamps) == 600
    assert all(a < b for a, b in pairwise(stamps))


@pytest.mark.parametrize('storage, mode', [
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    pytest.param(StoragePlugin.SQLITE3, CompressionMode.FILE, marks=pytest.mark.long),
    pytest.param(StoragePlugin.MCAP, CompressionMode.STORAGE, marks=pytest.mark.long),
    pytest.param(StoragePlugin.MCAP, CompressionMode.MESSAGE, marks=pytest.mark.long)])
def test_messages_are_those_of_rosbags_however_stored(tmp_path, storage, mode):
    write_recording(tmp_path / 'one', small_recording())
    with Reader(tmp_path / 'one') as reader:
        wanted = sorted((connection.topic, stamp, bytes(data))
                        for connection, stamp, data in reader.messages())
    found = list(read_messages(copy_bag(tmp_path / 'one', tmp_path / 'two', storage, mode)))
    assert sorted((one.topic.name, one.log_ns, one.data) for one in found) == wanted
    assert all(a.log_ns <= b.log_ns for a, b in pairwise(found))


def test_compression_makes_the_file_smaller_and_changes_nothing(tmp_path):
    for name, compressed in (('plain', False), ('small', True)):
        with BagWriter(tmp_path / name, compressed=compressed) as writer:
            for i in range(2000):
                writer.write_raw('/w', 'std_msgs/msg/String', i + 1, b'\0\1\0\0' + bytes(40))
    plain, small = (next((tmp_path / name).glob('*.mcap')) for name in ('plain', 'small'))
    assert small.stat().st_size < plain.stat().st_size / 2
    assert list(read_messages(plain)) == list(read_messages(small))


STREAMS = {'wrench': 1e-3, 'optidrive': 1e-3, 'pose': 4e-3, 'angular_velocity': 1e-3}
MATCHING = 1.5
"""While topics find each other, not all of them are heard [s]."""

DELAY = 2.0
"""Before the first message is played, for the recorder to find the topics [s]."""


SPEEDS = (1.0, 1.0, 0.4, 0.2)
"""Of the rig, try after try: a machine that others keep busy may lose some at full rate."""


def record_rig(path, speed, seconds=2.5):
    """Record all that the simulated rig says; returns how many messages of each topic."""
    with Live() as live:
        stamps = []
        live.hear(PoseStamped, 'current_pose', lambda stamp, _: stamps.append(stamp))
        live.start('sim', imu__publish=True, speed=speed)
        record = forcecal('record', '-o', path)
        live.until(lambda: live.node.get_subscriptions_info_by_topic('wrench') and stamps,
                   'the recorder')
        end = stamps[-1] + round((MATCHING + seconds) * 1e9)
        live.until(lambda: stamps[-1] > end, 'enough of the rig')
        record.send_signal(signal.SIGINT)
        return answer(record)['messages']


def gaps(path):
    """Return how many samples of the rig are missing between the first and the last."""
    recording = read_recording(path)
    streams = {name: getattr(recording, name) for name in STREAMS}
    start = max(stream.t[0] for stream in streams.values()) + MATCHING
    return {name: round((stream.t[-1] - stream.t[stream.t >= start][0]) / STREAMS[name])
            + 1 - np.count_nonzero(stream.t >= start) for name, stream in streams.items()}


def play_and_record(path, rate, again):
    """Play a recording and record it anew; return what was played, how long it took, /clock."""
    recorder, ticks = forcecal('record', '-o', again), []
    with Live() as live:
        live.node.create_subscription(Clock, '/clock', ticks.append, 1000)
        live.until(lambda: 'record' in live.node.get_node_names(), 'the recorder')
        began = time.monotonic()
        player = forcecal('play', path, '--rate', rate, '--delay', DELAY / min(rate, 1.0))
        live.until(lambda: player.poll() is not None, 'the end of the recording')
        seconds = time.monotonic() - began
        live.spin(0.5)
    recorder.send_signal(signal.SIGINT)
    answer(recorder)
    return answer(player)['messages'], seconds, [
        tick.clock.sec * 10**9 + tick.clock.nanosec for tick in ticks]


def contents(path):
    """Return the messages of a recording by topic."""
    found = {}
    for one in read_messages(path):
        found.setdefault(one.topic.name, []).append(one.data)
    return found


@pytest.mark.long
@pytest.mark.live
def test_the_full_rate_of_the_rig_is_recorded_and_played_without_a_loss(ros_domain, tmp_path):
    first = tmp_path / 'first'
    for speed in SPEEDS:
        counts = record_rig(first, speed)
        if not any(gaps(first).values()):
            break
    assert gaps(first) == dict.fromkeys(STREAMS, 0), f'at {speed} of the full rate'
    assert min(counts.values()) > 900
    recorded = list(read_messages(first))
    assert len(recorded) == sum(counts.values())

    for i, speed in enumerate(SPEEDS):
        second = tmp_path / f'second_{i}'
        played, seconds, told = play_and_record(first, 2.0 * speed, second)
        if contents(second) == contents(first):
            break
    assert played == counts
    assert contents(second) == contents(first), f'at {2.0 * speed} times the full rate'
    span = (recorded[-1].log_ns - recorded[0].log_ns) * 1e-9
    assert seconds > DELAY + span / (2.0 * speed)
    assert all(a < b for a, b in pairwise(told))
    assert recorded[0].log_ns <= told[0] and told[-1] <= recorded[-1].log_ns


@pytest.mark.parametrize('arguments', [
    ('record', '-o', '{tmp}/out', '--duration', '0.3'),
    ('play', '/nowhere'), ('play', '{tmp}'),
    ('play', '{tmp}/bag', '--only', '/nothing'), ('play', '{tmp}/bag', '--only', 'target_frame')])
def test_what_cannot_be_done_is_one_line(ros_domain, capsys, tmp_path, arguments):
    write_recording(tmp_path / 'bag', small_recording())
    assert main([part.format(tmp=tmp_path) for part in arguments]) == 1
    err = capsys.readouterr().err
    assert err.startswith('forcecal: ') and err.count('\n') == 1
    assert not Path(tmp_path / 'out').exists()
