"""Filter kalman in more noise than was calibrated: fixed gain against the one that follows.

    python benchmark/adaptive_noise.py

On a swinging tool of the nominal rig whose noise is ten times as much for three seconds, with a
push of 20 N, and on the real arm of FORCECAL_DATA, whose noise was measured at rest: in free
motion, and while something vibrates and presses on its hand. Prints a table of figures.md.
"""

from argparse import ArgumentParser
from dataclasses import replace
from math import tau
import os
from pathlib import Path
import sys

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.core.calibration import Estimate, Noise
from forcecal_ros.core.streams import Stream
from forcecal_ros.observe import design, ObserverSettings, replay, Status
import numpy as np
from scipy.signal import butter, sosfiltfilt

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from kuka import GRAVITY, kuka_recording, static_calibration, table
from observing import calibration, GAIN, MASS, push, record, Swing, VOLTS_NOISE

WRENCH_RATE, ACCELEROMETER_RATE = 698.0, 254.0
"""Of the real arm [Hz]."""

FACTORS = (1.0, 3.0, 10.0, 30.0, 100.0)


def with_noise_at_rest(folder, known):
    """Return the calibration with the noise of the arm's sensors at rest."""
    wrench = table(folder / '0-steady-state_wrench.csv')[:, -6:]
    force = table(folder / '0-steady-state_accel.csv')[:, -3:] * GRAVITY
    to_sensor = np.linalg.inv(known.accelerometer.matrix)
    return replace(known, noise=Noise(
        Q=Estimate(np.eye(2), 0.0, '(m, m/s)^2 s'),
        R=Estimate(np.eye(3), 0.0, '(m, m/s, m/s^2)^2 s'),
        wrench=Estimate(np.cov(wrench.T), 0.0, '(N, N m)^2'),
        specific_force=Estimate(to_sensor @ np.cov(force.T) @ to_sensor.T, 0.0, '(m/s^2)^2'),
        wrench_rate=WRENCH_RATE, accelerometer_rate=ACCELEROMETER_RATE))


def on_the_rig():
    """Print noise, bias and time to follow over factors of the noise."""
    print('| noise of the rig, variance | follows after [s] | and back [s] | std of the force, '
          'fixed / following [N] | error of 20 N, fixed / following [N] |')
    print('|---|---|---|---|---|')
    known = calibration()
    std = np.hypot([0.25] * 3 + [0.02] * 3, MASS * VOLTS_NOISE / abs(GAIN)
                   * np.array([1.0] * 3 + [0.14] * 3))
    for factor in FACTORS:
        recording = record(9.0, Swing(turn=0.2, place=(0.05, 0, 0)), push(0, 20.0, 3.0), seed=1)
        t, values = recording.wrench.t, recording.wrench.values.copy()
        on = (t >= 2.0) & (t < 6.0)
        values[on] += (np.sqrt(factor - 1) * std
                       * np.random.default_rng(2).normal(size=(on.sum(), 6)))
        recording = replace(recording, wrench=Stream(t, values))
        fixed, ours = (replay(recording, known, ObserverSettings(adaptive=flag))
                       for flag in (False, True))
        said = t[ours.status & Status.NOISY > 0]
        when = (f'{said[0] - 2.0:.2f}', f'{said[-1] - 6.0:.2f}') if len(said) else ('-', '-')
        late = (t > 4.0) & (t < 6.0)
        print(f'| {factor:g} times | {when[0]} | {when[1]} | '
              + ' / '.join(f'{one.contact[late, 0].std():.3f}' for one in (fixed, ours)) + ' | '
              + ' / '.join(f'{one.contact[late, 0].mean() - 20:.3f}' for one in (fixed, ours))
              + ' |')


def slow(estimate):
    """Return the unfiltered contact force below 5 Hz, without delay: the reference [N]."""
    t = np.arange(estimate.t[0], estimate.t[-1], 1 / WRENCH_RATE)
    rows = [np.interp(t, estimate.t, column) for column in estimate.measured[:, :3].T]
    return np.array([np.interp(estimate.t, t, sosfiltfilt(butter(2, 5.0, fs=WRENCH_RATE,
                                                                output='sos'), row))
                     for row in rows]).T


def on_the_arm():
    """Print what the two make of free motion, and of vibration with contact."""
    folder = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data'))
    folder /= 'kuka_lbr_med'
    if not folder.is_dir():
        print(f'no {folder}: set FORCECAL_DATA', file=sys.stderr)
        return
    known, free = static_calibration(folder), kuka_recording(folder, '1-baseline')
    known = with_noise_at_rest(folder, with_delay(known, estimate_delay(free, known)))
    print(f'\nnoise at rest {np.sqrt(np.diag(known.noise.wrench.value)[:3]).round(3)} N, bandwidth'
          f' by it {design(known).rate / tau:.0f} Hz')
    print('| recording, part | filter | called noisy [%] | scatter about the force below 5 Hz, '
          'x y z [N] | mean less that of the unfiltered force, x y z [N] | passes 3 N at [s] |')
    print('|---|---|---|---|---|---|')
    parts = {'1-baseline': {'free motion': (0.5, 6.0)},
             '3-vibrations-contact': {'before contact': (0.2, 0.6), 'contact': (1.0, 4.1),
                                      'vibration after it': (4.5, 6.0)}}
    for name, spans in parts.items():
        recording = kuka_recording(folder, name)
        ways = [('fixed', replay(recording, known, ObserverSettings(adaptive=False))),
                ('following', replay(recording, known))]
        for part, (begin, end) in spans.items():
            for word, estimate in ways:
                here = (estimate.t > begin) & (estimate.t < end)
                force, reference = estimate.contact[here, :3], slow(estimate)[here]
                scatter = (force - reference).std(axis=0)
                shift = force.mean(axis=0) - estimate.measured[here, :3].mean(axis=0)
                above = estimate.t[np.linalg.norm(estimate.contact[:, :3], axis=1) > 3.0]
                passed = f'{above[0]:.2f}' if part == 'contact' and len(above) else ''
                noisy = 100 * np.mean(estimate.status[here] & Status.NOISY > 0)
                print(f'| {name}, {part} | {word} | {noisy:.0f} | '
                      f'{", ".join(f"{x:.2f}" for x in scatter)} | '
                      f'{", ".join(f"{x:.3f}" for x in shift)} | {passed} |')


if __name__ == '__main__':
    ArgumentParser(description=__doc__.split('\n')[0]).parse_args()
    on_the_rig()
    on_the_arm()
