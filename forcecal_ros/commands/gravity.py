"""``forcecal gravity``: weight, inertia and bias off a recorded wrench, after [Ukf2025]."""

import argparse
from collections import Counter
from typing import Any, TYPE_CHECKING

from forcecal_ros.commands.common import (
    add_bag,
    add_json,
    new_parser,
    print_json,
    say,
    topic_names,
    warn,
)

if TYPE_CHECKING:
    from forcecal_ros.calibration.model import Calibration
    from forcecal_ros.gravity import Compensated, Settings
    from forcecal_ros.recording.streams import Recording


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'gravity',
        summary='take weight, inertia and bias off a recorded wrench',
        example='forcecal gravity my_bag --calibration calibration.yaml -o compensated_bag')
    add_bag(parser)
    parser.add_argument('--calibration', metavar='C.yaml',
                        help='of sensor and tool (default: the one in the recording, or what '
                        'the recording itself identifies)')
    parser.add_argument('--filter', choices=('ukf', 'ekf', 'static'), default='ukf',
                        help='static: weight and bias taken off, nothing filtered')
    parser.add_argument('--orientation', choices=('auto', 'pose', 'imu'), default='auto',
                        help='where gravity comes from: the pose, or accelerometer and gyro')
    parser.add_argument('--states', type=int, choices=(6, 12), default=12,
                        help='wrench, or wrench and biases')
    parser.add_argument('--covariances', choices=('measured', 'paper'), default='measured',
                        help="Q, R and P0 from the calibration's noise, or as the paper prints")
    parser.add_argument('--rise-time', metavar='S', type=float,
                        help='10-90 %% rise of a contact force (default: 0.012)')
    parser.add_argument('--contact-floor', metavar=('N', 'NM'), nargs=2, type=float,
                        help='vibration and model errors that are no contact '
                        '(default: 0.03 0.003)')
    parser.add_argument('--bias-prior', metavar=('N', 'NM'), nargs=2, type=float,
                        help='how far the biases may have moved since the calibration '
                        '(default: 0 0)')
    parser.add_argument('--payload', metavar='KG', type=float, default=0.0,
                        help='how much may have been taken up since the calibration (imu only)')
    parser.add_argument('-o', '--output', metavar='OUT_BAG', required=True,
                        help='recording to write; one that is there is kept as OUT_BAG~')
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.calibration.file import dump
    from forcecal_ros.observe.filters.bias_filter import INVALID
    from forcecal_ros.recording.bags import read_recording, write_signals
    from forcecal_ros.recording.streams import Stream
    import numpy as np

    settings = settings_of(args)
    recording = read_recording(
        args.bag, topics=topic_names(args), wrench_sign=args.wrench_sign)
    calibration, source = calibration_for(args, recording)
    by_imu = args.orientation == 'imu' or (args.orientation == 'auto' and recording.pose is None)
    result, notes = compensated(recording, calibration, settings, by_imu, args.payload)
    good = result.status & INVALID == 0
    frame = calibration.sensor_frame
    signals: dict[str, Any] = {
        'contact_wrench': Stream(result.t[good], result.wrench[good], frame),
        'calibration': dump(calibration)}
    known = np.isfinite(result.innovation).all(axis=1)
    if known.any():
        signals['innovation'] = Stream(result.t[known], result.innovation[known], frame)
    write_signals(args.output, signals, recording.start_ns)
    document = {'output': args.output, 'samples': int(good.sum()), 'filter': settings.filter,
                'orientation': 'imu' if by_imu else 'pose', 'calibration': source,
                'notes': [*recording.notes, *notes, *status_notes(result)], **figures(result)}
    if args.json:
        print_json(document)
    else:
        _print(document)
    return 0


