"""A tool's mass followed along: how soon a payload is heard of and known, and what pushes do.

    python benchmark/payload.py [--seeds 10]

Payloads on the nominal rig, on a simulated hand that swings, and laid onto the free motion of a
real arm (folder FORCECAL_DATA); then pushes of several kinds, which are no payloads, and what
cannot be told: standstill, and a steady push straight down. Prints tables of results/figures.md.
"""

from argparse import ArgumentParser
import os
from pathlib import Path
import sys

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.observe.payload import TRACKING
from forcecal_ros.observe.playback import follow
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
import gravity_arm as arm
from kuka import kuka_recording, static_calibration
from observing import calibration
from payloads import after, at_point, laid_on, on_the_rig, PUSHES, weight

START, LATER = 5.0, 10.0
"""When the arm is loaded, and after how long the mass is looked at [s]."""


def heard(tools, start):
    """Time from the load until the tracking notices that the tool does not explain the wrench."""
    return next((one.t - start for one in tools if one.t > start and one.state != TRACKING),
                np.nan)


def figures(result, start, mass):
    """Return time until heard of and until known [s], error after 10 s [%], and in its stds."""
    late = [one for one in result.tools if one.t <= start + LATER][-1]
    known = result.changes[0].t - start if result.changes else np.nan
    error = late.mass - mass
    return heard(result.tools, start), known, 100 * error / mass, error / late.mass_std


def row(name, rows):
    """Print the worst of several runs, and the root mean square of errors in their stds."""
    hear, know, error, z = np.array(rows).T
    taken = int(np.isfinite(know).sum())
    soon, late = (f'{np.nanmax(x):.2f}' if np.isfinite(x).any() else 'never'
                  for x in (hear, know))
    if taken < len(rows):
        late = f'{taken} of {len(rows)}, {late}'
    print(f'| {name} | {soon} | {late} | {np.abs(error).max():.2f} | '
          f'{np.sqrt(np.mean(z ** 2)):.1f} |', flush=True)


def on_the_arm(seed, load=0.0, push='none', size=0.0, start=5.0, seconds=20.0):
    """Swing the arm of gravity_arm, load or push from ``start`` on; recording and calibration."""
    calibration, drift = arm.calibrate(np.random.default_rng(seed), seconds=2.0)
    rng = np.random.default_rng(10 * seed + 1)
    moving = arm.free_motion(rng, seconds)
    force = PUSHES[push](moving, rng, size) * after(moving.t, start)
    contact = weight(moving, load, start) + at_point(force)
    return arm.record(moving, rng, contact, accelerometer_bias=drift), calibration


def at_rest(seed, load, start=2.0, seconds=8.0):
    """Let the arm stand still and be loaded."""
    calibration, drift = arm.calibrate(np.random.default_rng(seed), seconds=2.0)
    moving = arm.resting(np.array([[0.3, 0.2, 1.0]]) / np.linalg.norm([0.3, 0.2, 1.0]), seconds)
    return arm.record(moving, np.random.default_rng(seed), weight(moving, load, start),
                      accelerometer_bias=drift), calibration


def payloads(seeds):
    """Print the table of payloads."""
    print('| payload | heard of within [s] | known within [s] | largest error of the mass after '
          '10 s [%] | rms error over its standard error |')
    print('|---|---|---|---|---|')
    for load in (0.5, 1.0, 3.0):
        rows = []
        for seed in range(max(seeds // 3, 1)):
            recording, mass, _ = on_the_rig(load, seed=seed)
            rows.append(figures(follow(recording, calibration()), 4.0, mass))
        row(f'rig of 13 kg, {load:g} kg', rows)
    for load in (0.03, 0.06, 0.3, 1.2, -0.2):
        rows = []
        for seed in range(seeds):
            recording, known = on_the_arm(seed, load, start=START)
            rows.append(figures(follow(recording, known), START, arm.MASS + load))
        row(f'hand of 0.6 kg, {load:g} kg', rows)
    real()


def real():
    """Print the rows of a real arm, whose recording ends after 6.3 s."""
    folder = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data'))
    folder /= 'kuka_lbr_med'
    if not folder.is_dir():
        print(f'no {folder}: set FORCECAL_DATA', file=sys.stderr)
        return
    known, free = static_calibration(folder), kuka_recording(folder, '1-baseline')
    known = with_delay(known, estimate_delay(free, known))
    for load in (0.03, 0.06, 0.2):
        rows = []
        for start in (0.3, 0.6, 1.0, 1.5, 2.0, 2.5):
            recording = laid_on(free, known, load, np.array([0.02, 0.0, 0.08]), start)
            rows.append(figures(follow(recording, known), start, float(known.mass) + load))
        row(f'real arm of 0.93 kg, {load:g} kg', rows)


def pushes(seeds):
    """Print how often a push was taken for a payload, and whether that was said."""
    print('\n| push on the hand | size [N] | taken for a payload | largest mass taken [kg] | '
          'called tracking while pushed [%] |')
    print('|---|---|---|---|---|')
    for push in PUSHES:
        for size in (0.5, 2.0, 10.0) if push != 'none' else (0.0,):
            taken, worst, silent = 0, 0.0, []
            for seed in range(seeds):
                result = follow(*on_the_arm(100 + seed, 0.0, push, size, START))
                taken += bool(result.changes)
                worst = max(worst, abs(result.tools[-1].mass - arm.MASS))
                silent.append(np.mean([one.state == TRACKING for one in result.tools
                                       if one.t > START + 1.0]))
            print(f'| {push} | {size:g} | {taken} of {seeds} | {worst:.3f} | '
                  f'{100 * np.mean(silent):.0f} |', flush=True)


def standstill(seeds):
    """Print what is said of a payload where the tool does not turn."""
    found = [follow(*at_rest(seed, 0.3)).tools[-1] for seed in range(seeds)]
    print(f'\nat rest, 0.3 kg: {", ".join(sorted({one.state for one in found}))}; suspected '
          f'{np.mean([one.suspected for one in found]):.2f} +- '
          f'{np.mean([one.suspected_std for one in found]):.2f} kg')


if __name__ == '__main__':
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seeds', type=int, default=10)
    chosen = parser.parse_args()
    payloads(chosen.seeds)
    pushes(chosen.seeds)
    standstill(min(chosen.seeds, 3))
