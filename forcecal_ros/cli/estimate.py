"""``forcecal estimate``: the observer over a recording, by the same step as in the node."""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.cli.many import add_bags, Answer, MANY
from forcecal_ros.cli.many import run as run_each
from forcecal_ros.core.errors import DataError, UnobservableError, UsageError
from forcecal_ros.core.quantity import beside, quantity, sizes

if TYPE_CHECKING:
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording
    from forcecal_ros.observe import ContactEstimate, ObserverSettings
    from forcecal_ros.observe.playback import Followed

FILTERS = ('kalman', 'newton', 'ukf', 'ekf', 'static')
LEARNING = ('ukf', 'ekf')
"""Filters that estimate the biases as well."""

MAX_DELAY_STD_S = 5e-4
"""A delay found in the recording itself is used if its standard error is below half a period of a
sensor at 1 kHz."""

IDENTIFIED = 'identified from the recording'


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'estimate', inputs=('bag', 'calibration'),
        example='forcecal estimate my_bag --calibration calibration.yaml -o contact_bag')
    add_bags(parser)
    options = common.group(parser, 'model')
    options.add_argument('--calibration', metavar='C.yaml',
                         help='written by forcecal calibrate, demo or the sequencer (default: the '
                              'one in the recording, else one identified from the recording)')
    common.add_gravity(options, *('that of the calibration',) * 2)
    options.add_argument('--filter', choices=FILTERS,
                         help='ukf, ekf: also estimate biases and write observer/innovation; '
                              'static: remove weight and bias without filtering (default: kalman '
                              'or newton, that of the calibration)')
    options.add_argument('--track-tool', action='store_true',
                         help='track changes of the mass and centre of mass of the tool, and '
                              'write them as observer/tool')
    common.group(parser, 'filter kalman').add_argument(
        '--bandwidth', metavar='HZ', type=common.positive,
        help='bandwidth of the contact wrench (default: from noise and limits in the calibration)')
    learning = common.group(parser, 'filters ukf and ekf')
    learning.add_argument('--orientation', choices=('auto', 'pose', 'imu'), default='auto',
                          help='source of gravity: the pose, or accelerometer and gyro')
    learning.add_argument('--payload', metavar='KG', type=common.not_negative, default=0.0,
                          help='standard deviation of the mass attached since the calibration '
                               '(imu only)')
    common.add_output(parser, '-o', '--output', kind='recording', metavar='OUT_BAG', required=True,
                      more=MANY)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    if args.bandwidth is not None and args.filter not in (None, 'kalman'):
        raise UsageError(f'--bandwidth is not used by filter {args.filter}, only by kalman; '
                         'leave it out')
    if args.payload and args.orientation == 'pose':
        raise UsageError('--payload requires gravity from an IMU; also give --orientation imu')
    common.gravity_of(args)
    return run_each(args, answer)


def answer(args: argparse.Namespace) -> Answer:
    """Estimate over one recording."""
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.observe import ObserverSettings

    settings = ObserverSettings(filter=args.filter, bandwidth_hz=args.bandwidth)
    raw = bool(args.calibration) and load(args.calibration).matrix is not None
    recording = common.read_checked(args, args.bag, raw_wrench=raw)
    by_imu = _needs_imu(args, recording)
    calibration, source = _calibration_for(args, recording)
    calibration = replace(calibration, **{name: value for name, value in common.gravity_of(
        args).items() if getattr(args, name) is not None})
    about: list[str] = []
    if source == IDENTIFIED:  # what speaks against a calibration that no one has looked at
        quality = calibration.quality
        about = [*(line for line in quality['warnings'] if 'suspect' in line),
                 *quality['questions']]
    recording, calibration, notes = as_taken(recording, calibration, settings,
                                             args.calibration or args.bag)
    about += notes
    with common.with_notes_of(recording):
        estimate, followed = _estimate(args, recording, calibration, settings, by_imu)
    write_estimate(args.output, estimate, calibration, recording.start_ns, followed)
    if args.payload and not by_imu:
        about.append('--payload is not used, because gravity is computed from the pose')
    document = {'output': args.output,
                'filter': args.filter or getattr(calibration.observer, 'mode', 'kalman'),
                'orientation': 'imu' if by_imu else 'pose', 'calibration': source,
                'notes': [*recording.notes, *about, *status_notes(estimate)],
                **statistics(estimate), **_learned(estimate)}
    if followed is not None:
        document['tool'] = _tool_figures(followed)
    force = document['mean'][:3]
    mean = f'mean force {sizes(force, "N", 3)}' if document['valid'] else 'none valid'
    return Answer(document, '\n'.join(_lines(document)),
                  f'{document["samples"]} contact wrenches{_valid_only(document)}, {mean}',
                  tuple(document['notes']))


