"""``forcecal node``: a node of this package, without ``ros2 run``."""

import argparse
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.entry import loaded

NODES = ('gap', 'impedance', 'observer', 'sequencer', 'sim')


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'node', json=False, quiet=False,
        example='forcecal node sequencer --ros-args -r wrench:=/ft/wrench --params-file my.yaml')
    parser.add_argument('name', metavar='NODE', choices=NODES, help=', '.join(NODES))
    parser.add_argument('arguments', metavar='--ros-args ...', nargs=argparse.REMAINDER,
                        help='ROS arguments, as of ros2 run: -p NAME:=VALUE, --params-file FILE, '
                             '-r TOPIC:=TOPIC, -r __ns:=/NAME')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    with common.needs_ros():
        main = loaded(f'nodes.{args.name}', 0)
    return int(main([args.name, *args.arguments]))
