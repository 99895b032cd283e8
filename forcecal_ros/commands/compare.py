"""``forcecal compare``: what changed between two calibrations."""

import argparse
from typing import Any

from forcecal_ros.commands.common import add_json, new_parser, print_json, say


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'compare',
        example='forcecal compare before.yaml after.yaml')
    parser.add_argument('first', metavar='A', help='calibration.yaml, the older one as a rule')
    parser.add_argument('second', metavar='B', help='calibration.yaml to compare with it')
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.calibration.file import load
    from forcecal_ros.report.comparison import as_text, compare, to_document

    comparison = compare(load(args.first), load(args.second))
    if args.json:
        print_json({'first': args.first, 'second': args.second, **to_document(comparison)})
    else:
        say(as_text(comparison))
    return 0
