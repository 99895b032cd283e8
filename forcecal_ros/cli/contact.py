"""What ``estimate`` and ``gravity`` share: prepare a calibration, write and sum up an estimate."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.argument_types import positive
from forcecal_ros.cli.common import with_reading_of
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.core.calibration import Calibration
    from forcecal_ros.core.streams import Recording, Stream
    from forcecal_ros.observe import ContactEstimate, ObserverSettings
    from forcecal_ros.observe.payload import ToolEstimate

DELAY_STD = 5e-4
"""A delay found in the recording itself is used where its standard error is below this: half a
period of a sensor at 1 kHz [s]."""

LEVELS = ('ok', 'warn', 'error')
"""As diagnostic_msgs/DiagnosticStatus counts them."""


def add_bandwidth(parser: Any, defaults: tuple[str, str, str]) -> None:
    """Add what filter kalman's bandwidth follows from besides the noise, and say the defaults."""
    walk, low, high = (f'default: {one}' for one in defaults)
    parser.add_argument('--contact-walk', metavar='N/SQRT(S)', type=positive,
                        help='how fast a contact force is expected to wander, which together with '
                             f'the noise makes the bandwidth of filter kalman ({walk})')
    for name, words in (('--bandwidth-min', f'slowest bandwidth that may follow ({low})'),
                        ('--bandwidth-max', f'fastest bandwidth that may follow ({high})')):
        parser.add_argument(name, metavar='HZ', type=positive, help=words)


def bandwidth_of(args: Any) -> dict[str, Any]:
    """
    Return these options as fields of the observer's settings.

    Raises
    ------
    UsageError
        The slowest is above the fastest.
    """
    low, high = args.bandwidth_min, args.bandwidth_max
    if low is not None and high is not None and low > high:
        raise UsageError(f'--bandwidth-min {low:g} is above --bandwidth-max {high:g}; exchange '
                         'them')
    return {'contact_walk': args.contact_walk, 'bandwidth_min_hz': low, 'bandwidth_max_hz': high}


def in_sign_of(calibration: 'Calibration', given: int | None, recording: 'Recording'
               ) -> 'Recording':
    """Return a recording with the wrench in a calibration's sign, unless one was ``given``."""
    from dataclasses import replace

    if given is not None or calibration.wrench_sign > 0 or recording.wrench is None:
        return recording
    return replace(recording, wrench=replace(recording.wrench, values=-recording.wrench.values))


def refuse_disagreeing(recording: 'Recording', calibration: 'Calibration') -> tuple[str, ...]:
    """
    Refuse a recording of other axes or units than those calibrated.

    Returns
    -------
    tuple of str
        What weighs that the calibration does not know.

    Raises
    ------
    DataError
        Names cause and remedy.
    """
    from forcecal_ros.checks import calibrated
    from forcecal_ros.core.sensor_matrix import recording_corrected, sensor_matrix
    from forcecal_ros.observe.playback import as_calibrated

    if part := sensor_matrix(calibration):
        recording = recording_corrected(recording, part)
    with with_reading_of(recording):
        found = calibrated.refuse_disagreeing(as_calibrated(recording, calibration)[0],
                                              calibration)
    return (*other_frame(recording, calibration), *found)


def other_frame(recording: 'Recording', calibration: 'Calibration') -> tuple[str, ...]:
    """Note that a wrench names another frame than the one calibrated."""
    named, known = (name.strip('/') for name in (
        recording.wrench.frame if recording.wrench else '', calibration.sensor_frame))
    if not named or named == known or 'of' in calibration.source:
        return ()
    return ((f'wrench: its frame_id is {named!r}, the calibration is of {known!r}, whose weight '
             f'and bias are taken off; if {named!r} is another frame or sensor, calibrate in it'),)


def prepared(calibration: 'Calibration', recording: 'Recording', settings: 'ObserverSettings'
             ) -> tuple['Calibration', tuple[str, ...]]:
    """
    Find in the recording what the calibration does not know: noise and delay.

    Returns
    -------
    calibration : Calibration
        As given where it knows them, or the recording does not tell.
    notes : tuple of str
        What was assumed.
    """
    from forcecal_ros.core.axes import in_axes_of_pose
    from forcecal_ros.observe.bandwidth import UNMEASURED_HZ
    from forcecal_ros.observe.playback import with_noise
    from forcecal_ros.observe.settings import LEARNING

    notes: tuple[str, ...] = ()
    if (calibration.noise is None and settings.filter in LEARNING
            and settings.learning.covariances == 'measured'):
        calibration = with_noise(calibration, in_axes_of_pose(
            recording, calibration.sensor_rotation))
        notes = ('the calibration knows no noise; taken from this recording',)
    if calibration.noise is None and settings.filter in (None, 'kalman') and (
            settings.bandwidth_hz is None):
        told = 'the calibration knows no noise that a bandwidth could follow from'
        notes = (f'{told}; {UNMEASURED_HZ:g} Hz, that of the nominal rig, is taken',)
    calibration, about_delay = with_known_delay(calibration, recording)
    return calibration, (*notes, *about_delay)


