"""``forcecal calibrate``: estimate tool, sensor and noise from a recording."""

import argparse
from datetime import datetime, timezone
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.cli.many import add_bags, Answer, MANY
from forcecal_ros.cli.many import run as run_each
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'calibrate', inputs=('bag', 'free_motion', 'matrix'),
        example='forcecal calibrate my_bag --topic wrench=/ft/data -o calibration.yaml\n'
                '  forcecal calibrate ft_calib_data.yaml   # a file of force_torque_tools or '
                'ft_tools')
    add_bags(parser)
    options = common.group(parser, 'further data')
    options.add_argument('--free-motion', metavar='BAG2',
                         help='recording of motion without contact, if BAG holds static poses '
                              'only: gives the delay between the sensors')
    options.add_argument('--matrix', metavar='C.yaml',
                         help='calibration.yaml of forcecal insitu whose matrix converts the raw '
                              'channels of the wrench topic to a wrench')
    options.add_argument('--tool-mass', metavar='KG', type=common.positive,
                         help='mass of the tool, measured on a scale; forces that give another '
                              'mass are refused, and their likely unit is printed')
    setup = common.group(parser, 'robot and sensors')
    setup.add_argument('--robot', metavar='NAME',
                       help='name of the robot, stored in the calibration for forcecal fleet')
    common.add_gravity(setup)
    setup.add_argument('--sensor-rotation', metavar=('X', 'Y', 'Z'), nargs=3, type=common.real,
                       help="rotation vector of the wrench's axes in the frame of the "
                            'pose [deg], if the sensor is rotated on its flange')
    setup.add_argument('--coupling', choices=('dc', 'ac'), default='dc',
                       help='coupling of the accelerometer; ac: high-passed, gravity decays')
    setup.add_argument('--cutoff', metavar='HZ', type=common.positive,
                       help='corner frequency of an ac accelerometer (default: estimated)')
    setup.add_argument('--accelerometer-position', metavar=('X', 'Y', 'Z'), nargs=3,
                       type=common.nearby,
                       help='accelerometer position in ft_sensor [m] (default: estimated)')
    observer = common.group(parser, 'observer')
    observer.add_argument('--filter', choices=('kalman', 'newton'), default='kalman',
                          help='filter of the observer that uses the calibration')
    observer.add_argument('--contact-walk', metavar='N/SQRT(S)', type=common.positive,
                          help='expected random walk of a contact force; with the noise it sets '
                               'the bandwidth of filter kalman (default: 2.5 N/sqrt(s)); stored '
                               'in the calibration')
    observer.add_argument('--bandwidth-min', metavar='HZ', type=common.positive,
                          help='lower limit of this bandwidth (default: 2 Hz); stored as well')
    observer.add_argument('--bandwidth-max', metavar='HZ', type=common.positive,
                          help='upper limit of this bandwidth (default: 250 Hz); stored as well')
    common.add_output(parser, '-o', '--output', kind='file', suffix='.yaml', metavar='FILE',
                      default='calibration.yaml',
                      help='calibration to write, - for standard output', more=MANY)
    common.add_output(parser, '--report', kind='file', suffix='.html', metavar='FILE',
                      help='also write an HTML report', more=MANY)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.observe.settings import BANDWIDTH_LIMITS

    common.gravity_of(args)
    low, high = (args.bandwidth_min or BANDWIDTH_LIMITS[0],
                 args.bandwidth_max or BANDWIDTH_LIMITS[1])
    if low > high:
        raise UsageError(f'--bandwidth-min is {low:g} Hz, above --bandwidth-max of {high:g} Hz; '
                         'give both options, the smaller one as --bandwidth-min')
    if args.cutoff is not None and args.coupling != 'ac':
        raise UsageError('--cutoff applies to ac accelerometers only; also give --coupling ac')
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
        return _write(_as_stated(load(args.bag), args), args, ())
    matrix = load(args.matrix) if args.matrix else None
    part = required_sensor_matrix(matrix, args.matrix) if matrix else None
    recording = common.read_checked(args, args.bag, ['wrench', 'pose'],
                                    raw_wrench=part is not None)
    recording = recording_corrected(recording, part) if part else recording
    with common.with_notes_of(recording):
        calibration = calibrated(recording, args)
    if args.free_motion:
        motion = common.read_checked(args, args.free_motion, raw_wrench=part is not None)
        motion = recording_corrected(motion, part) if part else motion
        calibration = with_delay(calibration, estimate_delay(motion, calibration))
    if args.report:
        write_report(args, recording, calibration)
    if matrix:
        calibration = with_matrix_of(calibration, matrix)
    return _write(calibration, args, recording.notes)


