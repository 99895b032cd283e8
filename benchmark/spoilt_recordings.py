"""What becomes of recordings that drivers, loggers and clocks have spoilt, by command.

    python benchmark/spoilt_recordings.py                 # the table of results/faults.md
    python benchmark/spoilt_recordings.py --wrong counts --say   # some, with what is said
    python benchmark/spoilt_recordings.py --seed 100 --rate 500  # other poses, noise and pushes

A gripper of 1.3 kg is simulated in fourteen poses, to be calibrated, and at work with contacts
(test/helpers/wrong_recordings.py). ``right``: as of the sound log. ``told``: something is off, and
a note or warning names the cause. ``refused``: with the true cause. ``other cause``: refused or
noted, but not for what is wrong. ``SILENT``: off, and nothing said. ``CRASHED``: a traceback, or
no answer in time.
"""

from argparse import ArgumentParser
from contextlib import redirect_stderr, redirect_stdout
import io
import json
import os
from pathlib import Path
import re
import signal
import sys
import tempfile
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.cli.main import main as forcecal
from forcecal_ros.io.bags import read_recording
import numpy as np
from rosbags.highlevel import AnyReader
from wrong_recordings import BIAS, COM, log, MASS, RATE, RECEIVED, work, write, WRONG

SIGMAS = 5.0
"""An estimate is wrong that is off by more standard errors, and by more than is of no account."""

ESTIMATES = {'estimate': (), 'estimate by ukf': ('--filter', 'ukf')}
"""Ways to estimate a contact, with their options."""

NO_ACCOUNT = {'mass': 0.005 * MASS, 'com': 0.002, 'wrench_bias': np.repeat([0.1, 0.01], 3)}
"""[kg], [m], [N, N m]"""

LONGEST = 60
"""A command that takes longer hangs [s]: of the sound log each takes two."""

WORSE = 1.5
"""A contact is wrong whose RMS error is so many times that of the sound log."""


def too_long(*_):
    """Say that a command hangs."""
    raise TimeoutError(f'no answer in {LONGEST} s')


