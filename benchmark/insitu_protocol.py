"""Six-axis calibration on the protocol of [Traversaro2014] IV, on a real foot, and in memory.

    python benchmark/insitu_protocol.py [--seeds 20] [--samples 10000000]

Prints, for the simulated leg with noise alone and with bias, hysteresis and flex on top, the worst
and typical errors of added mass, position and semi-axes, by this package and by the paper's own
method, and the coverage of the standard errors;
then the same with a gyro in fast motion, the iCub foot where its recording is at hand, and the
memory that a long table takes.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.insitu import calibrate, Chunk, DataSet, Mounting, Options
from insitu_by_paper import by_paper
import insitu_leg
from insitu_leg import Leg, REAL
from insitu_runs import calibrated, errors, sigmas
import numpy as np

FOOT = np.array([291.69, -78.82, 38.51, -0.020, -2.869, -1.109])


def times(factor):
    """Bias, hysteresis and flex of the protocol, so many times."""
    return replace(REAL, accelerometer_bias=tuple(factor * np.array(REAL.accelerometer_bias)),
                   hysteresis=factor * REAL.hysteresis, flex=factor * REAL.flex)


ARMS = {
    'noise alone': (Leg(), Options(), Mounting()),
    'noise alone, filter off': (Leg(), Options(filter_window=0.0), Mounting()),
    'bias, hysteresis, flex on top': (REAL, Options(), Mounting()),
    'the same, 3 times': (times(3), Options(), Mounting()),
    'the same, 10 times': (times(10), Options(), Mounting()),
    'the same once, |g| not used': (REAL, Options(level_accelerometer=False), Mounting()),
    'fast motion with gyro': (Leg(inertial=True, speed=8.0), Options(moving=True),
                              Mounting(position=insitu_leg.ACCELEROMETER)),
}


def arm(name, seeds):
    leg, options, mounting = ARMS[name]
    rows, z, spread, warnings = [], [], [], Counter()
    for seed in range(seeds):
        try:
            result = calibrated(leg, seed, options, mounting)
        except ForcecalError:
            warnings['refused'] += 1
            continue
        rows.append(errors(result))
        z.append(sigmas(result, leg))
        spread += [one.singular_values[0] / one.singular_values[2] for one in result.data_sets]
        warnings.update('bends' if 'bends' in w else 'hysteresis' if 'hysteresis' in w else
                        'accelerometer offset' if 'offset of (' in w else
                        'leaves the subspace' if 'leave their' in w else w[:40]
                        for w in result.warnings)
    worst, typical = np.max(rows, axis=0), np.median(rows, axis=0)
    off = np.abs(np.concatenate(z))
    print(f'{name}, {seeds} runs of 8 data sets: worst (median) error of a validation set')
    print(f'  added mass {worst[0]:.4f} ({typical[0]:.4f}) kg   position {100 * worst[1]:.2f} '
          f'({100 * typical[1]:.2f}) cm   semi-axes {100 * worst[2]:.2f} '
          f'({100 * typical[2]:.2f}) %')
    print(f'  within one standard error {(off < 1).mean():.1%}, two {(off < 2).mean():.1%}, '
          f'three {(off < 3).mean():.2%}; most {off.max():.1f}; median {np.median(off):.2f}; '
          f'rms {np.sqrt((off**2).mean()):.2f}')
    whole = result.rank.singular_values
    print(f'  condition of the raw readings of a data set, first singular value over third: '
          f'{min(spread):.2f} to {max(spread):.2f}; of all equations {whole[0] / whole[-1]:.0f}')
    if not leg.inertial:
        mass, place, axes = np.max([by_paper(leg, seed) for seed in range(seeds)], axis=0)
        print(f'  by the method of the paper: added mass {mass:.4f} kg   position '
              f'{100 * place:.2f} cm   semi-axes {100 * axes:.2f} %')
    print('  said:', ', '.join(f'{text} {count}/{seeds}' for text, count in warnings.items())
          or 'nothing')


def foot():
    path = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data'))
    path = path / 'icub_foot' / 'right_foot_in_air.csv'
    if not path.is_file():
        print(f'iCub foot: {path} is absent')
        return
    table = np.loadtxt(path, delimiter=',', skiprows=1)
    chunk = Chunk(table[:, 0], table[:, 1:7], -table[:, 7:10], None)
    for window in ((21.0, 57.0), None):
        result = calibrate('foot', [DataSet('foot', lambda: chunk, None, True, window)],
                           Mounting(), Options(matrix=False))
        (start, end), = result.data_sets[0].kept
        print(f'iCub foot, window {"given" if window else "found"}: {start:.1f}..{end:.1f} s')
        for title, values in (('offset', result.offset.value),
                              ('less known', result.offset.value - FOOT),
                              ('standard error', result.offset.std)):
            print(f'  {title:15s}', ' '.join(f'{v:9.4f}' for v in values))
        print('  singular values', ' '.join(
            f'{v:.4f}' for v in result.data_sets[0].singular_values), '| weak:',
            result.excitation.weakest if result.excitation.weak else 'none')


def long_table(samples):
    """Measure a child process, which has nothing else in its memory."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'long.npy'
        log = insitu_leg.record(insitu_leg.PROTOCOL[0], Leg(duration=100.0), 1)
        rows = np.hstack([log.raw, log.accel]).astype(np.float32)
        rows = np.vstack([rows, rows[::-1]])
        table = np.lib.format.open_memmap(path, 'w+', np.float32, (samples, 9))
        for start in range(0, samples, len(rows)):
            part = table[start:start + len(rows)]
            part[:] = rows[:len(part)]
        table.flush()
        del table
        began = time.perf_counter()
        done = subprocess.run(
            [sys.executable, str(Path(__file__).resolve()), '--read', str(path)], check=True,
            capture_output=True, text=True)
        print(f'{samples} samples: {done.stdout.strip()}, '
              f'{time.perf_counter() - began:.0f} s from start to end')


def read_long(path):
    from forcecal_ros.insitu import load_spec
    from forcecal_ros.insitu.sources import read_table
    import yaml

    spec_path = Path(path).with_suffix('.yaml')
    spec_path.write_text(yaml.safe_dump({
        'format': 'forcecal-insitu/1', 'rate': 100,
        'accelerometer': {'columns': [6, 7, 8]}, 'sensors': {'leg': {'columns': list(range(6))}},
        'data_sets': [{'file': Path(path).name}]}))
    spec = load_spec(spec_path)

    def source():
        return read_table(spec, Path(path), spec.sensors['leg'].columns)[0]

    result = calibrate('leg', [DataSet('long', source)], Mounting(), spec.options)
    status = Path('/proc/self/status').read_text()
    peak = int(re.search(r'VmHWM:\s*(\d+)', status)[1]) / 1024
    off = np.abs(np.linalg.inv(insitu_leg.GAUGES) @ (result.offset.value - insitu_leg.OFFSET))
    print(f'{result.data_sets[0].samples} used, offset within {off[:3].max():.3f} N, '
          f'peak resident memory {peak:.0f} MB (interpreter and libraries included)')


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--samples', type=int, default=10_000_000)
    parser.add_argument('--read', help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.read:
        read_long(args.read)
        return
    for name in ARMS:
        arm(name, args.seeds)
    foot()
    long_table(args.samples)


if __name__ == '__main__':
    main()
