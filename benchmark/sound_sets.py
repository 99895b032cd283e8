"""How many sound sets of static poses are called into question, or refused.

    python benchmark/sound_sets.py                # 60 sets at each rate, some two minutes
    python benchmark/sound_sets.py --first 1000   # 60 others

Tool, bias, noise, poses and axes of the accelerometer are drawn at random (test/helpers/
static_sets.py); nothing is wrong with any set, so that every warning and every refusal is false.
"""

from argparse import ArgumentParser
from collections import Counter
import os
from pathlib import Path
import sys

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.core.errors import ForcecalError
from static_sets import static_set

RATES = (0.0, 100.0, 500.0)
"""Of the sensors [Hz]; 0: one sample a pose."""


def said(seed, rate):
    """Return what is said of one set: warnings that suspect an estimate, or why it is refused."""
    try:
        warnings = identify(static_set(seed, rate)[0]).quality['warnings']
    except ForcecalError as error:
        return [f'refused: {error}']
    return [line for line in warnings if 'suspect' in line]


def main():
    """Count, print; status 1 where more than one set in twenty is called into question."""
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--sets', type=int, default=60, help='sets at each rate (60)')
    parser.add_argument('--first', type=int, default=0, help='seed of the first of them (0)')
    args = parser.parse_args()
    sets, most = args.sets, 0
    for rate in RATES:
        found = [lines for seed in range(args.first, args.first + sets)
                 if (lines := said(seed, rate))]
        most = max(most, len(found))
        print(f'{rate:g} Hz: {len(found)} of {sets} sound sets called into question', flush=True)
        for line, count in Counter(line[:70] for lines in found for line in lines).items():
            print(f'  {count:3d}  {line}')
    return int(most > sets / 20)


if __name__ == '__main__':
    raise SystemExit(main())
