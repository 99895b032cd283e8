"""Contact safety: faults while the impedance node moves and presses, tried and survived.

    python benchmark/fault_impedance.py [--fault TEXT] [--phase WORD] [--json FILE]

Simulated rig, observer and impedance node run as processes of their own. In each phase of a
contact task each fault happens once. The table says for how long commands still went towards the
wall (counted in commands, 4 ms each; it may be 100 ms); the way back that ends a task at the wall
is not counted. Survived: that, the task aborted, no force above the limit, and a tool that is free
of the wall in the end, unless nobody is left to lead it there.
"""

from pathlib import Path
import sys
import tempfile

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))

from calibration_runs import rehearse
from fault_motion_runs import ABORT, Bench, FOREIGN, LIMITS, PERIOD, STOP
from fault_table import arguments, count, go, known, table
from forcecal_ros.impedance.session import Bounds
from forcecal_ros.io.calibration_file import save
from forcecal_ros.sim.rig.file import load_rig
from geometry_msgs.msg import WrenchStamped
import numpy as np
from processes import own_domain

PHASES = ('free', 'approach', 'contact', 'retract')
NODE = 'sequencer'
"""What the bench calls the node that moves the robot."""

KILLED = f'SIGKILL to {NODE}'
GONE = (KILLED, 'SIGKILL to sim')
FAULTS = ('wrench off', 'wrench stuck', 'wrench garbage', 'wrench delayed', 'pose off',
          'pose stuck', 'pose delayed', 'robot runaway', f'SIGINT to {NODE}', f'SIGTERM to {NODE}',
          KILLED, 'SIGKILL to observer', 'SIGKILL to sim', FOREIGN, ABORT)
BACK = 2e-5
"""Commands of a robot that stands may go to and fro by that much [m]."""


class ContactBench(Bench):
    """The bench of the sequencer with the impedance node in its place."""

    def __init__(self, calibration: Path) -> None:
        super().__init__()
        self.calibration, self.force, self.away = calibration, [0.0], False
        self.live.hear(WrenchStamped, 'sim/contact_wrench',
                       lambda stamp, values: self.force.append(-values[0]))

    def _start(self, module: str) -> None:
        if module == 'sim':
            self.away = False
        if module == 'observer':
            self.live.start(module, calibration__file=self.calibration)
        else:
            super()._start(module)

    def _start_sequencer(self, name: str, remap: list[str]) -> None:
        self.live.start(
            'impedance', name, [f'impedance/{word}:={NODE}/{word}' for word in (
                'start', 'abort', 'phase')], task__swings=1, task__hold=0.6,
            limits__workspace_max=LIMITS.workspace_max.tolist())

    def _reached(self, phase: str) -> bool:
        """Begin with a robot at home, which only a new one is after an abort."""
        live = self.live
        for module in ('sim', 'observer') if self.away else ():
            self._kill(module)
            self._start(module)
        self.away = True
        live.until(lambda: live.call(f'{NODE}/start').success, 'start')
        live.phases.clear()
        live.reasons.clear()
        self.commands.clear()
        self.force[:] = [0.0]
        live.until(lambda: {phase, 'aborted'} & {*live.phases}, phase)
        live.until(lambda: 'aborted' in live.phases or (
            self.force[-1] > 10.0 if phase == 'contact' else self.moving(-12).all()), phase)
        return 'aborted' not in live.phases

    def _verdict(self, fault: str, first: int) -> tuple[str, float]:
        stamps = np.array([stamp for stamp, _ in self.commands[first - 1:]]) * 1e-9
        x = np.array([values[0] for _, values in self.commands[first - 1:]])
        ahead = np.flatnonzero(np.diff(x) > BACK) + 1
        forward = (ahead[-1] * PERIOD) if len(ahead) else 0.0
        speed = np.abs(np.diff(x) / np.diff(stamps)).max(initial=0.0)
        if speed > 1.02 * Bounds().speed:
            return f'FAILED: {speed:.2f} m/s', forward
        if forward > STOP:
            return f'FAILED: forward for {forward:.3f} s', forward
        if max(self.force) > Bounds().force:
            return f'FAILED: {max(self.force):.0f} N', forward
        if fault not in GONE and self.force[-1]:
            return f'FAILED: presses with {self.force[-1]:.1f} N', forward
        if fault != KILLED and self.live.phases[-1] != 'aborted':
            return f'FAILED: {self.live.phases[-1]}', forward
        return 'stopped', forward


def main() -> int:
    """Print the table."""
    args = arguments('faults while the robot presses')
    outcomes = known(args)
    with tempfile.TemporaryDirectory() as folder, own_domain(Path(folder)):
        calibration = Path(folder) / 'calibration.yaml'
        save(rehearse(load_rig(), 'acc1', 1), calibration)
        with ContactBench(calibration) as bench:
            go(bench, FAULTS, PHASES, args, outcomes)
    print(table(outcomes, FAULTS, PHASES).replace(NODE, 'impedance'))
    return count(outcomes)


if __name__ == '__main__':
    raise SystemExit(main())
