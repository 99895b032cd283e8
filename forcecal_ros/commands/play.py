"""``forcecal play``: a recording published again."""

import argparse
from typing import Any

from forcecal_ros.commands.common import add_json, new_parser, print_json, say, warn

ACKNOWLEDGE = 2.0
"""How long the end waits for slow listeners [s]."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'play',
        summary='publish a recording again, with the recorded time on /clock',
        example='forcecal play my_bag --rate 0.5')
    parser.add_argument('bag', metavar='BAG', help='rosbag2 folder or file (mcap, sqlite3)')
    parser.add_argument('--rate', metavar='X', type=float, default=1.0,
                        help='recorded seconds a second')
    parser.add_argument('--clock', metavar='HZ', type=float, default=250.0,
                        help='how often /clock tells the recorded time; 0: not at all')
    parser.add_argument('--delay', metavar='S', type=float, default=1.0,
                        help='wait before the first message, for listeners to find the topics')
    parser.add_argument('--start', metavar='S', type=float, default=0.0,
                        help='leave out the beginning')
    parser.add_argument('--only', metavar='TOPIC', action='append', default=[],
                        help='publish this topic, and of the others only those named likewise')
    parser.add_argument('--prefix', metavar='NAMESPACE', default='',
                        help='publish below a namespace, e.g. /recorded')
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from itertools import chain, dropwhile
    import time

    from forcecal_ros.errors import ConfigError, DataError
    from forcecal_ros.nodes.player import Player
    from forcecal_ros.nodes.session import session
    from forcecal_ros.recording.bags import read_messages, read_topics
    from forcecal_ros.recording.topics import Topic
    from tqdm import tqdm

    if not args.rate > 0 or not args.clock >= 0:
        raise ConfigError('--rate has to be above 0 and --clock not below 0')
    only = {f'/{name.lstrip("/")}' for name in args.only}
    prefix = f'/{args.prefix.strip("/")}' if args.prefix.strip('/') else ''

    def wanted(topic: Topic) -> bool:
        return topic.name in only if only else topic.name != '/clock' or not args.clock

    def show(bar: Any, seconds: float) -> None:
        bar.update(round(seconds, 1) - bar.n)

    topics = [topic for topic in read_topics(args.bag) if wanted(topic)]
    messages = read_messages(args.bag, wanted)
    first = next(messages, None)
    if first is None:
        raise DataError(f'{args.bag}: no messages to publish')
    begin = first.log_ns + int(args.start * 1e9)
    with session('play') as ros, tqdm(unit=' s', disable=None, leave=False) as bar:
        player = Player(ros, args.rate, args.clock, lambda name: f'{prefix}{name}')
        player.offer(topics)
        time.sleep(args.delay)
        player.play(dropwhile(lambda one: one.log_ns < begin, chain([first], messages)),
                    lambda seconds: show(bar, seconds))
        player.finish(ACKNOWLEDGE)
    for msgtype in sorted(player.unknown):
        warn(f'not published: messages of type {msgtype}, whose package is not installed')
    if args.json:
        print_json({'bag': args.bag, 'messages': dict(player.counts)})
    else:
        say(', '.join(f'{count} {name}' for name, count in sorted(player.counts.items()))
            or 'nothing was published')
    return 0
