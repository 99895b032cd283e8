"""What weighing an accelerometer by what the force confirms of it does, on a real arm.

    python benchmark/accelerometer_share.py

The shares are those of the free motion of ``1-baseline``; the other recording is judged by them,
too. Free motion, where the true force is zero. The recordings are read from ``$FORCECAL_DATA`` or
``../shared/data``.
"""

from dataclasses import replace
import os
from pathlib import Path
import sys

from forcecal_ros.calibrate.delay import estimate_delay, with_delay
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array
from forcecal_ros.observe import ContactEstimate, replay
from forcecal_ros.observe.share import with_share
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))
from kuka import kuka_recording, slow, static_calibration

FOLDER = Path(os.environ.get('FORCECAL_DATA', ROOT.parent / 'shared' / 'data')) / 'kuka_lbr_med'

PARTS = {'1-baseline': (0.15, np.inf), '3-vibrations-contact': (0.15, 0.6)}
"""Free motion in the recordings [s]; in the second it ends with a contact."""


def written(values: Array) -> str:
    """Write three numbers."""
    return ', '.join(f'{x:.3f}' for x in values)


def rows(name: str, known: Calibration, weighed: Calibration) -> None:
    """Print the rows of a recording."""
    recording = kuka_recording(FOLDER, name)
    begin, end = PARTS[name]

    def row(title: str, estimate: ContactEstimate) -> None:
        use = (estimate.t > begin) & (estimate.t < end)
        print(f'| `{name}` | {title} | {written(slow(estimate)[use].std(axis=0))} | '
              f'{written(estimate.measured[use, :3].std(axis=0))} |')

    row('none of it, gravity alone', replay(replace(recording, accelerometer=None), known))
    row('all of it', replay(recording, known))
    row('weighed', replay(recording, weighed))


def main() -> None:
    """Print the table."""
    if not FOLDER.is_dir():
        print(f'no {FOLDER}: set FORCECAL_DATA', file=sys.stderr)
        return
    static, free = static_calibration(FOLDER), kuka_recording(FOLDER, '1-baseline')
    known = with_delay(static, estimate_delay(free, static))
    weighed = with_share(known, free)
    sensor = weighed.accelerometer
    assert sensor is not None and sensor.share is not None and sensor.level is not None
    print('share', ', '.join(f'{x:.2f} +- {std:.2f}' for x, std in zip(
        sensor.share.value, sensor.share.std)), 'level', written(sensor.level.value), 'm/s^2')
    print('| recording, free | accelerometer | std below 10 Hz, x, y, z [N] | std of all [N] |\n'
          '|---|---|---|---|')
    for name in PARTS:
        rows(name, known, weighed)


if __name__ == '__main__':
    main()
