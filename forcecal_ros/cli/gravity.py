"""``forcecal gravity``: remove weight, inertia and bias from a wrench, after [Ukf2025]."""

import argparse
from collections.abc import Callable
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.argument_types import not_negative, positive
from forcecal_ros.cli.common import (
    add_bag,
    add_json,
    new_parser,
    print_json,
    read_checked,
    say,
    topic_names,
    warn,
    with_reading_of,
)
from forcecal_ros.cli.outputs import add_output, RECORDING
from forcecal_ros.cli.progress import add_quiet, bar
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording
    from forcecal_ros.observe import ContactEstimate, ObserverSettings

LEARNING = ('ukf', 'ekf')
FILTERS = (*LEARNING, 'static', 'kalman', 'newton')
STATES = (6, 12)
IDENTIFIED = 'identified from the recording'


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'gravity',
        example='forcecal gravity my_bag --calibration calibration.yaml -o compensated_bag')
    add_bag(parser)
    parser.add_argument('--calibration', metavar='C.yaml',
                        help='of sensor and tool (default: the one in the recording, or what '
                        'the recording itself identifies)')
    parser.add_argument('--filter', choices=FILTERS, default='ukf',
                        help='ukf and ekf estimate the biases along; kalman and newton are those '
                        'of estimate; static: weight and bias taken off, nothing filtered')
    parser.add_argument('--orientation', choices=('auto', 'pose', 'imu'), default='auto',
                        help='where gravity comes from: the pose, or accelerometer and gyro')
    parser.add_argument('--states', type=int, choices=STATES, default=STATES[-1],
                        help='wrench, or wrench and biases')
    parser.add_argument('--covariances', choices=('measured', 'paper'), default='measured',
                        help="Q, R and P0 from the calibration's noise, or as the paper prints")
    parser.add_argument('--rise-time', metavar='S', type=positive,
                        help='10-90 %% rise of a contact force (default: 0.012 s)')
    parser.add_argument('--contact-floor', metavar=('N', 'NM'), nargs=2, type=not_negative,
                        help='residual of vibration and model errors that does not count as '
                        'contact (default: 0.03 N 0.003 N m)')
    parser.add_argument('--bias-prior', metavar=('N', 'NM'), nargs=2, type=not_negative,
                        help='standard deviation of what the biases have changed since the '
                        'calibration (default: 0 N 0 N m)')
    parser.add_argument('--payload', metavar='KG', type=not_negative, default=0.0,
                        help='standard deviation of a payload taken up since the calibration '
                        '(imu only)')
    add_output(parser, '-o', '--output', kind=RECORDING, metavar='OUT_BAG', required=True,
               help='recording to write; an earlier one is kept as OUT_BAG~')
    add_quiet(parser)
    add_json(parser)
    parser.set_defaults(run=run, inputs=('bag', 'calibration'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.cli import contact
    from forcecal_ros.core.stamps import with_even_bursts
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.observe.frames import taken_as_calibrated

    refuse_unused(args)
    settings = settings_of(args)
    raw = bool(args.calibration) and load(args.calibration).matrix is not None
    recording = read_checked(args, args.bag, raw_wrench=raw)
    by_imu = needs_imu(args, recording)
    calibration, source = calibration_for(args, recording)
    recording = contact.in_sign_of(calibration, args.wrench_sign, taken_as_calibrated(
        recording, calibration, args.calibration or args.bag))
    recording = with_even_bursts(recording)
    unknown = contact.refuse_disagreeing(recording, calibration)
    calibration, about = contact.prepared(calibration, recording, settings)
    about = (*doubts(calibration, source), *unknown, *about)
    with (bar(args, total=len(recording.wrench or ()), unit=' samples') as done,
          with_reading_of(recording)):
        estimate = estimated(recording, calibration, settings,
                             args.payload if by_imu else None, done.update)
    contact.write_estimate(args.output, estimate, calibration, recording.start_ns,
                           () if args.filter == 'static' else ('innovation',))
    if args.payload and not by_imu:
        about = (*about, '--payload is not used: the pose tells gravity')
    document = {'output': args.output, 'filter': args.filter,
                'orientation': 'imu' if by_imu else 'pose', 'calibration': source,
                'notes': [*recording.notes, *about, *contact.status_notes(estimate)],
                **contact.statistics(estimate), **figures(estimate)}
    if args.json:
        print_json(document)
    else:
        _print(document)
    return 0


def refuse_unused(args: argparse.Namespace) -> None:
    """
    Refuse what the chosen filter would not look at.

    Raises
    ------
    UsageError
        An option is given that filter or orientation leave without meaning.
    """
    learning = {'--states': args.states != STATES[-1],
                '--covariances': args.covariances == 'paper', '--rise-time': args.rise_time,
                '--contact-floor': args.contact_floor, '--bias-prior': args.bias_prior}
    unused = [option for option, given in learning.items() if given]
    if unused and args.filter not in LEARNING:
        raise UsageError(f'{", ".join(unused)}: filter {args.filter} has no such setting; leave '
                         'it out')
    if args.payload and args.orientation == 'pose':
        raise UsageError('--payload is estimated where an IMU tells gravity; give '
                         '--orientation imu as well')


def settings_of(args: argparse.Namespace) -> 'ObserverSettings':
    """Return the settings that the arguments say."""
    from forcecal_ros.observe import ObserverSettings
    from forcecal_ros.observe.settings import FilterSettings

    given: dict[str, Any] = {name: value for name, value in (
        ('rise_time', args.rise_time),
        ('contact_floor', args.contact_floor and tuple(args.contact_floor)),
        ('bias_prior', args.bias_prior and tuple(args.bias_prior))) if value is not None}
    return ObserverSettings(filter=args.filter, learning=FilterSettings(
        states=args.states, covariances=args.covariances, **given))


def needs_imu(args: argparse.Namespace, recording: 'Recording') -> bool:
    """
    Whether accelerometer and gyro have to tell where down is.

    Raises
    ------
    DataError
        The pose was asked for, and there is none.
    """
    from forcecal_ros.core.errors import DataError
    from forcecal_ros.core.topics import naming

    if args.orientation == 'pose' and not recording.pose:
        raise DataError(f'{args.bag} holds no pose; {naming(recording, "pose")}')
    if args.orientation == 'auto':
        return recording.pose is None and args.filter not in ('kalman', 'newton')
    return bool(args.orientation == 'imu')


def calibration_for(args: argparse.Namespace,
                    recording: 'Recording') -> tuple['Calibration', str]:
    """
    Find the calibration: a file, the recording's topic, or what its static poses identify.

    Returns
    -------
    Calibration
    source : str
        In words.

    Raises
    ------
    ConfigError
        The file is none.
    DataError, UnobservableError
        No calibration is given and the recording does not identify one.
    """
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.core.errors import DataError, UnobservableError
    from forcecal_ros.io.bags import read_calibrations
    from forcecal_ros.io.calibration_file import load, parse

    if args.calibration:
        return load(args.calibration), args.calibration
    recorded = read_calibrations(args.bag, topic_names(args))
    if recorded:
        return parse(recorded[-1], f'{args.bag}: sequencer/calibration'), 'in the recording'
    try:
        return (identify(recording, IdentificationSettings(wrench_sign=args.wrench_sign or 1)),
                IDENTIFIED)
    except (DataError, UnobservableError) as error:
        raise type(error)(f'no --calibration is given, and {args.bag} identifies none: {error}'
                          ) from error


def doubts(calibration: 'Calibration', source: str) -> tuple[str, ...]:
    """Return what speaks against a calibration that was identified along the way."""
    if source != IDENTIFIED:
        return ()
    quality = calibration.quality
    return (*(line for line in quality['warnings'] if 'suspect' in line), *quality['questions'])


def estimated(recording: 'Recording', calibration: 'Calibration', settings: 'ObserverSettings',
              payload_std: float | None, advance: Callable[[int], object]
              ) -> 'ContactEstimate':
    """Run the chain, by the IMU where ``payload_std`` [kg] is given."""
    from forcecal_ros.observe import Imu, replay

    imu = None if payload_std is None else Imu(payload_std=payload_std)
    return replay(recording, calibration, settings, imu, advance)


def figures(estimate: 'ContactEstimate') -> dict[str, Any]:
    """Return what the filter learned, in numbers; null where there are none."""
    import numpy as np

    def plain(values: Any) -> Any:
        return [float(x) if np.isfinite(x) else None for x in values]

    learned, valid = estimate.learned, estimate.valid
    if learned is None or not valid.any():
        return {'bias': None, 'bias_std': None, 'correlation': None, 'contact_share': None,
                'nis': None}
    nis, touching = np.asarray(learned.nis)[valid], np.asarray(learned.touching)[valid]
    free = nis[np.isfinite(nis) & ~touching]
    out: dict[str, Any] = {
        'bias': plain(learned.bias[-1]), 'bias_std': plain(learned.bias_std[-1]),
        'correlation': plain(learned.correlation[-1]), 'contact_share': float(touching.mean()),
        'nis': float(free.mean()) if len(free) else None}
    if estimate.by_imu is not None:
        _, mass, mass_std = estimate.by_imu
        out['mass'], out['mass_std'] = plain([mass[-1], mass_std[-1]])
    return out


def _print(document: dict[str, Any]) -> None:
    from forcecal_ros.cli import contact
    from forcecal_ros.core.quantity import quantity

    for note in document['notes']:
        warn(note)
    say(f'{document["output"]}: {document["samples"]} wrenches by {document["filter"]}, gravity '
        f'from the {document["orientation"]}, calibration {document["calibration"]}'
        + contact.over_which(document))
    for line in contact.table(document):
        say(line)
    if document['nis'] is not None:
        say(f'NIS {document["nis"]:.2f} without contact (6 where all is as modelled), contact '
            f'{100 * document["contact_share"]:.1f} % of the time')
    if document.get('mass') is not None:
        say(f'mass {quantity(document["mass"], document["mass_std"], "kg")}')
