"""``forcecal import``: tables of numbers to a recording."""

import argparse
from typing import Any

from forcecal_ros.cli import common


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'import', inputs=('specification', 'tables'), json=False, quiet=False,
        example='forcecal import my_log.yaml -o my_bag')
    parser.add_argument('specification', metavar='SPEC.yaml',
                        help='columns, units and frames of each signal')
    parser.add_argument('--tables', metavar='DIR',
                        help='folder of the tables (default: that of SPEC.yaml)')
    common.add_output(parser, '-o', '--output', kind='recording', metavar='BAG', required=True)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.core.topics import ROLES
    from forcecal_ros.io.bags import write_signals
    from forcecal_ros.io.csv_import import assemble, load_specification

    imported = assemble(load_specification(args.specification, args.tables))
    write_signals(args.output, imported.signals, imported.start_ns, topics=imported.topics)
    for role, signal in imported.signals.items():
        common.say(f'{imported.topics.get(role, ROLES[role].topic)}: {len(signal)} messages')
    for note in imported.notes:
        common.warn(note)
    if imported.shift:
        common.say(f'{imported.shift} s were added to the times of the tables, as stamps must be '
                   'positive')
    return 0
