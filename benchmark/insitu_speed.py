"""Cost of in-situ calibration of a long recording against one pass of X^T X over its columns.

    python benchmark/insitu_speed.py [SAMPLES]

A table of 10^7 samples (by default), nine columns of float32 in a .npy file, is read
and calibrated, the filter off and on. Against it: numpy over the same columns, chunk by chunk,
X^T X of the constant, gravity and the raw channels. Memory is that of a process of its own.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from collections.abc import Callable
from pathlib import Path
import subprocess
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / 'test' / 'helpers'))

from forcecal_ros.insitu import calibrate, DataSet, load_spec, Mounting
from forcecal_ros.insitu.moments import PAPER_WINDOW
from forcecal_ros.insitu.sources import read_table
import insitu_leg
from insitu_leg import Leg
import numpy as np
from timing import best, head, row
import yaml

CHUNK = 65536


def write_table(path: Path, samples: int) -> None:
    log = insitu_leg.record(insitu_leg.PROTOCOL[0], Leg(duration=100.0), 1)
    rows = np.hstack([log.raw, log.accel]).astype(np.float32)
    rows = np.vstack([rows, rows[::-1]])
    table = np.lib.format.open_memmap(path, 'w+', np.float32, (samples, 9))
    for start in range(0, samples, len(rows)):
        part = table[start:start + len(rows)]
        part[:] = rows[:len(part)]
    table.flush()


def calibration(path: Path, window: float) -> Callable[[], object]:
    """Return what calibrates the table; ``window`` of the filter [s], 0 for none."""
    spec_path = path.with_name(f'{window:g}.yaml')
    spec_path.write_text(yaml.safe_dump({
        'format': 'forcecal-insitu/1', 'rate': 100,
        'filter': {'window': window} if window else False,
        'accelerometer': {'columns': [6, 7, 8]}, 'sensors': {'leg': {'columns': list(range(6))}},
        'data_sets': [{'file': path.name}]}))
    spec = load_spec(spec_path)

    def source():
        return read_table(spec, path, spec.sensors['leg'].columns)[0]

    return lambda: calibrate('leg', [DataSet('long', source)], Mounting(), spec.options)


def normal_matrix(path: Path) -> np.ndarray:
    table = np.load(path, mmap_mode='r')
    gram = np.zeros((10, 10))
    for start in range(0, len(table), CHUNK):
        part = table[start:start + CHUNK].astype(float)
        x = np.column_stack([np.ones(len(part)), part])
        gram += x.T @ x
    return gram


def most_memory(path: Path) -> str:
    return subprocess.run([sys.executable, __file__, '--memory', path], check=True,
                          capture_output=True, text=True).stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('samples', type=float, nargs='?', default=1e7)
    parser.add_argument('--memory', type=Path, metavar='TABLE', help='calibrate that table only')
    args = parser.parse_args()
    if args.memory:
        calibration(args.memory, 0.0)()
        status = Path('/proc/self/status').read_text()
        private = int(status.partition('VmHWM:')[2].split()[0]) / 1024
        mapped = args.memory.stat().st_size / 1e6
        print(f'{private:.0f} MB (the file has {mapped:.0f})')
        return
    samples = int(args.samples)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'long.npy'
        write_table(path, samples)
        spec_window = calibration(path, PAPER_WINDOW)
        times = best({'X^T X by numpy, one pass': lambda: normal_matrix(path),
                      'calibrate, filter off': calibration(path, 0.0),
                      'calibrate, filter on': spec_window}, rounds=2)
        one = times['X^T X by numpy, one pass']
        head(f'{samples:.0e} samples', 'processor time', 'of one pass', 'wanted')
        for name, took in times.items():
            row(name, f'{took:.2f} s', f'{took / one:.2f}',
                '5' if name.endswith('off') else '')
        share = 1 - times['calibrate, filter off'] / times['calibrate, filter on']
        row('share of the filter', f'{share:.0%}', '', '')
        row('most memory, filter off', most_memory(path), '', '')
        write_table(path, samples // 10)
        row('the same for a tenth of the samples', most_memory(path), '', '')


if __name__ == '__main__':
    main()
