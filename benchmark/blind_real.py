"""Seventeen effects laid on a real recording: which are found, and what it says untouched.

    python benchmark/blind_real.py [--seed 1] [--only NAME ...] [-o FILE]

Takes the KUKA recordings of FORCECAL_DATA (or ../shared/data): calibrates on the static poses,
lays one effect at a time on what was measured on the free trajectory, and diagnoses that from the
measured motion. The forms are this file's own; sign, size and axis (one that the motion loads: x
or z) are drawn by the seed. The arm has departures of its own, which the untouched one shows.

First: the most probable name, ``unknown`` counted as one, is the effect's. Tie: it is an alias's
with at most 0.9, or the verdict is ``ambiguous`` and the effect is among the candidates with at
least a third of the first effect's probability, or a lag is told as a recalibration, which is what
it is beside an accelerometer of unknown delay.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from contextlib import redirect_stdout
from dataclasses import replace
import io
import json
from pathlib import Path
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from forcecal_ros.cli.main import main as forcecal
from forcecal_ros.diagnose.sources.rig import ToolSource
from forcecal_ros.io.bags import read_recording
from forcecal_ros.io.calibration_file import load
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rigid_tool import rigid_tool_of_calibration
import numpy as np
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

DATA = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_lbr_med'
GRAVITY = '9.8209'

SLOW = 12.0
"""Up to which the wrench is the motion's, not vibration [Hz]."""

SURE = 0.9
"""A false name with more is wrong for sure."""

SHIFTED = 0.003
"""Change of the recalibrated delay between the sensors that tells a delay [s]."""

ALIASES = (
    {'wrench_delay', 'wrench_lowpass'}, {'base_tilt', 'cable_force', 'accel_misalignment'},
    {'tool_mass', 'wrench_gain', 'accel_gain'}, {'tool_com', 'wrench_crosstalk'})
"""Effects that a motion of some seconds, known by the accelerometer, may not tell apart."""


class Laid:
    """
    The recording with something laid on, piece by piece.

    Attributes
    ----------
    t, wrench, f : ndarray
        [s]; as measured, with bias; what the motion loads, without bias and vibration.
    up : ndarray, shape (n, 3)
        In the sensor.
    accel : ndarray, shape (m, 3)
        As measured.
    """

    def __init__(self, recording, calibration):
        self.t, self.wrench = recording.wrench.t, recording.wrench.values.copy()
        low = butter(2, SLOW, fs=recording.wrench.rate, output='sos')
        self.f = sosfiltfilt(low, self.wrench - calibration.wrench_bias.value, axis=0)
        pose = recording.pose
        turned = Slerp(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))
        self.R = turned(np.clip(self.t, pose.t[0], pose.t[-1])).as_matrix()
        self.accel, self.mass = recording.accelerometer.values.copy(), float(calibration.mass)
        self.com = calibration.com.value
        turning = RotationSpline(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))
        at = np.clip(self.t, pose.t[0], pose.t[-1])
        self.omega, self.alpha = (sosfiltfilt(low, turning(at, k), axis=0) for k in (1, 2))

    def add(self, force=(0, 0, 0), at=(0.0, 0.0, 0.08)):
        """Add forces (in the sensor) that act at a point of the tool."""
        force = np.broadcast_to(force, (len(self.t), 3))
        self.wrench += np.hstack([force, np.cross(at, force)])


def gain(x, axis, sign, size):
    x.wrench[:, axis] += sign * size * x.f[:, axis]


def gains(x, axis, sign, size):
    x.wrench[:, :3] += sign * size * x.f[:, :3]


def crosstalk(x, axis, sign, size):
    x.wrench[:, (axis + 1) % 3] += sign * size * x.f[:, axis]


def lever(x, axis, sign, size):
    x.wrench[:, 3 + (axis + 1) % 3] += sign * size * x.f[:, axis]


def levelling(x, axis, sign, size):
    rise = -np.expm1(-(x.t - x.t[0]) / 4.0)
    x.wrench[:, axis] += sign * size * rise / rise[-1]


def ramp(x, axis, sign, size):
    x.wrench[:, axis] += sign * size * (x.t - x.t[0]) / (x.t[-1] - x.t[0])


def hysteresis(x, axis, sign, size):
    """Prandtl's stop operators of two widths."""
    for i in range(3):
        for width in (0.5, 2.0):
            state, was = 0.0, x.f[0, i]
            for n, now in enumerate(x.f[:, i]):
                state, was = float(np.clip(state + (now - was) / width, -1.0, 1.0)), now
                x.wrench[n, i] -= 0.5 * size * state


