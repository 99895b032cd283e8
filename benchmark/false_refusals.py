"""How often a sound recording is refused, aborted, or warned of without reason.

    python benchmark/false_refusals.py              # 300 recordings offline, some 20 minutes
    python benchmark/false_refusals.py --live 40    # and so many demos beside four busy processes
    python benchmark/false_refusals.py --first 300  # 300 others
    python benchmark/false_refusals.py --runs 0 --live 40 --at-once 4 --load 0   # or each other

Offline the sequencer's state machine and watch run against the simulated rig on one seeded clock
(late_computer.py): commands come up to 0.5 s late, stamps jitter by up to 3 ms, one
stream misses up to 50 ms three times, and both processes wait for the processor as they do beside
zero to two busy processes a core. Nothing is wrong with rig and sensors, so that every refusal is
false. A warning is true where an estimate that it calls into question is off by more than three
of its standard errors, or where it says what was made so: a sensor that pauses.
"""

from argparse import ArgumentParser
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.sim.rig.file import load_rig, true_calibration
from late_computer import run
import numpy as np

OFF = 3.0
"""Estimates that are off by more standard errors than that are rightly called into question."""


def judge(seed):
    """Return (conditions, why refused, warnings, estimates off by more than OFF) of one run."""
    accelerometer = 'acc2' if seed % 4 == 3 else 'acc1'
    outcome = run(seed, accelerometer=accelerometer)
    if outcome.aborted:
        return outcome.conditions, f'aborted: {outcome.aborted}', [], {}
    settings = IdentificationSettings(coupling='ac' if accelerometer == 'acc2' else 'dc')
    try:
        found = identify(outcome.recording, settings)
    except ForcecalError as error:
        return outcome.conditions, f'refused: {error}', [], {}
    return outcome.conditions, '', found.quality['warnings'], departures(found, accelerometer)


def departures(found, accelerometer):
    """Return by how many standard errors estimates are off, the most of any element."""
    off = {}
    for key, truth in true_calibration(load_rig(), accelerometer).items():
        part = found
        for name in key.split('.'):
            part = getattr(part, name, None)
        if part is None or (accelerometer == 'acc2' and key == 'accelerometer.offset'):
            continue
        value, std = np.asarray(part.value, float), np.asarray(part.std, float)
        known = np.broadcast_to(std, value.shape) > 0
        if known.any():
            z = np.abs(value - truth)[known] / np.broadcast_to(std, value.shape)[known]
            off[key] = float(z.max())
    return off


def is_true(warning, off):
    """Whether an estimate that a warning names is off."""
    named = re.search(r'suspect: (.+)$', warning)
    keys = named.group(1).split(', ') if named else []
    return 'pauses for' in warning or any(
        z > OFF for key, z in off.items() if key in keys or key.split('.')[0] in keys)


def offline(seeds, jobs):
    """Print what became of so many recordings; returns how many were refused."""
    refused, warned, false = [], Counter(), Counter()
    wide = Counter()
    with ProcessPoolExecutor(jobs) as pool:
        for seed, (conditions, why, warnings, off) in zip(seeds, pool.map(judge, seeds)):
            if why:
                refused.append(seed)
                print(f'run {seed}: {conditions}: {why}', flush=True)
            for warning in warnings:
                kind = re.sub(r'[-+]?\d[\d.e+-]*', '#', warning)[:90]
                warned[kind] += 1
                false[kind] += not is_true(warning, off)
                print(f'run {seed}: {conditions}: {warning} | off: '
                      + ', '.join(f'{k} {z:.1f}' for k, z in off.items() if z > OFF), flush=True)
            wide.update(k for k, z in off.items() if z > OFF)
    print(f'\n{len(seeds)} sound recordings: {len(refused)} refused or aborted, '
          f'{sum(warned.values())} warnings, {sum(false.values())} of them false')
    for kind, count in warned.most_common():
        print(f'  {count:4d} ({false[kind]} false)  {kind}')
    print('estimates off by more than three standard errors: '
          + (', '.join(f'{key} {n}' for key, n in wide.most_common()) or 'none'))
    return len(refused)


def demo(seed, domain, folder):
    """Run one demo; returns its status and, where it did not end well, its last line."""
    done = subprocess.run(
        [sys.executable, '-m', 'forcecal_ros.cli.main', 'demo', '--out', f'{folder}/{seed}',
         '--seed', str(seed)],
        cwd=ROOT, env=os.environ | {'ROS_DOMAIN_ID': str(domain)}, capture_output=True,
        text=True, check=False)
    last = (done.stderr or done.stdout).strip().splitlines()[-1:]
    shutil.rmtree(f'{folder}/{seed}', ignore_errors=True)
    return done.returncode, last[0] if done.returncode and last else ''


def live(runs, load, at_once):
    """Run so many demos beside busy processes; returns how many did not end well."""
    busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(load)]
    failed = 0
    try:
        with (tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(at_once) as pool):
            ended = pool.map(lambda i: demo(i, 1 + i % 100, folder), range(runs))
            for i, (status, last) in enumerate(ended):
                failed += status != 0
                average = os.getloadavg()[0]
                print(f'demo {i}: status {status}, load {average:.1f} {last}', flush=True)
    finally:
        for process in busy:
            process.kill()
    print(f'{runs} demos, {at_once} at once, beside {load} busy processes: '
          f'{failed} refused or aborted')
    return failed


def main():
    """Parse, run, print."""
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--runs', type=int, default=300, help='recordings offline (300)')
    parser.add_argument('--first', type=int, default=0, help='seed of the first of them (0)')
    parser.add_argument('--live', type=int, default=0, help='demos over DDS (0)')
    parser.add_argument('--load', type=int, default=4, help='busy processes beside those (4)')
    parser.add_argument('--at-once', type=int, default=1, help='demos beside each other (1)')
    parser.add_argument('--jobs', type=int, default=2, help='processes offline (2)')
    args = parser.parse_args()
    refused = offline(range(args.first, args.first + args.runs), args.jobs) if args.runs else 0
    aborted = live(args.live, args.load, args.at_once) if args.live else 0
    return int(refused > 1 or aborted > 0)


if __name__ == '__main__':
    raise SystemExit(main())
