"""Motion safety: every fault in every phase over DDS, tried and survived.

    python benchmark/fault_motion.py [--fault TEXT] [--phase WORD] [--json FILE]

With a file it can be run in pieces: cells whose outcome the file holds are not tried again.
Simulated rig, sequencer and observer run as processes of their own. In each phase of both
sequences each fault happens once; the table says for how long commands still moved (counted in
commands, 4 ms each, from the moment the fault was confirmed), and that they never moved again.
"""

from pathlib import Path
import sys
import tempfile

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from fault_motion_runs import Bench, FAULTS, PHASES
from fault_table import arguments, count, go, known, table
from processes import own_domain


def main() -> int:
    """Print the table."""
    args = arguments('faults while the robot moves')
    outcomes = known(args)
    with tempfile.TemporaryDirectory() as logs, own_domain(Path(logs)):
        for clock in (False, True):
            with Bench(clock) as bench:
                go(bench, [fault for fault in FAULTS if fault.startswith('clock') == clock],
                   PHASES, args, outcomes)
    print(table(outcomes, FAULTS, PHASES))
    return count(outcomes)


if __name__ == '__main__':
    raise SystemExit(main())