def _needs_imu(args: argparse.Namespace, recording: 'Recording') -> bool:
    """Return whether accelerometer and gyro have to give the direction of gravity."""
    from forcecal_ros.core.topics import naming

    if args.orientation == 'pose' and not recording.pose:
        raise DataError(f'{args.bag} holds no pose; {naming(recording, "pose")}')
    if args.orientation == 'auto':
        return recording.pose is None and args.filter in (*LEARNING, 'static')
    return bool(args.orientation == 'imu')


def _calibration_for(args: argparse.Namespace, recording: 'Recording'
                     ) -> tuple['Calibration', str]:
    """Return the calibration of the file, of the recording's topic, or of its static poses."""
    from forcecal_ros.calibrate.pipeline import identify
    from forcecal_ros.calibrate.settings import IdentificationSettings
    from forcecal_ros.io.bags import read_calibrations
    from forcecal_ros.io.calibration_file import load, parse

    if args.calibration:
        return load(args.calibration), args.calibration
    recorded = read_calibrations(args.bag, common.topic_names(args, args.bag))
    if recorded:
        return parse(recorded[-1], f'{args.bag}: sequencer/calibration'), 'in the recording'
    try:
        return identify(recording, IdentificationSettings(
            **common.gravity_of(args))), IDENTIFIED
    except (DataError, UnobservableError) as error:
        error.args = (f'no --calibration is given, and {args.bag} does not identify one: {error}',)
        raise


def as_taken(recording: 'Recording', calibration: 'Calibration', settings: 'ObserverSettings',
             name: str) -> tuple['Recording', 'Calibration', tuple[str, ...]]:
    """
    Bring a recording and a calibration together; refuse those that disagree.

    Parameters
    ----------
    name : str
        Of the calibration, for messages.

    Returns
    -------
    recording : Recording
        In the sign of the calibration, poses of ft_sensor, stamps even.
    calibration : Calibration
        With what it does not know by itself, estimated from the recording.
    notes : tuple of str
        What was assumed.

    Raises
    ------
    ConfigError, DataError
        Names cause and remedy.
    """
    from forcecal_ros.checks import gravity
    from forcecal_ros.checks.signals import SENSORS
    from forcecal_ros.core.sensor_matrix import recording_corrected, sensor_matrix
    from forcecal_ros.core.stamps import with_even_streams
    from forcecal_ros.observe.frames import taken_as_calibrated
    from forcecal_ros.observe.playback import as_calibrated

    # stamps that jitter by less than a period are late by little, and stay those of the result
    recording = with_even_streams(taken_as_calibrated(recording, calibration, name),
                                  (*SENSORS, 'angular_velocity'), 1.0)
    part = sensor_matrix(calibration)
    raw = recording_corrected(recording, part) if part else recording
    with common.with_notes_of(recording):
        found = gravity.refuse_disagreeing(as_calibrated(raw, calibration)[0], calibration)
    calibration, assumed = prepared(calibration, recording, settings)
    return recording, calibration, (*other_frame(recording, calibration), *found, *assumed)


def other_frame(recording: 'Recording', calibration: 'Calibration') -> tuple[str, ...]:
    """Note that a wrench names another frame than the one calibrated."""
    named, known = (name.strip('/') for name in (
        recording.wrench.frame if recording.wrench else '', calibration.sensor_frame))
    if not named or named == known or 'of' in calibration.source:
        return ()
    return ((f'wrench: its frame_id is {named!r}, but the calibration is for {known!r}; if '
             f'{named!r} is another frame or sensor, calibrate in it'),)


