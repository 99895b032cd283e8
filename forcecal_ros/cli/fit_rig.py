"""``forcecal fit-rig``: models of your robot from recordings of it."""

import argparse
import shlex
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.errors import UsageError
from forcecal_ros.core.quantity import quantity, size

if TYPE_CHECKING:
    from forcecal_ros.impedance.plant_fit import PlantFit
    from forcecal_ros.rig_fit.fit import RigFit

WALL = ('the recording has contact, but no wall is fitted; a diagnosis with this rig skips '
        'contact phases until you add the wall to the file')

RIGID = 'rigid_tool.yaml'
"""Gives the tolerances, and what recordings do not identify."""

OUTPUTS = {'diagnosis': 'my_rig.yaml', 'impedance': 'plant.yaml'}
"""Default of ``--output`` by purpose."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'fit-rig', inputs=('bag', 'heldout'),
        example='forcecal fit-rig my_bag --heldout another_bag -o my_rig.yaml\n'
                '  forcecal fit-rig shaken_bag --for impedance -o plant.yaml')
    common.add_bag(parser, several='the rig is fitted to all of them')
    parser.add_argument('--for', dest='purpose', choices=tuple(OUTPUTS), default='diagnosis',
                        help='diagnosis: a rig for simulation and diagnosis; impedance: response '
                             'of the robot and compliance of the tool, for the impedance node '
                             '(one BAG, shaken along x)')
    model = common.group(parser, 'model')
    model.add_argument('--heldout', metavar='BAG',
                       help='diagnosis: recording to select the order and validate the model '
                            '(default: every third second of BAG)')
    common.add_gravity(model)
    common.add_output(parser, '-o', '--output', kind='file', metavar='FILE',
                      help='file to write (default: my_rig.yaml, or plant.yaml for impedance)')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    settings = common.gravity_of(args)
    args.output = args.output or OUTPUTS[args.purpose]
    if args.purpose == 'impedance':
        if len(args.bag) > 1 or args.heldout:
            raise UsageError('--for impedance takes one BAG and no --heldout')
        return _fit_plant(args)
    return _fit_rig(args, settings)


def _fit_plant(args: argparse.Namespace) -> int:
    """Fit the models for impedance control."""
    from forcecal_ros.impedance.plant_fit import identify_plant, save_plant, to_document

    recording = common.read_checked(args, args.bag[0], ['target', 'pose', 'wrench', 'optidrive'])
    fit = identify_plant(recording)
    save_plant(fit, args.output)
    return common.show(args, to_document(fit), f'{plant_text(fit)}\n\nwritten to {args.output}',
                       recording.notes)


def _fit_rig(args: argparse.Namespace, gravity: dict[str, Any]) -> int:
    """Fit a rig to simulate and to diagnose by."""
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.core.files import write_text
    from forcecal_ros.core.streams import TOUCHING
    from forcecal_ros.rig_fit.fit import document, fit_rig
    from forcecal_ros.sim.rig.file import dump_rig, load_rig

    recordings = [common.read_checked(args, bag, ()) for bag in args.bag]
    heldout = common.read_checked(args, args.heldout, ()) if args.heldout else None
    common.warn_if_compiling('simulator')
    fit = fit_rig(recordings, heldout, load_rig(RIGID), IdentificationSettings(
        **gravity))
    heading = '\n'.join(f'# {line}' for line in (
        f'Fitted by forcecal fit-rig to {", ".join(args.bag)}. SI units throughout.', '',
        *rig_text(fit).splitlines()))
    write_text(args.output, dump_rig(fit.rig, heading + '\n'))
    notes = [*(note for one in recordings for note in one.notes), *fit.notes]
    if any(phase.name in TOUCHING for one in recordings for phase in one.phases):
        notes.append(WALL)
    then = shlex.join(('forcecal', 'diagnose', 'BAG', '--rig', args.output,
                       *common.read_likewise(args), '-o', 'gap'))
    return common.show(
        args, document(fit, args.output), f'{rig_text(fit)}\n\nwritten to {args.output}\n'
        f'next, with another recording: {then}', notes)


def rig_text(fit: 'RigFit') -> str:
    """Return how the robot follows, its tool, and the residual of the model."""
    rig, turn = fit.rig, fit.rotation
    left, tool, pose = rig.robot.unexplained, rig.tool, rig.pose_sensor
    assert left is not None
    reach = (f'the error is 10 % of the motion or more from {fit.good_up_to:.1f} Hz on'
             if fit.good_up_to < fit.moved_up_to else
             f'the error is below 10 % of the motion up to {fit.moved_up_to:.1f} Hz, the end of '
             'its spectrum')
    lines = [f'commands every {size(rig.robot.period, "s")}',
             *(f'{name}: order {a.order or "of another axis"}, lag '
               f'{quantity(a.lag, a.lag_std, "s")} (95 % interval)'
               for name, a in zip('xyz', fit.axes)),
             (f'orientation: lag {size(turn.lag, "s")}, delay '
              f'{size(rig.servo.orientation_delay or 0.0, "s")}, bandwidth '
              f'{size(rig.servo.orientation_bandwidth, "rad/s")}'),
              f'tool: {size(tool.mass, "kg", 4)}, '
              + ('rigid' if rig.optidrive is None else
                 f'on a spring of {size(rig.optidrive.stiffness, "N/m", 4)}'),
              (f'noise: {size(rig.wrench_sensor.force_noise, "N", 2)}, '
               f'{size(rig.wrench_sensor.torque_noise, "N m", 2)}, '
               f'{size(pose.position_noise, "m", 2)}, {size(pose.orientation_noise, "rad", 2)}'),
              ('held-out error of the robot model beyond noise (RMS): '
               f'{size(left.position, "m", 2)}, {size(left.orientation, "rad", 2)}; '
               f'offset from the commands: {size(left.position_offset, "m", 2)}, '
               f'{size(left.orientation_offset, "rad", 2)}; {reach}')]
    if fit.poor:
        lines.append('this exceeds the noise: a diagnosis uses the measured motion, and compares '
                     'the robot with the model within this error')
    return '\n'.join(lines)


def plant_text(fit: 'PlantFit') -> str:
    """Return the models for impedance control as one table, and how good they are."""
    from math import nan

    from forcecal_ros.report.rows import as_text, Row

    robot, quality = fit.plant.robot, fit.quality
    rows = [('period', 's', robot.period, nan), ('delay', 'periods', robot.delay, nan)]
    for name, estimate in (('feedback', robot.feedback), ('feedforward', robot.feedforward)):
        rows += [(f'{name} {i + 1}', '1', value, std)
                 for i, (value, std) in enumerate(zip(estimate.value, estimate.std))]
    rows += [(f'tool {name}', one.unit, float(one), float(one.std))
             for name, one in vars(fit.plant.slide).items()]
    orders = ', '.join(f'{one["order"]}: {size(one["error"], "m")}' for one in quality['orders'])
    lines = [as_text([Row(name, name, unit, value, std) for name, unit, value, std in rows]), '',
             f'held-out fit {100.0 * quality["fit"]:.2f} %; held-out error by order: {orders}']
    return '\n'.join(lines)
