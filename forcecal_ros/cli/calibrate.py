"""``forcecal calibrate``: identify tool, sensor and noise from a recording."""

import argparse
from datetime import datetime, timezone
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.argument_types import angle, gravity, nearby, positive, real
from forcecal_ros.cli.common import (
    from_arguments,
    new_parser,
    read_checked,
    read_likewise,
    with_reading_of,
)
from forcecal_ros.cli.contact import add_bandwidth, bandwidth_of
from forcecal_ros.cli.each_recording import add_bags, Answer
from forcecal_ros.cli.each_recording import run as run_each
from forcecal_ros.cli.outputs import add_output, FILE, is_stdout
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'calibrate',
        example='forcecal calibrate my_bag --topic wrench=/ft/data -o calibration.yaml\n'
                '  forcecal calibrate ft_calib_data.yaml   # a file of force_torque_tools or '
                'ft_tools')
    add_bags(parser)
    add_identification(parser)
    parser.add_argument('--free-motion', metavar='BAG2',
                        help='recording of motion without contact, where BAG holds static poses '
                             'only: it tells the delay between the sensors, and how much of the '
                             'accelerometer the force confirms on each axis')
    parser.add_argument('--matrix', metavar='C.yaml',
                        help='calibration.yaml of forcecal insitu whose matrix turns the raw '
                             'channels of the wrench topic into a wrench')
    parser.add_argument('--tool-mass', metavar='KG', type=positive,
                        help='what a scale says the tool weighs: forces that make something else '
                             'of it are refused, with the unit that they may be in')
    add_output(parser, '-o', '--output', kind=FILE, suffix='.yaml', metavar='FILE',
               default='calibration.yaml',
               help='calibration to write, - for standard output; an earlier one is kept as '
                    'FILE~; of several BAGs, a folder for them')
    add_output(parser, '--report', kind=FILE, suffix='.html', metavar='FILE',
               help='write an HTML report as well; of several BAGs, a folder for them')
    parser.set_defaults(run=run, inputs=('bag', 'free_motion', 'matrix'))


def add_identification(parser: argparse.ArgumentParser) -> None:
    """Add how a recording is calibrated."""
    parser.add_argument('--gravity', metavar='M/S^2', type=gravity,
                        help='magnitude of gravity where the robot stands (default: '
                             '9.80665 m/s^2)')
    parser.add_argument('--gravity-direction', metavar=('X', 'Y', 'Z'), nargs=3, type=real,
                        help="direction of gravity in the robot's base, of any length, where base "
                             'is not level (default: 0 0 -1)')
    parser.add_argument('--sensor-rotation', metavar=('X', 'Y', 'Z'), nargs=3, type=real,
                        help="rotation vector of the wrench's axes, seen from the frame of the "
                             'pose [deg], where the sensor sits turned on its flange')
    parser.add_argument('--coupling', choices=('dc', 'ac'), default='dc',
                        help='of the accelerometer; ac: it lets gravity decay (high-pass)')
    parser.add_argument('--cutoff', metavar='HZ', type=positive,
                        help='corner of an ac accelerometer (default: estimated)')
    parser.add_argument('--accelerometer-position', metavar=('X', 'Y', 'Z'), nargs=3, type=nearby,
                        help='of the accelerometer in ft_sensor [m] (default: estimated)')
    parser.add_argument('--theta', metavar='RAD', type=angle, default=0.0,
                        help="the paper's angle of the two poses about z")
    parser.add_argument('--observer', choices=('kalman', 'newton'), default='kalman',
                        help='which observer the calibration asks for')
    parser.add_argument('--design', choices=('kalman', 'poles'), default='kalman',
                        help="how the paper's gain is designed: Riccati equation or pole "
                             'placement')
    add_bandwidth(parser, ('2.5 N/sqrt(s); kept in the calibration', '2 Hz; kept likewise',
                           '250 Hz; kept likewise'))
    parser.add_argument('--robot', metavar='NAME',
                        help='whose sensor it is, kept in the calibration for forcecal fleet')


def check_identification(args: argparse.Namespace) -> None:
    """Refuse what does not go together."""
    if args.gravity_direction is not None and not any(args.gravity_direction):
        raise UsageError('--gravity-direction 0 0 0 is no direction; 0 0 -1 is down in a level '
                         'base')
    if args.cutoff is not None and args.coupling != 'ac':
        raise UsageError('--cutoff is the corner of an ac accelerometer; give --coupling ac as '
                         'well')
    bandwidth_of(args)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    check_identification(args)
    return run_each(args, answer)


