"""How much faster than real time ``forcecal estimate`` is, reading and writing included.

    python benchmark/replay.py [MINUTES]

A recording of the given length (10 by default), wrench, accelerometer and pose at 1 kHz each,
is read, estimated and written as one topic by the command itself, in a process of its own.
"""

import os
from pathlib import Path
import resource
import subprocess
import sys
import tempfile
import time

from forcecal_ros.core.streams import Stream
from forcecal_ros.io.bags import read_recording, write_recording, write_signals
from forcecal_ros.io.calibration_file import load, save
from forcecal_ros.observe import design, replay
from forcecal_ros.observe.playback import events, run
import numpy as np
from timing import best, head, row

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from observing import calibration, record, Swing

SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2)


def made(folder: Path, seconds: float) -> Path:
    rates, without = (1000.0,) * 3, ('optidrive', 'contact_truth')
    write_recording(folder / 'bag', record(seconds, SWING, rates=rates, without=without))
    save(calibration(), folder / 'calibration.yaml')
    return folder / 'bag'


def command(folder: Path) -> tuple[float, float]:
    """Return processor time and time on the wall of one run of the command [s]."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, '-m', 'forcecal_ros.cli.main', 'estimate', folder / 'bag',
                    '--calibration', folder / 'calibration.yaml', '-o', folder / 'out'],
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                   env={**os.environ, 'OPENBLAS_NUM_THREADS': '1'})
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main() -> None:
    seconds = 60.0 * float(sys.argv[1] if len(sys.argv) > 1 else 10)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bag = made(folder, seconds)
        command(folder)
        cost, wall = np.min([command(folder) for _ in range(3)], axis=0)
        recording, known = read_recording(bag), load(folder / 'calibration.yaml')
        estimate = replay(recording, known)
        contact = Stream(estimate.t, estimate.contact)
        parts = best({
            'reading': lambda: read_recording(bag),
            'estimating': lambda: replay(recording, known),
            'writing': lambda: write_signals(
                folder / 'other', {'contact_wrench': contact}, recording.start_ns)}, rounds=3)
    short = record(20.0, SWING, seed=1)
    expected = np.array([sample.contact for sample in run(events(short), design(known))[1]])
    difference = np.abs(replay(short, known).contact - expected).max()
    head(f'{seconds / 60:g} min, 3 topics at 1 kHz', 'measured', 'wanted')
    row('forcecal estimate, processor time', f'{cost:.1f} s, {seconds / cost:.0f} x real time',
        '50 x')
    row('the same on the wall', f'{wall:.1f} s, {seconds / wall:.0f} x real time', '')
    for part, took in parts.items():
        row(f'of it {part}', f'{took:.1f} s', '')
    row('batch against step', f'{difference:.1e} N, N m', '1e-9')


if __name__ == '__main__':
    main()
