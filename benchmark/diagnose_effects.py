"""Which single effects are found, on simulated recordings whose cause is known.

Give a folder of pairs of bags, ``NAME_SEED_a`` and ``NAME_SEED_b`` (``none_SEED_a``: no effect),
as ``forcecal simulate`` writes them; each pair is diagnosed, the first bag to fit on, the second
to judge on, and a line says whether the effect NAME came out first.
"""

import argparse
from pathlib import Path
import time

from forcecal_ros.bags import read_recording
from forcecal_ros.diagnose.pipeline import diagnose
from forcecal_ros.sim.rig_file import load_rig


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=Path)
    rig, right, total = load_rig(), 0, 0
    for first in sorted(parser.parse_args().folder.glob('*_a')):
        name = first.name.rsplit('_', 2)[0]
        began = time.process_time()
        found = diagnose(read_recording(first),
                         read_recording(first.with_name(first.name[:-1] + 'b')), rig).diagnosis
        named = [e.name for e in found.effects]
        ok = found.verdict == 'no_gap' if name == 'none' else named[:1] == [name]
        right, total = right + ok, total + 1
        print(f'{"right" if ok else "WRONG"} {first.name}: {found.verdict} {named} '
              f'({time.process_time() - began:.0f} s CPU)', flush=True)
    print(f'{right} of {total} right')


if __name__ == '__main__':
    main()
