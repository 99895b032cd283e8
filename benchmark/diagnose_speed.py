"""Cost of ``forcecal diagnose`` with the whole library against the length of the recordings.

    python benchmark/diagnose_speed.py [SECONDS ...]

Pairs of recordings of the simulated rig with a late force sensor, one to fit on and one to judge
on, swinging and turning; processor time and time on the wall of one diagnosis each.
"""

import sys
import time

from forcecal_ros.diagnose.pipeline import diagnose
from forcecal_ros.geometry import rotation_from_vector
from forcecal_ros.samples import PoseStream
from forcecal_ros.sim.effects import with_effects
from forcecal_ros.sim.offline import simulate
from forcecal_ros.sim.rig_file import load_rig
import numpy as np
from timing import head, row

LENGTHS = (15.0, 30.0, 60.0)
DELAY = 0.004


def commands(seconds: float, hertz: float) -> PoseStream:
    """Rest, then swing along x and turn about two axes; seldom twice the same."""
    rig = load_rig()
    t = np.arange(0.0, seconds, rig.robot.period)
    angle, grow = 2 * np.pi * hertz * t, np.clip((t - 2.0) / 2.0, 0.0, 1.0)[:, np.newaxis]
    position = np.array(rig.home.position) + 0.01 * grow * np.stack(
        [np.sin(2 * angle), np.sin(0.7 * angle), np.sin(1.3 * angle)], axis=1)
    turns = grow * np.stack([0.3 * np.sin(angle), 0.4 * np.sin(0.61 * angle), 0.0 * t], axis=1)
    home = np.diag([1.0, -1.0, -1.0])
    return PoseStream(t, position, np.array([home @ rotation_from_vector(turn)
                                             for turn in turns]))


def main() -> None:
    lengths = [float(word) for word in sys.argv[1:]] or LENGTHS
    rig = load_rig()
    faulty = with_effects(rig, {'wrench_delay': {'delay': DELAY}})
    head('pair of recordings', 'processor time', 'on the wall', 'wanted', 'a recorded second',
         'verdict')
    for seconds in lengths:
        pair = [simulate(faulty, commands(seconds, hertz), seed=seed)
                for seed, hertz in enumerate((0.8, 1.1))]
        used, start = time.process_time(), time.perf_counter()
        found = diagnose(*pair, rig).diagnosis
        used, wall = time.process_time() - used, time.perf_counter() - start
        row(f'2 x {seconds:g} s', f'{used:.0f} s', f'{wall:.0f} s',
            '60 s' if seconds == 60.0 else '', f'{used / seconds / 2:.2f} s',
            f'{found.verdict} {[e.name for e in found.effects]}')


if __name__ == '__main__':
    main()
