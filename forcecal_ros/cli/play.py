"""``forcecal play``: a recording published again, without what might move a robot."""

import argparse
from collections.abc import Iterable, Sequence
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli import common
from forcecal_ros.core.errors import DataError, MotionError

if TYPE_CHECKING:
    from forcecal_ros.core.topics import Topic
    from forcecal_ros.nodes.bags import Player


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'play',
        example='forcecal play my_bag --rate 0.5')
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder or file (mcap, sqlite3)')
    parser.add_argument('--rate', metavar='X', type=common.positive, default=1.0,
                        help='playback speed, in recorded seconds per second')
    parser.add_argument('--clock', metavar='HZ', type=common.not_negative, default=250.0,
                        help='rate of /clock, which carries the recorded time; 0: none')
    parser.add_argument('--delay', metavar='S', type=common.not_negative, default=1.0,
                        help='wait before the first message, for listeners to find the topics')
    parser.add_argument('--start', metavar='S', type=common.not_negative, default=0.0,
                        help='skip this much of the beginning')
    parser.add_argument('--only', metavar='TOPIC', action='append', default=[],
                        type=common.topic_name,
                        help='publish only this topic; may be repeated')
    common.add_namespace(parser, 'publish in a namespace, e.g. /recorded')
    parser.add_argument('--with-outputs', action='store_true',
                        help='also publish the outputs of the recorded nodes of this package: '
                             'observer/..., sequencer/..., impedance/..., diagnostics')
    parser.add_argument('--with-commands', action='store_true',
                        help='publish everything, also target_frame and other commands. A ROBOT '
                             'THAT SUBSCRIBES TO THEM MOVES AT ONCE, without any start; refused '
                             'while a node subscribes to them')
    parser.add_argument('--yes', action='store_true',
                        help='publish commands even if a node subscribes to them')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    with common.needs_ros():
        from forcecal_ros.nodes.bags import Player
        from forcecal_ros.nodes.client import temporary_node
    from itertools import chain, dropwhile
    import time

    from forcecal_ros.io.bags import read_messages, read_topics

    topics = read_topics(args.bag)
    refuse_missing(topics, args)
    named, left_out = chosen(topics, args)
    prefix = f'/{args.namespace.strip("/")}' if args.namespace.strip('/') else ''
    messages = read_messages(args.bag, named.__contains__)
    first = next(messages, None)
    if first is None:
        raise DataError(f'{args.bag}: no messages to publish'
                        + (f' and {_named(left_out)}' if left_out else ''))
    begin = first.log_ns + int(args.start * 1e9)
    commands = [topic for topic in named if topic.is_command]
    with temporary_node('play') as ros:
        player = Player(ros, args.rate, args.clock, lambda name: f'{prefix}{name}')
        player.offer(named)
        # time to find subscribers of commands: discovery of DDS takes 3 s at worst [s]
        time.sleep(max(args.delay, 3.5) if commands else args.delay)
        if not args.yes:
            refuse_listeners(player, commands)
            player.unreceived = set(commands)
        with common.bar(args, unit=' s') as done:
            player.play(dropwhile(lambda one: one.log_ns < begin, chain([first], messages)),
                        lambda seconds: done.update(round(seconds, 1) - done.n))
        # how long the end waits for slow listeners [s]
        player.finish(2.0)
        if args.start and not player.counts and not ros.interrupted:
            raise DataError(f'{args.bag}: nothing to publish from {args.start:g} s on; give an '
                            'earlier --start')
    notes = [f'messages of type {msgtype}, whose package is not installed'
             for msgtype in sorted(player.unknown)]
    return common.show(
        args, {'bag': args.bag, 'messages': dict(player.counts)},
        ', '.join(f'{count} {name}' for name, count in sorted(player.counts.items()))
        or 'nothing was published',
        [f'not published: {one}' for one in (_named(left_out), *notes) if one])


def refuse_missing(topics: Iterable['Topic'], args: argparse.Namespace) -> None:
    """
    Refuse names that are not in the recording.

    Raises
    ------
    DataError
        With the nearest name.
    """
    names = sorted(topic.name for topic in topics)
    for name in (f'/{one.lstrip("/")}' for one in args.only):
        if name not in names:
            nearest = common.or_nearest(name, names)
            raise DataError(f'--only: {name} is not in {args.bag}{nearest}; it has '
                            f'{", ".join(names)}')


def chosen(topics: Iterable['Topic'], args: argparse.Namespace
           ) -> tuple[list['Topic'], list['Topic']]:
    """Return the topics of a recording to publish, and those that would have to be requested."""
    only = {f'/{name.lstrip("/")}' for name in args.only}
    published: list[Topic] = []
    left_out: list[Topic] = []
    for topic in topics:
        if (only and topic.name not in only) or (
                not only and topic.name == '/clock' and args.clock):
            continue
        published_too = args.with_commands or (not topic.is_command and (
            args.with_outputs or bool(only) or not topic.is_output))
        (published if published_too else left_out).append(topic)
    return published, left_out


def _named(left_out: Sequence['Topic']) -> str:
    """Say what was left out, and how to ask for it."""
    commands = sorted(topic.name for topic in left_out if topic.is_command)
    outputs = sorted(topic.name for topic in left_out if not topic.is_command)
    return '; '.join(f'{", ".join(names)} ({why})' for names, why in (
        (commands, 'commands that a robot follows: --with-commands'),
        (outputs, 'outputs of nodes that may be running: --with-outputs')) if names)


def refuse_listeners(player: 'Player', commands: Sequence['Topic']) -> None:
    """
    Refuse commands that a node would hear.

    Raises
    ------
    MotionError
        Names topics and nodes.
    """
    if listeners := player.listeners(commands):
        who = ', '.join(f'{topic} ({", ".join(nodes)})' for topic, nodes in listeners.items())
        raise MotionError(f'nodes subscribe to {who} and may move at once; give --yes if that is '
                          'intended')
