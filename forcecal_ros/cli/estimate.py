"""``forcecal estimate``: the observer over a recording, by the same step as in the node."""

import argparse
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import contact
from forcecal_ros.cli.argument_types import positive
from forcecal_ros.cli.common import new_parser, read_checked, say_if_compiling
from forcecal_ros.cli.each_recording import add_bags, Answer
from forcecal_ros.cli.each_recording import run as run_each
from forcecal_ros.cli.outputs import add_output, RECORDING
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.observe.playback import Followed

FILTERS = ('kalman', 'newton', 'ukf', 'ekf', 'static')


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'estimate',
        example='forcecal estimate my_bag --calibration calibration.yaml -o contact_bag')
    add_bags(parser)
    parser.add_argument('--calibration', metavar='C.yaml', required=True,
                        help='written by forcecal calibrate, demo or the sequencer')
    parser.add_argument('--filter', '--mode', choices=FILTERS,
                        help='last stage of the observer (default: as the calibration says)')
    parser.add_argument('--bandwidth', metavar='HZ', type=positive,
                        help='of the contact wrench with filter kalman (default: from the noise)')
    contact.add_bandwidth(parser, ('as the calibration says',) * 3)
    parser.add_argument('--inertial-wrench', action='store_true',
                        help="write the wrench of the tool's weight and inertia as well")
    parser.add_argument('--innovation', action='store_true',
                        help='write the innovation (measured - predicted) as well')
    parser.add_argument('--track-tool', action='store_true',
                        help='estimate mass and centre of mass of the tool while they change, '
                             'and write them as observer/tool')
    add_output(parser, '-o', '--output', kind=RECORDING, metavar='OUT_BAG', required=True,
               help='recording to write; an earlier one is kept as OUT_BAG~; of several BAGs, '
                    'a folder for them')
    parser.set_defaults(run=run, inputs=('bag', 'calibration'))


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    said = {'--bandwidth': args.bandwidth, '--contact-walk': args.contact_walk,
            '--bandwidth-min': args.bandwidth_min, '--bandwidth-max': args.bandwidth_max}
    of_kalman = [option for option, value in said.items() if value is not None]
    if of_kalman and args.filter not in (None, 'kalman'):
        raise UsageError(f'{of_kalman[0]} is that of filter kalman, not of {args.filter}; leave '
                         'it out')
    if args.bandwidth is not None and len(of_kalman) > 1:
        raise UsageError(f'--bandwidth says it all; leave {of_kalman[1]} out')
    contact.bandwidth_of(args)
    return run_each(args, answer)


def answer(args: argparse.Namespace) -> Answer:
    """Estimate over one recording."""
    from forcecal_ros.core.stamps import with_even_bursts
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.observe import ObserverSettings, replay
    from forcecal_ros.observe.batch import waits_for_compiler
    from forcecal_ros.observe.frames import taken_as_calibrated
    from forcecal_ros.observe.playback import follow

    settings = ObserverSettings(filter=args.filter, bandwidth_hz=args.bandwidth,
                                **contact.bandwidth_of(args))
    calibration = load(args.calibration)
    recording = contact.in_sign_of(calibration, args.wrench_sign, taken_as_calibrated(
        read_checked(args, args.bag, raw_wrench=calibration.matrix is not None), calibration,
        args.calibration))
    recording = with_even_bursts(recording)
    unknown = contact.refuse_disagreeing(recording, calibration)
    calibration, about = contact.prepared(calibration, recording, settings)
    about = (*unknown, *about)
    followed = None
    if args.track_tool:
        followed = follow(recording, calibration, settings)
        estimate = followed.contact
    else:
        say_if_compiling(waits_for_compiler(), 'the observer')
        estimate = replay(recording, calibration, settings)
    also = [name for name, asked in (
        ('inertial', args.inertial_wrench), ('innovation', args.innovation)) if asked]
    contact.write_estimate(args.output, estimate, calibration, recording.start_ns, also,
                           () if followed is None else followed.announced)
    figures = contact.statistics(estimate)
    notes = (*recording.notes, *about, *contact.status_notes(estimate))
    count = f'{figures["samples"]} contact wrenches{contact.over_which(figures)}'
    lines = [f'{args.output}: {count}', *contact.table(figures)]
    if followed is not None:
        figures['tool'] = tool_figures(followed)
        lines += tool_lines(figures['tool'])
    text = '\n'.join(lines)
    return Answer({'output': args.output, 'notes': list(notes), **figures}, text,
                  f'{count}, {contact.in_short(figures)}', notes)


def tool_figures(followed: 'Followed') -> dict[str, Any]:
    """Return what hung on the sensor at the end, how sure that is, and what changed when."""
    from collections import Counter

    from forcecal_ros.core.errors import DataError

    if not followed.tools:
        raise DataError('no stretch of the recording tells what hangs on the sensor: a pose and '
                        'a wrench that is no saturated number are wanted together')
    last = followed.tools[-1]
    words = Counter(one.state for one in followed.tools)
    known = last.suspected == last.suspected
    return {
        'state': last.state, 'mass': last.mass, 'mass_std': last.mass_std,
        'com': last.com.tolist(), 'com_std': last.com_std.tolist(),
        'suspected_change': last.suspected if known else None,
        'suspected_change_std': last.suspected_std if known else None,
        'changes': [one._asdict() for one in followed.changes],
        'share': {word: count / len(followed.tools) for word, count in sorted(words.items())}}


def tool_lines(tool: dict[str, Any]) -> list[str]:
    """Say the same in words."""
    from forcecal_ros.core.quantity import quantity

    lines = [f'tool: {tool["state"]}, {quantity(tool["mass"], tool["mass_std"], "kg")}, centre of '
             'mass ' + ', '.join(quantity(x, std, 'm') for x, std in zip(
                 tool['com'], tool['com_std']))]
    told = {True: 'weight and accelerations', False: 'weight alone: a steady push straight down '
            'is not excluded'}
    lines += [f'tool: {quantity(one["mass"], 0.0, "kg", signed=True)} known at {one["t"]:.2f} s, '
              f'by {told[one["inert"]]}' for one in tool['changes']]
    if tool['suspected_change'] is not None:
        by = quantity(tool['suspected_change'], tool['suspected_change_std'], 'kg')
        lines.append(f'tool: may have changed by {by}, or something pushes; turn it to tell')
    return lines
