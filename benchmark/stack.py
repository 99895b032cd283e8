"""Tares at rest and in motion, at every rate of the wrench; prints the table of docs/figures.md.

    python benchmark/stack.py                  # 50 seeds each, some four minutes

Noise is the simulated rig's, stamps jitter by a tenth of a period, one sample in twenty is lost
on every topic. The observer is fed as its node feeds it, and tared at the end.
"""

from argparse import ArgumentParser
from dataclasses import replace
import os
from pathlib import Path
import sys

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'test' / 'helpers')]

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import DataError
from forcecal_ros.observe import design, noise_levels
from observing import calibration, lossy, observed, push, record, Swing

RATES = (10.0, 50.0, 125.0, 500.0, 1000.0)
"""Of the wrench [Hz]."""

OTHERS = (1000.0, 250.0)
"""Rates of accelerometer and pose where they are the rig's [Hz]."""

SECONDS = 3.5
"""Of each recording: what 20 samples at 10 Hz want, and a second for the filters to settle [s]."""

AT_REST = {'at rest': {}}
REFUSED = {
    'shaken by 2 mm at 2 Hz': {'swing': Swing(place=(0.002, 0.0, 0.0))},
    'moved by 2 mm/s': {'swing': Swing(place=(0.02, 0.0, 0.0), place_hz=0.016, start=-1.0)},
    'turned by 5 mrad/s': {'swing': Swing(turn=0.05, turn_hz=0.016, axis=(0.0, 1.0, 0.0),
                                          start=-1.0)},
    'pushed by 5 N from 0.25 s on': {'contact': push(0, 5.0, SECONDS - 0.25)}}
"""What happens to the tool while a tare is asked for, by name."""


def calibrated(rate: float) -> Calibration:
    """Return a calibration whose noise was measured at a rate of the wrench."""
    known = calibration()
    assert known.noise is not None
    return replace(known, noise=replace(known.noise, wrench_rate=rate))


def tared(seed: int, rates: tuple[float, float, float], known: Calibration, **scene: object
          ) -> bool:
    """Return whether a tare succeeds."""
    live = observed(lossy(record(SECONDS, seed=seed, rates=rates, **scene), seed), design(known))
    try:
        live.tare(live.model, noise_levels(known.noise))
    except DataError:
        return False
    return True


def row(name: str, cells: list[str]) -> None:
    print(f'| {" | ".join([name, *cells])} |', flush=True)


def counted(name: str, seeds: int, rates: tuple[float, float], calibrated_at: float | None,
            scene: dict[str, object]) -> list[int]:
    """Print how many tares of each rate succeed."""
    counts = [sum(tared(seed, (rate, *rates), calibrated(calibrated_at or rate), **scene)
                  for seed in range(seeds)) for rate in RATES]
    row(name, [f'{count}/{seeds}' for count in counts])
    return counts


def main() -> int:
    """Count, print; status 1 where fewer than 49 of 50 succeed at rest, or one in motion."""
    parser = ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seeds', type=int, default=50, help='recordings of each cell (50)')
    seeds = parser.parse_args().seeds
    row('tares that succeed, wrench at', [f'{rate:g} Hz' for rate in RATES])
    row('---', ['---'] * len(RATES))
    rest = [counted('at rest', seeds, OTHERS, None, {}),
            counted('at rest, calibrated at 1000 Hz', seeds, OTHERS, 1000.0, {}),
            counted('at rest, accelerometer 125 Hz, poses 50 Hz', seeds, (125.0, 50.0), None, {})]
    moved = [counted(name, seeds, OTHERS, None, scene) for name, scene in REFUSED.items()]
    return int(min(map(min, rest)) < 0.98 * seeds or max(map(max, moved)) > 0)


if __name__ == '__main__':
    raise SystemExit(main())