def prepared(calibration: 'Calibration', recording: 'Recording', settings: 'ObserverSettings'
             ) -> tuple['Calibration', tuple[str, ...]]:
    """
    Estimate from the recording what the calibration does not know: noise and delay.

    Returns
    -------
    calibration : Calibration
    notes : tuple of str
        What was assumed.
    """
    from forcecal_ros.calibrate.delay import estimate_delay, with_delay
    from forcecal_ros.core.axes import in_axes_of_pose
    from forcecal_ros.observe.bandwidth import UNMEASURED_HZ
    from forcecal_ros.observe.playback import with_noise
    import numpy as np

    notes: tuple[str, ...] = ()
    in_axes = in_axes_of_pose(recording, calibration.sensor_rotation)
    if calibration.noise is None and settings.filter in LEARNING:
        calibration = with_noise(calibration, in_axes)
        notes = ('the calibration has no noise; it is estimated from this recording',)
    if calibration.noise is None and settings.filter in (None, 'kalman') and (
            settings.bandwidth_hz is None):
        notes = (('the calibration has no noise from which a bandwidth could be computed; '
                  f'that of the nominal rig, {UNMEASURED_HZ:g} Hz, is used'),)
    sensor = calibration.accelerometer
    if sensor is None or recording.accelerometer is None or np.isfinite(sensor.delay.std):
        return calibration, notes
    unknown = ('the calibration has no delay of the accelerometer; calibrate with '
               '--free-motion')
    try:
        delay = estimate_delay(in_axes, calibration)
    except DataError as error:
        return calibration, (*notes, f'{unknown}; 0 is assumed: {error}')
    found = f'{1e3 * float(delay):.2f} ms (standard error {1e3 * float(delay.std):.2f} ms)'
    if not delay.std < MAX_DELAY_STD_S:
        return calibration, (*notes, f'{unknown}; 0 is assumed, as {found} is too uncertain')
    return with_delay(calibration, delay), (*notes, f'{unknown}; estimated {found}')


def _estimate(args: argparse.Namespace, recording: 'Recording', calibration: 'Calibration',
              settings: 'ObserverSettings', by_imu: bool
              ) -> tuple['ContactEstimate', 'Followed | None']:
    """Run the observer, and the tracking of the tool if requested."""
    from forcecal_ros.observe import Imu, replay
    from forcecal_ros.observe.playback import follow

    if args.track_tool:
        followed = follow(recording, calibration, settings)
        return followed.contact, followed
    common.warn_if_compiling('observer')
    with common.bar(args, total=len(recording.wrench or ()), unit=' samples') as done:
        return replay(recording, calibration, settings,
                      Imu(payload_std=args.payload) if by_imu else None, done.update), None


def write_estimate(path: str, estimate: 'ContactEstimate', calibration: 'Calibration',
                   start_ns: int, followed: 'Followed | None' = None) -> None:
    """Write a row for every wrench, changes of its status and of the tool, and the innovation."""
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.io.bags import write_signals
    from forcecal_ros.io.bags.messages import Diagnostic
    from forcecal_ros.io.calibration_file import dump
    from forcecal_ros.observe.sample import describe, level
    import numpy as np

    frame, status = calibration.sensor_frame, estimate.status
    changes = np.flatnonzero(np.diff(status, prepend=~status[:1]))
    levels = ('ok', 'warn', 'error')  # as diagnostic_msgs/DiagnosticStatus counts them
    signals: dict[str, Any] = {
        'contact_wrench': Stream(estimate.t, estimate.contact, frame),
        'status': [
            Diagnostic(t, levels.index(level(bits)), '; '.join(describe(bits)) or 'ok', str(bits))
            for t, bits in zip(estimate.t[changes].tolist(), status[changes].tolist())],
        'calibration': dump(calibration)}
    if estimate.learned is not None:
        signals['innovation'] = Stream(estimate.t, estimate.innovation, frame)
    if followed is not None and followed.announced:
        J = np.full((3, 3), np.nan) if calibration.inertia is None else calibration.inertia.value
        signals['tool'] = Stream(
            np.array([one.t for one in followed.announced]), np.array([
                [one.mass, *one.com, *J[np.triu_indices(3)]] for one in followed.announced]),
            frame)
    write_signals(path, signals, start_ns)


def status_notes(estimate: 'ContactEstimate') -> list[str]:
    """Return one sentence for each fault of samples, with the number of samples."""
    from forcecal_ros.observe.sample import describe

    seen: Counter[str] = Counter()
    for status, count in Counter(estimate.status.tolist()).items():
        for sentence in describe(status):
            seen[sentence] += count
    return [f'{text} ({n} of {len(estimate.t)} samples)' for text, n in seen.items()]