def saturation(x, axis, sign, size):
    i = int(np.argmax(np.ptp(x.f[:, :3], axis=0)))
    most = size * np.abs(x.wrench[:, i]).max()
    x.wrench[:, i] = np.clip(x.wrench[:, i], -most, most)


def delay(x, axis, sign, size):
    x.wrench = np.stack([np.interp(x.t - size, x.t, one) for one in x.wrench.T], axis=1)


def lowpass(x, axis, sign, size):
    """Second order, damping 0.8; ``size`` is its delay at low frequency."""
    natural, now, speed, out = 1.6 / size, x.wrench[0].copy(), np.zeros(6), x.wrench.copy()
    for n, step in enumerate(np.diff(x.t, prepend=x.t[0])):
        for _ in range(8):
            speed = speed + step / 8 * (natural**2 * (x.wrench[n] - now) - 1.6 * natural * speed)
            now = now + step / 8 * speed
        out[n] = now
    x.wrench = out


def tilt(x, axis, sign, size):
    """Turn the weight as in a base that leans, and with it the accelerometer."""
    lean = Rotation.from_rotvec([sign * size, 0.0, 0.0]).apply([0.0, 0.0, 1.0])
    x.add(x.mass * float(GRAVITY) * ((lean - [0.0, 0.0, 1.0]) @ x.R), x.com)


def mass(x, axis, sign, size):
    x.wrench += sign * size * x.f


def com(x, axis, sign, size):
    """Shift the mass: what it weighs acts elsewhere, and what carries it turns with it."""
    shift = sign * size * np.eye(3)[axis]
    x.wrench[:, 3:] += np.cross(shift, x.f[:, :3])
    x.add(x.mass * (np.cross(x.alpha, shift) + np.cross(x.omega, np.cross(x.omega, shift))),
          x.com)


def step(x, axis, sign, size):
    x.wrench[x.t > x.t[0] + 0.45 * (x.t[-1] - x.t[0]), axis] += sign * size


