"""
The contact experiment of [Gamez2005] V and VI on the simulated rig.

It compares what the impedance law feeds back (true force, raw sensor, gravity-compensated sensor,
observers), prints the tables and writes Figures 5 to 8::

    python3 examples/gamez2005 -o contact_experiment
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
import sys

from forcecal_ros.calibrate.pipeline import identify
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ForcecalError
from forcecal_ros.effects.rig import Rig
from forcecal_ros.impedance.law import (
    design,
    DesignSettings,
    Law,
    Regulator,
    TargetImpedance,
)
from forcecal_ros.impedance.plant import load_plant
from forcecal_ros.impedance.session import Program, Stage, Task
from forcecal_ros.motion.limits import Limits
from forcecal_ros.motion.plan import calibration_plan, prepare, preview, Timing
from forcecal_ros.motion.profiles import nominal_poses, Pace, step_goal
from forcecal_ros.observe.design import with_kalman_gains
from forcecal_ros.sim.rig.file import load_rig
from forcecal_ros.sim.rig.simulator import simulate
from gamez_assess import assess
from gamez_figures import Experiment, pictures, Row, text
from gamez_loop import feedback_of, run_closed_loop, SOURCES

OSCILLATION = Program(tuple(
    Stage('free', 0.0 if k % 2 else -0.04, 0.3) for k in range(16)))
"""Reference that goes back and forth in free space without a pause, [Gamez2005] Fig. 8."""

SETTLE = 1.0
"""Wait before each measurement, until the tool has stopped ringing on its spring [s]."""


def rehearse(rig: Rig, accelerometer: str | None = None, seed: int | None = None) -> Calibration:
    """
    Calibrate a simulated rig as the sequencer would, nothing known beforehand.

    ``accelerometer`` is ``acc1``, ``acc2`` or, where None, the one that the rig file mounts.
    """
    timing, poses = Timing(), nominal_poses()
    home = next(iter(poses.values()))
    plan = calibration_plan(poses, step_goal(home, timing.step_distance), timing)
    target, phases = preview(prepare(plan, home, Pace(), Limits()), 1.0 / rig.robot.period, SETTLE)
    recording = replace(simulate(rig, target, accelerometer=accelerometer, seed=seed),
                        phases=phases)
    coupling = 'ac' if rig.accelerometer.model(accelerometer).highpass > 0.0 else 'dc'
    return with_kalman_gains(identify(recording, IdentificationSettings(coupling=coupling)))


def conduct(rig: Rig, accelerometers: Sequence[str], law: Law, *, seed: int = 0, latency: int = 0,
            task: Task = Task(), tell: Callable[[str], None] = print) -> Experiment:
    """
    Run the experiment with ``acc1``, ``acc2`` or both.

    Parameters
    ----------
    seed : int
        Of the noise, the same in every run; the calibration has the next one.
    latency : int
        Periods that a command takes beyond the robot's own delay.
    tell : callable
        Called with the name of each run before it starts.
    """
    program = task.program()
    calibrations, runs, oscillations, rows = {}, {}, {}, []
    for name in accelerometers:
        tell(f'{name}: calibration')
        calibrations[name] = calibration = rehearse(rig, name, seed + 1)
        follow = partial(run_closed_loop, rig, accelerometer=name, seed=seed, latency=latency)
        for source in SOURCES:
            tell(f'{name}: {source}')
            runs[name, source] = follow(
                program, feedback_of(source, calibration, name), Regulator(law))
            rows.append(Row(name, source, assess(runs[name, source], runs[name, 'true'], program)))
        tell(f'{name}: oscillation')
        oscillations[name] = follow(
            OSCILLATION, feedback_of('kalman', calibration), Regulator(law))
    return Experiment(calibrations, runs, oscillations, tuple(rows))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser('gamez2005', description='The contact experiment of '
                                     '[Gamez2005] V and VI on the simulated rig.')
    parser.add_argument('-o', '--output', type=Path, required=True, help='folder for the pictures')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'), help='default: both')
    parser.add_argument('--rig', metavar='RIG.yaml', help='default: the nominal rig')
    parser.add_argument('--plant', metavar='PLANT.yaml', help='default: that of the nominal rig')
    for name, default, unit in (('mass', 13.0, 'kg'), ('damping', 250.0, 'N s/m'),
                                ('stiffness', 1000.0, 'N/m')):
        parser.add_argument(f'--{name}', type=float, default=default, metavar=unit.upper(),
                            help=f'{name} of the impedance (default: %(default)g {unit})')
    parser.add_argument('--latency', type=int, default=0, metavar='PERIODS',
                        help="delay of a command beyond the robot's own")
    parser.add_argument('--seed', type=int, default=0, help='of the sensor noise')
    args = parser.parse_args(arguments)
    try:
        target = TargetImpedance(args.mass, args.damping, args.stiffness)
        law = design(load_plant(args.plant), target, DesignSettings(latency=args.latency)).law
        experiment = conduct(load_rig(args.rig), [args.accelerometer] if args.accelerometer
                             else ['acc1', 'acc2'], law, seed=args.seed, latency=args.latency)
    except ForcecalError as error:
        print(f'gamez2005: {error}', file=sys.stderr)
        return 1
    args.output.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures(experiment).items():
        (args.output / name).write_bytes(picture)
    print(text(experiment))
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
