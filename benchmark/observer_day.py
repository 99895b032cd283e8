"""The observer for a day at 1 kHz: memory, drift, and what stamps keep.

    python benchmark/observer_day.py [--hours 24] [--observers 10]

Noise of a standing rig is fed to the step, sample by sample, with stamps that go on for a day.
Each line: the size of all states (pickled) and of the process, the mean of the contact wrench's
force since the last line with the standard error of such a mean, and the worst error of a stamp.
"""

import argparse
from pathlib import Path
import pickle
import resource
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from forcecal_ros.observe import on_accelerometer, on_displacement, on_pose, on_wrench, State
from forcecal_ros.observe.design import design
from forcecal_ros.observe.playback import events
import numpy as np
from observing import calibration, record

PIECE = 10.0
INDEPENDENT = 10.0
"""Independent samples a second that a filter of 16 Hz leaves, on the safe side."""


def main() -> None:
    """Print a line an hour."""
    parser = argparse.ArgumentParser(description='the observer for a day')
    parser.add_argument('--hours', type=float, default=24.0)
    parser.add_argument('--observers', type=int, default=1, help='in this process')
    args = parser.parse_args()
    model = design(calibration())
    pieces = [list(events(record(PIECE, seed=i))) for i in range(8)]
    states = [State()] * args.observers
    count = round(args.hours * 3600 / PIECE)
    every = max(1, count // max(1, round(min(args.hours, 24))))
    sums, n, worst = np.zeros(3), 0, 0.0
    print(' time [h]  states [B]  process [MB]  mean force [N]             in sigmas  stamp [s]')
    for k in range(count):
        begin = k * PIECE
        for t, kind, row in pieces[k % len(pieces)]:
            for i, state in enumerate(states):
                if kind == 'wrench':
                    states[i], out = on_wrench(state, begin + t, row, model)
                elif kind == 'accelerometer':
                    states[i], out = on_accelerometer(state, begin + t, row, model)
                elif kind == 'displacement':
                    states[i], out = on_displacement(state, begin + t, row[0], model)
                else:
                    states[i], out = on_pose(state, begin + t, row[:3], row[3:], model)
                for sample in out:
                    sums += sample.contact[:3]
                    n += 1
                    worst = max(worst, abs(sample.t * 1e3 - round(sample.t * 1e3)) * 1e-3)
        if (k + 1) % every == 0:
            mean = sums / n
            sigma = 0.1 / np.sqrt(n / args.observers / 1000.0 * INDEPENDENT)
            size = sum(len(pickle.dumps(state)) for state in states)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f'{(begin + PIECE) / 3600:9.2f} {size:11d} {memory:13.1f}  '
                  f'{mean[0]:+9.5f} {mean[1]:+9.5f} {mean[2]:+9.5f}  '
                  f'{np.abs(mean / sigma).max():10.2f}  {worst:.1e}', flush=True)
            sums, n = np.zeros(3), 0


if __name__ == '__main__':
    main()