def answer(args: argparse.Namespace) -> Answer:
    """Calibrate from one recording."""
    from forcecal_ros.calibrate.delay import estimate_delay, with_delay
    from forcecal_ros.core.sensor_matrix import (
        recording_corrected,
        required_sensor_matrix,
        with_matrix_of,
    )
    from forcecal_ros.io.calibration_file import load

    if Path(args.bag).suffix in ('.yaml', '.yml'):
        return _written(_of_stated_mass(_with_mounting(load(args.bag), args), args), args, ())
    matrix = load(args.matrix) if args.matrix else None
    recording = read_checked(args, args.bag, ['wrench', 'pose'], raw_wrench=matrix is not None)
    if matrix:
        recording = recording_corrected(recording, required_sensor_matrix(matrix, args.matrix))
    motion = None
    if args.free_motion:
        motion = read_checked(args, args.free_motion, raw_wrench=matrix is not None)
        if matrix:
            motion = recording_corrected(motion, required_sensor_matrix(matrix, args.matrix))
    with with_reading_of(recording):
        calibration = _of_stated_mass(calibrated(recording, args), args)
    if motion:
        calibration = with_delay(calibration, estimate_delay(motion, calibration))
    if args.report:
        write_report(args, recording, calibration)
    if matrix:
        calibration = with_matrix_of(calibration, matrix)
    return _written(calibration, args, recording.notes)


def _of_stated_mass(calibration: 'Calibration', args: argparse.Namespace) -> 'Calibration':
    """Return a calibration whose tool weighs what a scale says."""
    from forcecal_ros.checks.hypotheses import refuse_other_mass

    if args.tool_mass is not None:
        std = float(calibration.mass.std)
        refuse_other_mass(float(calibration.mass), std if math.isfinite(std) else 0.0,
                          args.tool_mass)
    return calibration


def _with_mounting(calibration: 'Calibration', args: argparse.Namespace) -> 'Calibration':
    """Keep in a calibration that was read by which transform its poses are to be taken."""
    from dataclasses import replace

    from forcecal_ros.observe.frames import agreed, mounting_of, numbers_of

    with from_arguments():
        given = mounting_of(args.sensor_from_pose or (), '--sensor-from-pose')
    return replace(calibration, sensor_from_pose=numbers_of(agreed(given, calibration, args.bag)))


def _written(calibration: 'Calibration', args: argparse.Namespace, notes: tuple[str, ...]
             ) -> Answer:
    """Write a calibration and say what is in it."""
    from forcecal_ros.core.quantity import quantity
    from forcecal_ros.io.calibration_file import save, to_document
    from forcecal_ros.report.rows import as_text, promises, residuals, table

    save(calibration, args.output)
    warnings = calibration.quality.get('warnings', ())
    return Answer(
        to_document(calibration),
        as_text([*table(calibration), *promises(calibration), *residuals(calibration)])
        + f'\n\nwritten to {args.output}',
        f'mass {quantity(float(calibration.mass), float(calibration.mass.std), "kg")}, '
        f'written to {args.output}',
        (*(note for note in notes if not any(note in warning for warning in warnings)), *warnings,
         *calibration.quality.get('questions', ())))


def calibrated(recording: 'Recording', args: argparse.Namespace) -> 'Calibration':
    """Identify as the arguments say."""
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.core.geometry import STANDARD_GRAVITY
    from forcecal_ros.observe.design import with_kalman_gains
    from forcecal_ros.observe.settings import ObserverSettings

    turn = args.sensor_rotation and [math.radians(x) for x in args.sensor_rotation]
    position, direction = args.accelerometer_position, args.gravity_direction
    calibration = identify(recording, IdentificationSettings(
        gravity=args.gravity or STANDARD_GRAVITY,
        gravity_direction=tuple(direction) if direction else None,
        sensor_rotation=(turn[0], turn[1], turn[2]) if turn else None,
        theta=args.theta, coupling=args.coupling, cutoff=args.cutoff,
        accelerometer_position=tuple(position) if position else None,
        wrench_sign=args.wrench_sign or 1, observer_mode=args.observer,
        observer_design=args.design,
        source={'recording': recording.source, **({'robot': args.robot} if args.robot else {}),
                'created': datetime.now(timezone.utc).isoformat(timespec='seconds')}))
    return with_kalman_gains(calibration, ObserverSettings(**bandwidth_of(args)))


def write_report(args: argparse.Namespace, recording: 'Recording', calibration: 'Calibration'
                 ) -> None:
    """Write the HTML report, with the observer run over the same recording."""
    from forcecal_ros.core.atomic_files import write_text
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.observe import replay
    from forcecal_ros.report.calibration import render
    from forcecal_ros.report.words import estimated_by

    estimate = replay(recording, calibration)
    contact = Stream(estimate.t, estimate.contact, calibration.sensor_frame)
    write_text(args.report, render(
        recording, calibration, contact, step=None if is_stdout(args.output) else estimated_by(
            args.bag, args.output, read_likewise(args, poses=False))))