def said(*arguments):
    """Run a command; return its document or None, and what it says."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        signal.alarm(LONGEST)
        try:
            status = forcecal([str(argument) for argument in arguments])
        except Exception as error:
            return None, [f'CRASHED: {error!r}']
        finally:
            signal.alarm(0)
    lines = [line.removeprefix('forcecal: ').removeprefix('note: ')
             for line in err.getvalue().splitlines()]
    if status:
        return None, lines
    document = json.loads(out.getvalue())
    quality = document.get('quality', {})
    return document, [*lines, *document.get('notes', ()), *(
        line for key in ('warnings', 'questions', 'notes') for line in quality.get(key, ()))]


def calibrated(bag, folder):
    """Return what is off, or None where it is refused, and what is said."""
    document, lines = said('calibrate', bag, '-o', folder / 'c.yaml', '--json')
    if document is None:
        return None, lines
    off = []
    for key, truth in (('mass', MASS), ('com', COM), ('wrench_bias', BIAS)):
        found = document[key]
        value, std = np.array(found['value']), np.array(found['std'])
        error = np.abs(value - truth)
        if (error > np.maximum(SIGMAS * std, NO_ACCOUNT[key])).any():
            off.append(f'{key} {np.round(value, 4).tolist()}')
    return ', '.join(off), lines


def nearest_of(known, stamps):
    """Return how far stamps are from known ones on average, and which is the nearest of each."""
    order = np.argsort(known, kind='stable')
    after = np.searchsorted(known[order], stamps).clip(max=len(order) - 1)
    before = (after - 1).clip(min=0)
    near = np.where(abs(known[order][after] - stamps) < abs(known[order][before] - stamps),
                    after, before)
    return float(abs(known[order][near] - stamps).mean()), order[near]


def valid(bag, stamps):
    """Return which rows of an estimate are not said to be no answer."""
    good = np.ones(len(stamps), dtype=bool)
    with AnyReader([bag]) as reader:
        wanted = [one for one in reader.connections if one.topic == '/observer/status']
        for connection, _, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            level = message.status[0].level
            good[stamps >= stamp.sec * 10**9 + stamp.nanosec - 1000] = ord(level) < 2 if (
                isinstance(level, bytes)) else level < 2
    return good


def contact_error(command, bag, one, folder, calibration):
    """Return the RMS error of the contact in forces and torques, or None; and what is said."""
    document, lines = said('estimate', bag, '--calibration', calibration, '-o', folder / 'out',
                           '--json', *ESTIMATES[command])
    if document is None:
        return None, lines
    found = read_recording(folder / 'out', {'wrench': 'observer/contact_wrench'})
    wrench = found.wrench
    stamps = found.start_ns + np.rint(wrench.t * 1e9).astype(np.int64)
    nearest = min((nearest_of(t, stamps) for t in (one.stamp, RECEIVED(one.t))),
                  key=lambda found: found[0])[1]
    late = (wrench.t > 1.0) & valid(folder / 'out', stamps)
    error = wrench.values[late] - one.contact[nearest][late]
    rms = np.sqrt(np.nanmean(error**2, axis=0))
    return (float(np.sqrt((rms[:3]**2).mean())), float(np.sqrt((rms[3:]**2).mean()))), lines


def shapes(lines):
    """Return what is said, without its numbers."""
    return {re.sub(r'[-+]?[\d.]+', '#', line) for line in lines}


def word(off, lines, cause):
    """Judge: ``off`` is None where refused, empty where right."""
    named = any(re.search(cause, line) for line in lines)
    if any(line.startswith('CRASHED') for line in lines):
        return 'CRASHED'
    if off is None:
        return 'refused' if named else 'other cause'
    if not off:
        return 'right'
    if named:
        return 'told'
    return 'other cause' if any('suspect' in one for one in lines) else 'SILENT'


def cells(name, logs, seed, folder, sound):
    """Yield command, word, what is off and what is said, of one kind of wrong log."""
    wrong, known = WRONG[name], folder / 'known.yaml'
    rng = np.random.default_rng(5 + seed)
    poses, at_work = (wrong.make(one, rng) for one in logs)
    bags = [write(one, folder / kind) for one, kind in ((poses, 'poses'), (at_work, 'work'))]
    off, lines = calibrated(bags[0], folder)
    lines = [line for line in lines if not shapes([line]) & sound['said']]
    yield 'calibrate', word(off, lines, wrong.cause), off, lines
    for command in ESTIMATES:
        error, lines = contact_error(command, bags[1], at_work, folder, known)
        lines = [line for line in lines if not shapes([line]) & sound['said']]
        off = None
        if error is not None:
            off = '' if all(e < WORSE * s for e, s in zip(error, sound[command])) else (
                f'{error[0]:.2g} N {error[1]:.2g} N m')
        yield command, word(off, lines, wrong.cause), off, lines


def sound_errors(one, folder):
    """Return the errors of the sound log, by command, and what is ``said`` of it."""
    bag, said_of_it = write(one, folder / 'sound'), shapes(calibrated(folder / 'known', folder)[1])
    errors, known = {}, folder / 'known.yaml'
    for command in ESTIMATES:
        errors[command], lines = contact_error(command, bag, one, folder, known)
        said_of_it |= shapes(lines)
    return errors | {'said': said_of_it}


def main():
    """Print the table; status 1 where anything is silent or crashes."""
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--wrong', default='', help='only what this is found in')
    parser.add_argument('--say', action='store_true', help='print what is said as well')
    parser.add_argument('--seed', type=int, default=0, help='of poses, noise and pushes (0)')
    parser.add_argument('--rate', type=float, default=RATE, help=f'of the wrench ({RATE:g} Hz)')
    args = parser.parse_args()
    logs = (log(1 + args.seed, rate=args.rate), work(2 + args.seed, rate=args.rate))
    silent = 0
    signal.signal(signal.SIGALRM, too_long)
    print('| '.join(('', 'what is wrong ', 'calibrate ', *(f'{name} ' for name in ESTIMATES)))
          + '|\n|---|---|---|---|')
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        said('calibrate', write(logs[0], folder / 'known'), '-o', folder / 'known.yaml', '--json')
        sound = sound_errors(logs[1], folder)
        for name in WRONG:
            if not re.search(args.wrong, name):
                continue
            found = list(cells(name, logs, args.seed, folder, sound))
            silent += sum(judged in ('SILENT', 'CRASHED') for _, judged, _, _ in found)
            print(f'| {name} | ' + ' | '.join(
                judged + f' ({off})' * bool(off) for _, judged, off, _ in found) + ' |',
                flush=True)
            if args.say:
                for command, _, _, lines in found:
                    for line in lines:
                        print(f'    {command}: {line}')
    return int(silent > 0)


if __name__ == '__main__':
    raise SystemExit(main())