def cable(x, axis, sign, size):
    x.add(sign * size * x.R[:, 1 + axis // 2])


def accel_gain(x, axis, sign, size):
    """Scale one of the axes along which gravity turns: x and y of this accelerometer."""
    x.accel[:, axis // 2] *= 1.0 + sign * size


def misalignment(x, axis, sign, size):
    x.accel = Rotation.from_rotvec(sign * size * np.eye(3)[axis]).inv().apply(x.accel)


LAID = {
    'gain': ('wrench_gain', gain, 0.1, 0.4, '1'),
    'gains': ('wrench_gain', gains, 0.05, 0.2, '1'),
    'crosstalk': ('wrench_crosstalk', crosstalk, 0.05, 0.2, '1'),
    'lever': ('wrench_crosstalk', lever, 0.005, 0.02, 'm'),
    'levelling': ('wrench_bias_drift', levelling, 0.5, 2.0, 'N'),
    'ramp': ('wrench_bias_drift', ramp, 0.5, 2.0, 'N'),
    'hysteresis': ('wrench_hysteresis', hysteresis, 0.3, 1.0, 'N'),
    'saturation': ('wrench_saturation', saturation, 0.6, 0.85, 'of the largest'),
    'delay': ('wrench_delay', delay, 0.005, 0.02, 's'),
    'lowpass': ('wrench_lowpass', lowpass, 0.02, 0.06, 's'),
    'tilt': ('base_tilt', tilt, 0.03, 0.12, 'rad'),
    'mass': ('tool_mass', mass, 0.05, 0.25, '1'),
    'com': ('tool_com', com, 0.004, 0.016, 'm'),
    'step': ('wrench_bias_step', step, 0.3, 1.5, 'N'),
    'cable': ('cable_force', cable, 0.5, 2.0, 'N'),
    'accel gain': ('accel_gain', accel_gain, 0.1, 0.3, '1'),
    'misalignment': ('accel_misalignment', misalignment, 0.05, 0.2, 'rad')}
"""What is laid on: its name in the library, and between which sizes."""


def prepared(folder):
    with redirect_stdout(io.StringIO()):
        for name in ('poses', 'baseline'):
            forcecal(['import', str(ROOT / f'config/examples/kuka_{name}.yaml'), '--tables',
                      str(DATA), '-o', str(folder / name)])
        forcecal(['calibrate', str(folder / 'poses'), '--gravity', GRAVITY, '-o',
                  str(folder / 'known.yaml')])
    return read_recording(folder / 'baseline'), load(folder / 'known.yaml')


def laid(name, seed, recording, calibration):
    """Lay one effect on a recording; return it with what was drawn, in words."""
    rng = np.random.default_rng([seed, sorted(LAID).index(name)])
    _, function, low, high, unit = LAID[name]
    axis, sign = 2 * int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    x = Laid(recording, calibration)
    function(x, axis, sign, size)
    felt = replace(recording.accelerometer, values=x.accel)
    return (replace(recording, wrench=replace(recording.wrench, values=x.wrench),
                    accelerometer=felt), f'{size:.3g} {unit}, {"+-"[sign < 0]}{"xyz"[axis]}')


def named(recording, calibration):
    """Diagnose; the delay between both sensors, which no calibration from poses knows, along."""
    body = rigid_tool_of_calibration(calibration, load_rig('rigid_tool.yaml'))
    began = time.process_time()
    outcome = ToolSource(body, calibration).diagnose(recording).outcome
    seconds = time.process_time() - began
    return outcome, outcome.recalibrations['accelerometer.delay'][0], seconds


def judged(name, outcome, shift):
    """Say what the answer is: first, tie, behind unknown, missed; and what is falsely sure."""
    truth = LAID[name][0]
    alike = {truth}.union(*(a for a in ALIASES if truth in a))
    found = dict(outcome.diagnosis.candidates)
    for one in outcome.diagnosis.effects:
        found[one.name] = max(one.probability, found.get(one.name, 0.0))
    listed = sorted(found, key=lambda n: -found[n])
    false = {n: p for n, p in found.items() if n not in alike | {'unknown'}}
    effects = [n for n in listed if n != 'unknown']
    if listed and listed[0] == truth:
        word = 'first'
    elif listed and listed[0] in alike:
        word = 'tie' if found[listed[0]] <= SURE or truth in found else 'alias'
    elif outcome.diagnosis.verdict == 'ambiguous' and 3.0 * max(
            found.get(n, 0.0) for n in alike) > found[effects[0]]:
        word = 'tie'
    elif truth in ('wrench_delay', 'wrench_lowpass') and abs(shift) > SHIFTED and not any(
            p > 0.5 for p in false.values()):
        word = 'told as recalibrated'
    else:
        word = 'behind unknown' if effects and effects[0] in alike else 'missed'
    return word, max(false.values(), default=0.0)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--only', nargs='*', default=list(LAID), choices=LAID)
    parser.add_argument('-o', '--out', type=Path, help='append a JSON object a case')
    args = parser.parse_args()
    if not DATA.is_dir():
        sys.exit(f'blind_real: {DATA} is not there; set FORCECAL_DATA')
    with tempfile.TemporaryDirectory() as folder:
        recording, calibration = prepared(Path(folder))
    clean, behind, seconds = named(recording, calibration)
    print('| laid on | size | verdict | candidates | closed | | false | CPU s |')
    print('|---|---|---|---|---|---|---|---|')
    print(line('nothing', '', clean, '', 0.0, seconds), flush=True)
    words = []
    for name in args.only:
        changed, size = laid(name, args.seed, recording, calibration)
        outcome, late, seconds = named(changed, calibration)
        word, false = judged(name, outcome, late - behind)
        words.append((word, false))
        print(line(name, size, outcome, word, false, seconds), flush=True)
        if args.out:
            with args.out.open('a') as file:
                file.write(json.dumps({'name': name, 'seed': args.seed, 'word': word,
                                       'false': false, 'seconds': seconds}) + '\n')
    good = sum(w in ('first', 'tie', 'told as recalibrated') for w, _ in words)
    print(f'\n{good} of {len(words)} first or in a tie, {sum(f > 0.5 for _, f in words)} with a '
          f'false name above 0.5, {sum(f > SURE for _, f in words)} above {SURE:g}')


def line(name, size, outcome, word, false, seconds):
    d = outcome.diagnosis
    listed = ', '.join(f'{n} {p:.2f}' for n, p in d.candidates)
    closed = f'{100 * d.gap.closed:.0f} %' if d.gap else ''
    return (f'| {name} | {size} | {d.verdict} | {listed} | {closed} | {word} | {false:.2f} | '
            f'{seconds:.0f} |')


if __name__ == '__main__':
    main()