def settings_of(args: argparse.Namespace) -> 'Settings':
    """Return the settings that the arguments say."""
    from forcecal_ros.gravity import Settings

    given: dict[str, Any] = {name: value for name, value in (
        ('rise_time', args.rise_time),
        ('contact_floor', args.contact_floor and tuple(args.contact_floor)),
        ('bias_prior', args.bias_prior and tuple(args.bias_prior))) if value is not None}
    return Settings(filter=args.filter, states=args.states, covariances=args.covariances, **given)


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
    from forcecal_ros.calibration.file import load, parse
    from forcecal_ros.errors import DataError, UnobservableError
    from forcecal_ros.identify.pipeline import identify
    from forcecal_ros.identify.settings import Settings
    from forcecal_ros.recording.bags import read_calibrations

    if args.calibration:
        return load(args.calibration), args.calibration
    recorded = read_calibrations(args.bag, topic_names(args))
    if recorded:
        return parse(recorded[-1], f'{args.bag}: sequencer/calibration'), 'in the recording'
    try:
        return (identify(recording, Settings(wrench_sign=args.wrench_sign)),
                'identified from the recording')
    except (DataError, UnobservableError) as error:
        raise type(error)(f'no --calibration is given, and {args.bag} identifies none: {error}'
                          ) from error


def compensated(recording: 'Recording', calibration: 'Calibration', settings: 'Settings',
                by_imu: bool, payload: float) -> tuple['Compensated', list[str]]:
    """Run the filter; noise and delay that the calibration does not know come from the signals."""
    from forcecal_ros.commands.estimate import with_known_delay
    from forcecal_ros.gravity import Imu, replay, replay_pose_free
    from forcecal_ros.observe.noise import with_noise
    from tqdm import tqdm

    notes: list[str] = []
    if calibration.noise is None and settings.covariances == 'measured':
        calibration = with_noise(calibration, recording)
        notes.append('the calibration knows no noise; taken from this recording')
    total = len(recording.wrench) if recording.wrench else 0
    with tqdm(total=total, unit=' samples', leave=False, disable=None) as bar:
        if by_imu:
            return replay_pose_free(recording, calibration, settings, Imu(payload_std=payload),
                                    progress=bar.update), notes
        calibration, about_delay = with_known_delay(calibration, recording)
        return (replay(recording, calibration, settings, progress=bar.update),
                [*notes, *about_delay])


def status_notes(result: 'Compensated') -> list[str]:
    """Return one sentence for whatever was wrong with samples, and how many."""
    from forcecal_ros.gravity import describe

    seen: Counter[str] = Counter()
    for status, count in Counter(result.status.tolist()).items():
        for sentence in describe(status):
            seen[sentence] += count
    return [f'{text} ({n} of {len(result.t)} samples)' for text, n in seen.items()]


def figures(result: 'Compensated') -> dict[str, Any]:
    """Return the result in numbers, null where there are none."""
    import numpy as np

    def plain(values: Any) -> Any:
        return [float(x) if np.isfinite(x) else None for x in values]

    out: dict[str, Any] = {
        'mean': plain(np.nanmean(result.wrench, axis=0)),
        'std': plain(np.nanstd(result.wrench, axis=0)),
        'bias': plain(result.bias[-1]), 'bias_std': plain(result.bias_std[-1]),
        'correlation': plain(result.correlation[-1]),
        'unit': 'N, N m', 'contact_share': float(result.contact.mean())}
    free = result.nis[np.isfinite(result.nis) & ~result.contact]
    out['nis'] = float(free.mean()) if len(free) else None
    if result.mass is not None and result.mass_std is not None:
        out['mass'], out['mass_std'] = plain([result.mass[-1], result.mass_std[-1]])
    return out


def _print(document: dict[str, Any]) -> None:
    for note in document['notes']:
        warn(note)
    say(f'{document["output"]}: {document["samples"]} wrenches by {document["filter"]}, gravity '
        f'from the {document["orientation"]}, calibration {document["calibration"]}')
    for name in ('mean', 'std', 'bias', 'bias_std'):
        numbers = '  '.join('        -' if x is None else f'{x:9.4f}' for x in document[name])
        say(f'{name:8} [N, N m]  {numbers}')
    if document['nis'] is not None:
        say(f'NIS {document["nis"]:.2f} without contact (6 where all is as modelled), contact '
            f'{100 * document["contact_share"]:.1f} % of the time')
    if document.get('mass') is not None:
        say(f'mass {document["mass"]:.4f} +- {document["mass_std"]:.4f} kg')