def _as_stated(calibration: 'Calibration', args: argparse.Namespace) -> 'Calibration':
    """Return a calibration that was read with what the arguments state of robot and sensor."""
    from dataclasses import replace

    from forcecal_ros.calibrate.result import with_settings
    from forcecal_ros.observe.frames import agreed, mounting_of

    with common.from_arguments():
        given = mounting_of(args.sensor_from_pose or (), '--sensor-from-pose')
    if 'of' in calibration.source:  # another package, whose files do not state these
        calibration = with_settings(calibration, _settings_of(args), args.wrench_sign or 1)
    elif stated := next((name for name in ('gravity', 'gravity_direction', 'sensor_rotation',
                                           'wrench_sign') if getattr(args, name)), ''):
        raise UsageError(f'--{stated.replace("_", "-")} cannot change a calibration, {args.bag}; '
                         'calibrate its recording again with this option')
    return replace(calibration, sensor_from_pose=agreed(given, calibration, args.bag))


def _write(calibration: 'Calibration', args: argparse.Namespace, notes: tuple[str, ...]
           ) -> Answer:
    """Write a calibration, and return what is in it."""
    from forcecal_ros.checks.hypotheses import refuse_other_mass
    from forcecal_ros.core.quantity import quantity
    from forcecal_ros.io.calibration_file import save, to_document
    from forcecal_ros.report.rows import as_text, promises, residuals, table

    mass, std = float(calibration.mass), float(calibration.mass.std)
    if args.tool_mass is not None:
        refuse_other_mass(mass, std if math.isfinite(std) else 0.0, args.tool_mass)
    save(calibration, args.output)
    warnings = calibration.quality.get('warnings', ())
    written = f'written to {args.output}'
    return Answer(
        to_document(calibration),
        as_text([*table(calibration), *promises(calibration), *residuals(calibration)])
        + f'\n\n{written}',
        f'mass {quantity(mass, std, "kg")} (95 % interval), {written}',
        (*(note for note in notes if not any(note in warning for warning in warnings)), *warnings,
         *calibration.quality.get('questions', ())))


def calibrated(recording: 'Recording', args: argparse.Namespace) -> 'Calibration':
    """Calibrate as the arguments state."""
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.observe.design import with_kalman_gains
    from forcecal_ros.observe.settings import ObserverSettings

    source = {**({'robot': args.robot} if args.robot else {}),
              'created': datetime.now(timezone.utc).isoformat(timespec='seconds')}
    return with_kalman_gains(identify(recording, _settings_of(args, source)),
                             ObserverSettings(contact_walk=args.contact_walk,
                                              bandwidth_min_hz=args.bandwidth_min,
                                              bandwidth_max_hz=args.bandwidth_max))


def _settings_of(args: argparse.Namespace, source: Any = ()) -> 'IdentificationSettings':
    """Return the settings of the arguments."""
    from forcecal_ros.calibrate.settings import IdentificationSettings

    position, rotation = args.accelerometer_position, args.sensor_rotation
    return IdentificationSettings(
        **common.gravity_of(args), coupling=args.coupling,
        sensor_rotation=tuple(map(math.radians, rotation)) if rotation else None,  # type: ignore[arg-type]
        cutoff=args.cutoff, accelerometer_position=tuple(position) if position else None,
        observer_mode=args.filter, source=dict(source))


def write_report(args: argparse.Namespace, recording: 'Recording', calibration: 'Calibration'
                 ) -> None:
    """Write the HTML report, with the observer run over the same recording."""
    from forcecal_ros.core.files import write_text
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.observe import replay
    from forcecal_ros.report.calibration import render
    from forcecal_ros.report.page import estimated_by

    estimate = replay(recording, calibration)
    contact = Stream(estimate.t, estimate.contact, calibration.sensor_frame)
    step = None if common.is_stdout(args.output) else estimated_by(
        args.bag, args.output, common.read_likewise(args, poses=False))
    write_text(args.report, render(recording, calibration, contact, step=step))
