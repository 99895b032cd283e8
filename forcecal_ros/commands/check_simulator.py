"""``forcecal check-simulator``: whether somebody's simulator can be compared with a robot."""

import argparse
from typing import Any

from forcecal_ros.commands.common import (
    add_json,
    add_topics,
    new_parser,
    print_json,
    say,
    topic_names,
)


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'check-simulator',
        example='forcecal check-simulator my_robot:make my_bag')
    parser.add_argument('simulator', metavar='MODULE:FACTORY',
                        help='a function without arguments that returns the simulator; its code '
                             'is executed')
    parser.add_argument('bag', metavar='BAG', help='recording whose commands it is run with')
    add_topics(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.diagnose.conformance import conformance
    from forcecal_ros.recording.bags import read_recording
    from forcecal_ros.simulators.rig.file import load_rig
    from forcecal_ros.simulators.third_party import load_simulator

    simulator = load_simulator(args.simulator)
    found = conformance(simulator, read_recording(args.bag, topics=topic_names(args)),
                        load_rig('rigid_tool.yaml'))
    if args.json:
        print_json(found.document())
    else:
        say(str(found))
    return 0