def with_known_delay(calibration: 'Calibration', recording: 'Recording'
                     ) -> tuple['Calibration', tuple[str, ...]]:
    """Find the delay between the sensors in the recording; returns as :func:`prepared` does."""
    from forcecal_ros.calibrate.delay import estimate_delay, with_delay
    from forcecal_ros.core.axes import in_axes_of_pose
    from forcecal_ros.core.errors import DataError
    import numpy as np

    sensor, sensor_rotation = calibration.accelerometer, calibration.sensor_rotation
    if sensor is None or recording.accelerometer is None or np.isfinite(sensor.delay.std):
        return calibration, ()
    unknown = ('the calibration does not know the delay of the accelerometer; calibrate with '
               '--free-motion')
    try:
        delay = estimate_delay(in_axes_of_pose(recording, sensor_rotation), calibration)
    except DataError as error:
        return calibration, (f'{unknown}; taken to be 0: {error}',)
    found = f'{1e3 * float(delay):.2f} +- {1e3 * float(delay.std):.2f} ms in this recording'
    if not delay.std < DELAY_STD:
        return calibration, (f'{unknown}; taken to be 0, as {found} is not sure enough',)
    return with_delay(calibration, delay), (f'{unknown}; found {found}',)


def write_estimate(path: str, estimate: 'ContactEstimate', calibration: 'Calibration',
                   start_ns: int, also: Sequence[str] = (),
                   told: 'Sequence[ToolEstimate]' = ()) -> None:
    """
    Write a row for every wrench, what its status was, and ``also``, fields of the estimate.

    ``told`` are the tools that were found on the sensor.
    """
    from forcecal_ros.core.streams import Stream
    from forcecal_ros.io.bags import write_signals
    from forcecal_ros.io.calibration_file import dump

    frame = calibration.sensor_frame
    write_signals(path, {
        'contact_wrench': Stream(estimate.t, estimate.contact, frame),
        **{f'{name}_wrench' if name == 'inertial' else name:
           Stream(estimate.t, getattr(estimate, name), frame) for name in also},
        'status': status_changes(estimate),
        'tool': tools_stream(told, calibration) if told else None,
        'calibration': dump(calibration)}, start_ns)


def tools_stream(told: 'Sequence[ToolEstimate]', calibration: 'Calibration') -> 'Stream':
    """Return tools as they are published: mass, centre of mass, inertia, NaN where unknown."""
    from forcecal_ros.core.streams import Stream
    import numpy as np

    J = (np.full((3, 3), np.nan) if calibration.inertia is None else calibration.inertia.value)
    rows = [[one.mass, *one.com, *J[np.triu_indices(3)]] for one in told]
    return Stream(np.array([one.t for one in told]), np.array(rows), calibration.sensor_frame)


def status_changes(estimate: 'ContactEstimate') -> list[Any]:
    """Return the status whenever it is another one than that of the wrench before."""
    from forcecal_ros.io.bags.messages import Diagnostic
    from forcecal_ros.observe.sample import describe, level
    import numpy as np

    status = estimate.status
    changes = np.flatnonzero(np.diff(status, prepend=~status[:1]))
    return [Diagnostic(t, LEVELS.index(level(bits)), '; '.join(describe(bits)) or 'ok', str(bits))
            for t, bits in zip(estimate.t[changes].tolist(), status[changes].tolist())]


def status_notes(estimate: 'ContactEstimate') -> list[str]:
    """Return one sentence for whatever was wrong with samples, and with how many of them."""
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


def over_which(figures: dict[str, Any]) -> str:
    """Say what mean and std are over, where that is not every sample."""
    if figures['valid'] == figures['samples']:
        return ''
    if not figures['valid']:
        return ', none of them valid'
    return f', mean and std over the {figures["valid"]} valid ones'


def table(figures: dict[str, Any]) -> list[str]:
    """Return lines with mean and std of each channel, and its bias where a filter learned one."""
    from forcecal_ros.core.quantity import beside, quantity
    from forcecal_ros.report.rows import aligned, WRENCH_AXES

    if None in figures['std']:
        return []
    bias = figures.get('bias')
    head = ['', 'mean', 'std', 'unit'] + ['bias'] * bool(bias)
    rows = [head]
    for i, (name, mean, std) in enumerate(zip(WRENCH_AXES, figures['mean'], figures['std'])):
        unit = 'N' if i < 3 else 'N m'
        shown, cells = beside((mean, std), unit)
        rows.append([name, *cells, shown] + (
            [quantity(bias[i], figures['bias_std'][i], unit)] if bias else []))
    return aligned(rows, left=(0, 3))


def in_short(figures: dict[str, Any]) -> str:
    """Return the mean force in a few digits."""
    from forcecal_ros.core.quantity import sizes

    force = figures['mean'][:3]
    return 'no valid one' if None in force else f'mean force {sizes(force, "N", 3)}'
