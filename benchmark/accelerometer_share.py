"""What a share of the accelerometer that follows the motion would do, axis by axis, on a real arm.

    python benchmark/accelerometer_share.py

The observer takes the accelerometer at its word. Where an axis hardly moves, that adds its error.
Here its part beyond gravity, d, is weighed by what it can hold beside its known errors,
1 - e^2 / d^2: d^2 is its power below a corner, over 0.3 s; e is its noise at rest below that
corner and how far it was off gravity in the static poses. What is weighed is d below 19 Hz. The
last rows take for e what the observer itself leaves in free motion, which nobody knows
beforehand. The recordings are read from ``$FORCECAL_DATA`` or ``../shared/data``.
"""

import os
from pathlib import Path
import sys

from forcecal_ros.geometry import Array
from forcecal_ros.identify.delay import estimate_delay, with_delay
from forcecal_ros.observe import replay
from forcecal_ros.recording.streams import Recording
import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from kuka import GRAVITY, kuka_recording, static_calibration, static_recording, table

FOLDER = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_lbr_med'
MEMORY, WEIGHED = 0.3, 120.0
"""Of the power [s]; corner below which d is weighed [rad/s]."""

PARTS = {'1-baseline': (0.15, np.inf), '3-vibrations-contact': (0.15, 0.6)}
"""Free motion in the recordings [s]; in the second it ends with a contact."""


def below(values: Array, rate: float, corner: float = 10.0) -> Array:
    """Return values below a corner [Hz], Butterworth, zero phase."""
    return sosfiltfilt(butter(2, corner, fs=rate, output='sos'), values, axis=0)


def known_error(known, corner: float) -> Array:
    """Return variances of the accelerometer in ft_sensor below a corner [Hz], shape (3,)."""
    to_sensor = np.linalg.inv(known.accelerometer.matrix).T
    rest = table(FOLDER / '0-steady-state_accel.csv')[:, -3:] * GRAVITY @ to_sensor
    poses = static_recording(FOLDER)
    shown = (poses.accelerometer.values - known.accelerometer.offset.value) @ to_sensor
    off = shown - GRAVITY * poses.pose.R_base_sensor[:, 2]
    return below(rest, 254.0, corner).var(axis=0) + off.var(axis=0)


def weighed(d: Array, rate: float, corner: float, variance: Array) -> tuple[Array, Array]:
    """Return the part of ``d`` to be left out, and the share that is kept, both (n, 3)."""
    narrow = sosfilt(butter(2, corner, fs=rate, output='sos'), d, axis=0)
    left_out, share = np.empty_like(d), np.empty_like(d)
    slow, power = d[0].copy(), narrow[0] ** 2
    fast, long = 1 - np.exp(-WEIGHED / rate), 1 - np.exp(-1 / rate / MEMORY)
    for i, (one, low) in enumerate(zip(d, narrow)):
        slow = slow + fast * (one - slow)
        power = power + long * (low ** 2 - power)
        share[i] = np.maximum(0, 1 - variance / np.maximum(np.maximum(power, low ** 2), 1e-12))
        left_out[i] = (1 - share[i]) * slow
    return left_out, share


def rows(name: str, known, in_motion: Array) -> Array:
    """Print the rows of a recording; return what the observer leaves below 10 Hz, variances."""
    recording, mass = kuka_recording(FOLDER, name), float(known.mass)
    with_it = replay(recording, known)
    without = replay(Recording(wrench=recording.wrench, pose=recording.pose), known)
    t, rate = with_it.t, 1 / float(np.median(np.diff(with_it.t)))
    force = with_it.measured[:, :3]
    d = (without.inertial - with_it.inertial)[:, :3] / mass
    used = (t > PARTS[name][0]) & (t < PARTS[name][1])

    def row(title: str, values: Array, share: Array | None = None) -> Array:
        std = below(values, rate)[used].std(axis=0)
        print(f'| `{name}` | {title} | ' + ', '.join(f'{x:.3f}' for x in std) + ' | '
              + ', '.join(f'{x:.3f}' for x in values[used].std(axis=0)) + ' | '
              + ('' if share is None else ', '.join(f'{x:.2f}' for x in share[used].mean(axis=0)))
              + ' |')
        return std

    row('gravity alone', without.measured[:, :3], np.zeros_like(force))
    std = row('accelerometer as it is', force, np.ones_like(force))
    if not in_motion.any():
        in_motion = (std / mass) ** 2
    for title, of in (('known errors', lambda corner: known_error(known, corner)),
                      ('errors in motion', lambda corner: in_motion)):
        for corner in (5.0, 10.0):
            left_out, share = weighed(d, rate, corner, of(corner))
            row(f'{title}, power below {corner:g} Hz', force - mass * left_out, share)
    return in_motion


def main() -> None:
    """Print the table."""
    if not FOLDER.is_dir():
        print(f'no {FOLDER}: set FORCECAL_DATA', file=sys.stderr)
        return
    known = static_calibration(FOLDER)
    known = with_delay(known, estimate_delay(kuka_recording(FOLDER, '1-baseline'), known))
    print('| recording, free | accelerometer | std below 10 Hz, x, y, z [N] | std of all '
          '[N] | mean share |\n|---|---|---|---|---|')
    in_motion = np.zeros(3)
    for name in PARTS:
        in_motion = rows(name, known, in_motion)


if __name__ == '__main__':
    main()
