"""``forcecal estimate``: the observer over a recording, by the same step as in the node."""

import argparse
from collections import Counter
from typing import Any, TYPE_CHECKING

from forcecal_ros.commands.common import new_parser, say_if_compiling, topic_names
from forcecal_ros.commands.fleet import add_bags, Answer
from forcecal_ros.commands.fleet import run as run_each

if TYPE_CHECKING:
    from forcecal_ros.calibration.model import Calibration
    from forcecal_ros.recording.streams import Recording

DELAY_STD = 5e-4
"""A delay found in the recording itself is used where its standard error is below this [s]."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'estimate',
        summary='run the contact-force observer over a recording',
        example='forcecal estimate my_bag --calibration calibration.yaml -o contact_bag')
    add_bags(parser)
    parser.add_argument('--calibration', metavar='C.yaml', required=True,
                        help='written by forcecal calibrate, demo or the sequencer')
    parser.add_argument('--mode', choices=('kalman', 'newton'),
                        help='which observer (default: as the calibration says)')
    parser.add_argument('--bandwidth', metavar='HZ', type=float,
                        help='of the contact wrench in mode kalman (default: from the noise)')
    parser.add_argument('--inertial-wrench', action='store_true',
                        help='write what weight and motion of the tool put on the sensor as well')
    parser.add_argument('--innovation', action='store_true',
                        help='write what the filter did not expect as well')
    parser.add_argument('-o', '--output', metavar='OUT_BAG', required=True,
                        help='recording to write; one that is there is kept as OUT_BAG~; of '
                             'several BAGs, a folder for them')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    return run_each(args, answer, {'output': ''}, ['calibration'])


def answer(args: argparse.Namespace) -> Answer:
    """Estimate over one recording."""
    from forcecal_ros.calibration.file import dump, load
    from forcecal_ros.observe import describe, replay, Settings
    from forcecal_ros.observe.batch import waits_for_compiler
    from forcecal_ros.recording.bags import read_recording, write_signals
    from forcecal_ros.recording.streams import Stream
    import numpy as np

    calibration = load(args.calibration)
    recording = read_recording(
        args.bag, topics=topic_names(args), wrench_sign=args.wrench_sign)
    calibration, about_delay = with_known_delay(calibration, recording)
    say_if_compiling(waits_for_compiler(), 'the observer')
    estimate = replay(recording, calibration, Settings(
        mode=args.mode, bandwidth_hz=args.bandwidth))
    frame = calibration.sensor_frame
    write_signals(args.output, {
        'contact_wrench': Stream(estimate.t, estimate.contact, frame),
        'inertial_wrench': Stream(estimate.t, estimate.inertial, frame)
        if args.inertial_wrench else None,
        'innovation': Stream(estimate.t, estimate.innovation, frame) if args.innovation else None,
        'calibration': dump(calibration),
    }, recording.start_ns)
    seen: Counter[str] = Counter()
    for status, count in zip(*np.unique(estimate.status, return_counts=True)):
        for sentence in describe(int(status)):
            seen[sentence] += int(count)
    notes = [*recording.notes, *about_delay, *(f'{text} ({n} of {len(estimate.t)} samples)'
                                 for text, n in seen.items())]
    mean, std = estimate.contact.mean(axis=0), estimate.contact.std(axis=0)
    document = {'output': args.output, 'samples': len(estimate.t), 'notes': notes,
                'mean': mean.tolist(), 'std': std.tolist(), 'unit': 'N, N m'}
    means = 'mean [N, N m]  ' + '  '.join(f'{x:9.4f}' for x in mean)
    count = f'{len(estimate.t)} contact wrenches'
    text = '\n'.join((f'{args.output}: {count}', means,
                      'std  [N, N m]  ' + '  '.join(f'{x:9.4f}' for x in std)))
    return Answer(document, text, f'{count}, {means}', tuple(notes))


def with_known_delay(calibration: 'Calibration', recording: 'Recording'
                     ) -> tuple['Calibration', tuple[str, ...]]:
    """
    Find the delay between the sensors in the recording, where the calibration does not know it.

    Returns
    -------
    calibration : Calibration
        As given where it knows the delay, or the recording does not tell.
    notes : tuple of str
        What was assumed.
    """
    from forcecal_ros.errors import DataError
    from forcecal_ros.identify.delay import estimate_delay, with_delay
    import numpy as np

    sensor = calibration.accelerometer
    if sensor is None or recording.accelerometer is None or np.isfinite(sensor.delay.std):
        return calibration, ()
    unknown = ('the calibration does not know the delay of the accelerometer; calibrate with '
               '--free-motion')
    try:
        delay = estimate_delay(recording, calibration)
    except DataError as error:
        return calibration, (f'{unknown}; taken to be 0: {error}',)
    found = f'{1e3 * float(delay):.2f} +- {1e3 * float(delay.std):.2f} ms in this recording'
    if not delay.std < DELAY_STD:
        return calibration, (f'{unknown}; taken to be 0, as {found} is not sure enough',)
    return with_delay(calibration, delay), (f'{unknown}; found {found}',)
