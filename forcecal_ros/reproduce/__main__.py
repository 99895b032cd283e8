"""The contact experiment of [Gamez2005] V and VI, offline: python3 -m forcecal_ros.reproduce."""

import argparse
from collections.abc import Sequence
from math import isfinite
import sys
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.common import (
    bar,
    from_arguments,
    new_parser,
    positive,
    print_json,
    say,
    warn_if_compiling,
    whole,
)
from forcecal_ros.cli.main import main, Parser
from forcecal_ros.cli.outputs import add_output, RESULTS
from forcecal_ros.core.files import write_results

if TYPE_CHECKING:
    from forcecal_ros.reproduce.experiment import Experiment

RUNS = 7
"""Steps of work for each accelerometer: calibration, five feedbacks, the oscillation."""

FILES = ('report.html', 'figure_[5-8]_acc[12].png')
"""All that the experiment may write."""


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line."""
    top = Parser(prog='python3 -m forcecal_ros')
    parser = new_parser(
        top.add_subparsers(required=True), 'reproduce',
        summary='simulate the contact experiment, and compare what is fed back: raw sensor, '
                'gravity-compensated, observers',
        example='python3 -m forcecal_ros.reproduce -o contact_experiment')
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='DIR', required=True,
               help='folder for report.html and the pictures; earlier results are kept as '
                    'NAME~')
    parser.add_argument('--accelerometer', choices=('acc1', 'acc2'),
                        help='only this one (default: both, one after the other)')
    parser.add_argument('--rig', metavar='RIG.yaml', help='rig file (default: the nominal rig)')
    parser.add_argument('--plant', metavar='PLANT.yaml',
                        help='models by forcecal fit-rig --for impedance (default: those of the '
                             'nominal rig)')
    parser.add_argument('--mass', type=positive, default=13.0, metavar='KG',
                        help='mass of the impedance that the tool shall have')
    parser.add_argument('--damping', type=positive, default=250.0, metavar='NS/M',
                        help='damping of that impedance')
    parser.add_argument('--stiffness', type=positive, default=1000.0, metavar='N/M',
                        help='stiffness of that impedance, to its reference')
    parser.add_argument('--latency', type=whole, default=0, metavar='PERIODS',
                        help="delay of a command beyond the robot's own; the law is designed for "
                             'it, and it is simulated')
    parser.add_argument('--seed', type=whole, default=0, help='of the sensor noise')
    parser.set_defaults(run=run)
    return top.parse_args(['reproduce', *arguments])


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.impedance.design import design
    from forcecal_ros.impedance.plant.file import load_plant
    from forcecal_ros.impedance.settings import DesignSettings, Wanted
    from forcecal_ros.reproduce.experiment import conduct
    from forcecal_ros.reproduce.report import pictures, render, text
    from forcecal_ros.sim.rig.file import load_rig
    from forcecal_ros.sim.rig.simulator import waits_for_compiler

    with from_arguments():
        wanted = Wanted(args.mass, args.damping, args.stiffness)
        settings = DesignSettings(latency=args.latency)
    rig = load_rig(args.rig)
    designed = design(load_plant(args.plant), wanted, settings)
    warn_if_compiling(waits_for_compiler(), 'the simulator')
    names = [args.accelerometer] if args.accelerometer else ['acc1', 'acc2']
    with bar(args, total=RUNS * len(names), unit=' runs') as done:
        def begin(what: str) -> None:
            done.set_description(what)
            done.update()

        experiment = conduct(rig, names, designed.law, seed=args.seed,
                             latency=args.latency, tell=begin)
    images = pictures(experiment)
    origin = f'simulated rig{f" {args.rig}" if args.rig else ""}, noise seed {args.seed}'
    write_results(args.output, {
        **images, 'report.html': render(experiment, images, origin)}, FILES)
    if args.json:
        print_json(document(experiment))
        return 0
    say(text(experiment))
    say(f'written to {args.output}: report.html, {", ".join(images)}')
    return 0


def document(experiment: 'Experiment') -> dict[str, Any]:
    """Return the tables as JSON can hold them; what never settles is null."""
    return {name: {
        'feedback': {
            row.feedback: {key: value if isfinite(value) else None
                           for key, value in row.figures._asdict().items()}
            for row in experiment.rows if row.accelerometer == name},
        'notes': list(experiment.notes[name]),
        'K': (calibration.observer.K.value.tolist() if calibration.observer else None),
    } for name, calibration in experiment.calibrations.items()}


if __name__ == '__main__':
    sys.exit(main(None, parse))