def statistics(estimate: 'ContactEstimate') -> dict[str, Any]:
    """Count the samples and the valid ones, and give mean and std of these; null without any."""
    contact = estimate.contact[estimate.valid]
    known = len(contact) > 0
    return {'samples': len(estimate.t), 'valid': len(contact),
            'mean': contact.mean(axis=0).tolist() if known else [None] * 6,
            'std': contact.std(axis=0).tolist() if known else [None] * 6,
            'unit': 'N, N m'}


def _learned(estimate: 'ContactEstimate') -> dict[str, Any]:
    """Return what a filter with biases estimated; nothing for the others."""
    import numpy as np

    learned, valid = estimate.learned, estimate.valid
    if learned is None or not valid.any():
        return dict.fromkeys(('bias', 'bias_std', 'correlation', 'contact_share', 'nis'))

    def plain(values: Any) -> Any:
        return [float(x) if np.isfinite(x) else None for x in values]

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


def _tool_figures(followed: 'Followed') -> dict[str, Any]:
    """Return the tool at the end, its standard errors, and its changes."""
    if not followed.tools:
        raise DataError('the recording does not identify the tool, which requires a pose and a '
                        'wrench below saturation at the same time; record both')
    last = followed.tools[-1]
    states = Counter(one.state for one in followed.tools)
    known = last.suspected == last.suspected
    return {
        'state': last.state, 'mass': last.mass, 'mass_std': last.mass_std,
        'com': last.com.tolist(), 'com_std': last.com_std.tolist(),
        'suspected_change': last.suspected if known else None,
        'suspected_change_std': last.suspected_std if known else None,
        'changes': [one._asdict() for one in followed.changes],
        'share': {word: count / len(followed.tools) for word, count in sorted(states.items())}}


def _lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result as lines for a terminal."""
    from forcecal_ros.report.rows import aligned, WRENCH_AXES

    yield (f'{document["output"]}: {document["samples"]} contact wrenches by '
           f'{document["filter"]}, gravity from the {document["orientation"]}, calibration '
           f'{document["calibration"]}{_valid_only(document)}')
    bias = document['bias']
    rows = [['', 'mean', 'std. dev.', 'unit'] + ['bias (95 % interval)'] * bool(bias)]
    for i, (name, mean, std) in enumerate(zip(WRENCH_AXES, document['mean'], document['std'])):
        if std is not None:
            unit = 'N' if i < 3 else 'N m'
            shown, cells = beside((mean, std), unit)
            rows.append([name, *cells, shown] + (
                [quantity(bias[i], document['bias_std'][i], unit)] if bias else []))
    if len(rows) > 1:
        yield from aligned(rows, left=(0, 3))
    if document['nis'] is not None:
        yield (f'NIS {document["nis"]:.2f} without contact (expected: 6), contact '
               f'{100 * document["contact_share"]:.1f} % of the time')
    if document.get('mass') is not None:
        yield f'mass {quantity(document["mass"], document["mass_std"], "kg")} (95 % interval)'
    if not (tool := document.get('tool')):
        return
    yield (f'tool: {tool["state"]}, {quantity(tool["mass"], tool["mass_std"], "kg")}, centre of '
           'mass ' + ', '.join(quantity(x, std, 'm')
                               for x, std in zip(tool['com'], tool['com_std']))
           + ' (95 % intervals)')
    evidence = {True: 'weight and accelerations', False: 'weight alone (a steady downward push '
                'is not excluded)'}
    for one in tool['changes']:
        yield (f'tool: {quantity(one["mass"], 0.0, "kg", signed=True)} estimated at '
               f'{one["t"]:.2f} s from {evidence[one["inert"]]}')
    if tool['suspected_change'] is not None:
        by = quantity(tool['suspected_change'], tool['suspected_change_std'], 'kg')
        yield f'tool: may have changed by {by}, or is pushed; rotate it to distinguish the two'


def _valid_only(figures: dict[str, Any]) -> str:
    """Return what mean and std are over, if that is not every sample."""
    if figures['valid'] == figures['samples']:
        return ''
    if not figures['valid']:
        return ', none of them valid'
    return f', mean and std over the {figures["valid"]} valid wrenches'

