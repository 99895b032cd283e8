"""How fast recordings become arrays, and how much memory that takes.

    python benchmark/reading.py             the table of rates
    python benchmark/reading.py --hour      an hour of the rig: 11.7 million messages, 1.6 GB

Three ways in turn: rosbags' AnyReader with every message deserialised and its numbers put into
arrays; the raw messages, joined and seen through a dtype by np.frombuffer; and read_recording.
"""

import argparse
from collections import defaultdict
from functools import partial
from operator import attrgetter
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.bags.messages import FIELDS
import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, Reader
from timing import best, head, row

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from bag_samples import copy_bag, STORAGES
from observing import record, Swing

SECONDS = 15.0
SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2)
NAMES = {CompressionMode.NONE: '', CompressionMode.FILE: ', file compressed',
         CompressionMode.MESSAGE: ', each message compressed',
         CompressionMode.STORAGE: ', chunks compressed'}


def any_reader(path: Path) -> dict[str, np.ndarray]:
    columns = defaultdict(list)
    with AnyReader([path]) as reader:
        fields = {one.msgtype: attrgetter('header.stamp.sec', 'header.stamp.nanosec',
                                          *FIELDS[one.msgtype]) for one in reader.connections}
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            columns[connection.topic].append(fields[connection.msgtype](message))
    return {topic: np.array(rows) for topic, rows in columns.items()}


def raw_and_frombuffer(path: Path) -> dict[str, np.ndarray]:
    parts = defaultdict(list)
    with Reader(path) as reader:
        for connection, _, raw in reader.messages():
            parts[connection.topic, len(FIELDS[connection.msgtype])].append(raw)
    arrays = {}
    for (topic, count), messages in parts.items():
        length = len(messages[0])
        start = length - 8 * count
        kind = np.dtype({'names': ['stamp', 'values'], 'formats': [('<u4', 2), ('<f8', count)],
                         'offsets': [4, start], 'itemsize': length})
        rows = np.frombuffer(b''.join(messages), kind)
        arrays[topic] = np.column_stack([rows['stamp'], rows['values']])
    return arrays


def rates(folder: Path) -> None:
    whole = record(SECONDS, SWING, rates=(1000.0, 1000.0, 1000.0),
                   without=('optidrive', 'contact_truth'))
    write_recording(folder / 'source', whole)
    count = sum(len(s) for s in (whole.wrench, whole.accelerometer, whole.pose))
    head('storage', 'AnyReader, messages/s', 'raw + frombuffer', 'read_recording',
         'against AnyReader (2 wanted)', 'time of raw + frombuffer (1.3 wanted)')
    for storage, mode in STORAGES:
        path = copy_bag(folder / 'source', folder / f'{storage.name}-{mode.name}', storage, mode)
        assert any_reader(path).keys() == raw_and_frombuffer(path).keys()
        times = best({'any': partial(any_reader, path),
                      'raw': partial(raw_and_frombuffer, path),
                      'ours': partial(read_recording, path)}, rounds=4)
        row(storage.name.lower() + NAMES[mode], *(f'{count / times[name] / 1e3:.0f} k'
                                                  for name in times),
            f'{times["any"] / times["ours"]:.1f}', f'{times["ours"] / times["raw"]:.2f}')


def hour(folder: Path) -> None:
    whole = record(3600.0, SWING, without=('contact_truth',))
    write_recording(folder / 'hour', whole)
    del whole
    said = subprocess.run([sys.executable, __file__, '--read', folder / 'hour'],
                          capture_output=True, text=True, check=True).stdout
    head('an hour', 'measured', 'wanted')
    print(said, end='')


def most_memory() -> float:
    """Return the most that this program has occupied so far [MB]."""
    status = Path('/proc/self/status').read_text()
    return int(status.partition('VmHWM:')[2].split()[0]) / 1024


def read(path: Path) -> None:
    before = most_memory()
    start = time.process_time()
    r = read_recording(path)
    seconds = time.process_time() - start
    count = sum(len(s) for s in (r.wrench, r.accelerometer, r.optidrive, r.pose))
    row('messages', f'{count / 1e6:.1f} million in {seconds:.1f} s', '')
    row('most memory of the process', f'{most_memory():.0f} MB ({before:.0f} before)', '1000 MB')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--hour', action='store_true')
    parser.add_argument('--read', type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.read:
        read(args.read)
        return
    with tempfile.TemporaryDirectory() as folder:
        (hour if args.hour else rates)(Path(folder))


if __name__ == '__main__':
    main()
