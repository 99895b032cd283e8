"""``forcecal record``: live topics to a recording."""

import argparse
from contextlib import suppress
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.errors import DataError, UsageError


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'record',
        example='forcecal record -o my_bag --duration 60 /joint_states')
    parser.add_argument('topics', metavar='TOPIC', nargs='*', type=common.topic_name,
                        help='topics to record in addition to those of this package (recorded in '
                             'any namespace)')
    common.add_output(parser, '-o', '--output', kind='recording', metavar='BAG', required=True)
    parser.add_argument('--all', action='store_true', help='record all topics')
    parser.add_argument('--only', action='store_true', help='record only the given TOPICs')
    parser.add_argument('--duration', metavar='S', type=common.positive,
                        help='stop after this time')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    # between two searches for new topics [s]
    period = 0.2
    if args.only and (args.all or not args.topics):
        raise UsageError('--only requires TOPICs and excludes --all')
    import time

    with common.needs_ros():
        from forcecal_ros.nodes.bags import of_this_package, Recorder
        from forcecal_ros.nodes.client import temporary_node
    from forcecal_ros.io.bags import BagWriter

    names = {f'/{name.lstrip("/")}' for name in args.topics}
    with (temporary_node('record') as ros,
          BagWriter(args.output, compressed=True) as writer,
          common.bar(args, unit=' messages') as done):
        recorder = Recorder(ros.node, writer, lambda name, msgtype: (
            args.all or name in names or (not args.only and of_this_package(name, msgtype))))
        end = time.monotonic() + args.duration if args.duration is not None else None
        with suppress(KeyboardInterrupt):  # what is recorded counts, however it ends
            while not ros.interrupted and (end is None or time.monotonic() < end):
                recorder.subscribe_to_new_topics()
                ros.spin(period if end is None else max(min(period, end - time.monotonic()),
                                                        0.001))
                done.update(recorder.counts.total() - done.n)
        if not recorder.counts:
            raise DataError('no message was received on any topic to record; set ROS_DOMAIN_ID '
                            'to that of the robot, or give other topics as TOPIC')
    return common.show(
        args, {'output': args.output, 'messages': dict(recorder.counts)}, f'{args.output}: '
        + ', '.join(f'{count} {name}' for name, count in sorted(recorder.counts.items())),
        [*(f'not recorded: messages of type {msgtype}, whose package is not installed'
           for msgtype in sorted(recorder.unknown)),
         *(f'{name}: no message was received; compare the name with ros2 topic list'
           for name in recorder.missing(names))])
