"""``forcecal fit-rig``: a rig of somebody's robot from recordings of it."""

import argparse
import shlex
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.argument_types import gravity, real
from forcecal_ros.cli.common import (
    add_bag,
    add_json,
    new_parser,
    print_json,
    read_likewise,
    read_poses_of_sensor,
    say,
    say_if_compiling,
    warn,
)
from forcecal_ros.cli.outputs import add_output, FILE
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.rig_fit.fit import RigFit

WALL = ('the recording touches something, and no wall is fitted: a diagnosis with this rig leaves '
        'out phases of contact, until its wall is written into the file')

RIGID = 'rigid_tool.yaml'
"""Gives the tolerances, and what recordings do not tell."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'fit-rig',
        example='forcecal fit-rig my_bag --heldout another_bag -o my_rig.yaml')
    add_bag(parser, several='the rig is fitted to all of them')
    parser.add_argument('--heldout', metavar='BAG',
                        help='recording that chooses the order and judges the model (default: '
                             'every third second)')
    parser.add_argument('--gravity', metavar='M/S^2', type=gravity,
                        help='magnitude of gravity where the robot stands (default: '
                             '9.80665 m/s^2)')
    parser.add_argument('--gravity-direction', metavar=('X', 'Y', 'Z'), nargs=3, type=real,
                        help="direction of gravity in the robot's base, of any length, where base "
                             'is not level (default: 0 0 -1)')
    add_output(parser, '-o', '--output', kind=FILE, suffix='.yaml', metavar='RIG.yaml',
               default='my_rig.yaml',
               help='rig to write; an earlier one is kept as RIG.yaml~')
    add_json(parser)
    parser.set_defaults(run=run, inputs=('bag', 'heldout'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.checks.entry import checked
    from forcecal_ros.core.files import write_text
    from forcecal_ros.core.geometry import STANDARD_GRAVITY
    from forcecal_ros.core.streams import TOUCHING
    from forcecal_ros.rig_fit.fit import document, fit_rig
    from forcecal_ros.sim.rig.file import dump_rig, load_rig
    from forcecal_ros.sim.rig.simulator import waits_for_compiler

    direction = args.gravity_direction
    if direction is not None and not any(direction):
        raise UsageError('--gravity-direction 0 0 0 is no direction; 0 0 -1 is down in a level '
                         'base')
    settings = IdentificationSettings(
        gravity=args.gravity or STANDARD_GRAVITY, wrench_sign=args.wrench_sign or 1,
        gravity_direction=tuple(direction) if direction else None)
    recordings = [checked(read_poses_of_sensor(args, bag)).recording for bag in args.bag]
    heldout = checked(read_poses_of_sensor(args, args.heldout)).recording if args.heldout else None
    say_if_compiling(waits_for_compiler(), 'the simulator')
    fit = fit_rig(recordings, heldout, load_rig(RIGID), settings)
    heading = '\n'.join(f'# {line}' for line in (
        f'Fitted by forcecal fit-rig to {", ".join(args.bag)}. SI units throughout.', '',
        *as_text(fit).splitlines()))
    write_text(args.output, dump_rig(fit.rig, heading + '\n'))
    for note in (*(n for one in recordings for n in one.notes), *fit.notes):
        warn(note)
    if any(phase.name in TOUCHING for one in recordings for phase in one.phases):
        warn(WALL)
    if args.json:
        print_json(document(fit, args.output))
    else:
        say(f'{as_text(fit)}\n\nwritten to {args.output}')
        say('next, with another recording: ' + shlex.join((
            'forcecal', 'diagnose', 'BAG', '--rig', args.output, *read_likewise(args), '-o',
            'gap')))
    return 0


def as_text(fit: 'RigFit') -> str:
    """Say how the robot follows, what hangs on it, and what the model leaves."""
    from forcecal_ros.core.quantity import quantity, size

    rig, turn = fit.rig, fit.rotation
    left, tool = rig.robot.unexplained, rig.tool
    assert left is not None
    lines = [f'commands every {size(rig.robot.period, "s")}']
    lines += [f'{name}: order {a.order or "of another axis"}, lag '
              f'{quantity(a.lag, a.lag_std, "s")}' for name, a in zip('xyz', fit.axes)]
    lines += [(f'orientation: lag {size(turn.lag, "s")}, delay '
              f'{size(rig.servo.orientation_delay or 0.0, "s")}, bandwidth '
              f'{size(rig.servo.orientation_bandwidth, "rad/s")}'),
              f'tool: {size(tool.mass, "kg", 4)}, '
              + ('rigid' if rig.optidrive is None else
                 f'on a spring of {size(rig.optidrive.stiffness, "N/m", 4)}'),
              (f'noise: {size(rig.wrench_sensor.force_noise, "N", 2)}, '
              f'{size(rig.wrench_sensor.torque_noise, "N m", 2)}, {size(fit.noise[0], "m", 2)}, '
              f'{size(fit.noise[1], "rad", 2)}'),
              (f'the model of the robot leaves {size(left.position, "m", 2)} and '
               f'{size(left.orientation, "rad", 2)} RMS of motion that it was not fitted to, '
               f'beyond noise, and rests {size(left.position_offset, "m", 2)} and '
               f'{size(left.orientation_offset, "rad", 2)} from the commands; {_reach(fit)}')]
    if fit.poor:
        lines.append('that is more than noise: a diagnosis takes the measured motion, and '
                     'compares the robot by what it leaves')
    return '\n'.join(lines)


def _reach(fit: 'RigFit') -> str:
    if fit.good_up_to < fit.moved_up_to:
        return f'from {fit.good_up_to:.1f} Hz on that is a tenth of the motion or more'
    return f'that is below a tenth of the motion up to {fit.moved_up_to:.1f} Hz, where that ends'
