"""``forcecal fleet``: what drifted, of many robots over many nights."""

import argparse
import json
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.files import write_results

FILES = ('fleet.html', 'fleet.csv', 'fleet.json')


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(subparsers, 'fleet', example='forcecal fleet nights/ -o fleet')
    parser.add_argument('places', metavar='DIR', nargs='+',
                        help='folder to search for calibrations and diagnoses of robots, or one '
                             'such file; several, or @FILE with one per line')
    common.add_output(parser, '-o', '--output', kind='results', metavar='OUT', required=True,
                      help='folder for fleet.html, fleet.csv and fleet.json')
    parser.add_argument('--run-length', metavar='N', type=common.positive, default=1000.0,
                        help='mean number of calibrations of a robot between two false alarms, '
                             'over all its values')
    parser.add_argument('--fail-on', choices=('drift',),
                        help='drift: exit with status 3 if a value left its control limits')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.report import fleet

    entries = [*{one.path: one for place in args.places for one in fleet.read(place)}.values()]
    robots = fleet.histories(entries, args.run_length)
    document = fleet.to_document(entries, robots)
    write_results(args.output, {
        'fleet.html': fleet.render(entries, robots, args.run_length),
        'fleet.csv': fleet.as_csv(entries, robots),
        'fleet.json': json.dumps(document, indent=1) + '\n'}, FILES)
    failed = [f'{entry.path}: {entry.error}' for entry in entries if entry.error]
    read = len(entries) - len(failed)
    drifted = args.fail_on and any(robot.changed for robot in robots)
    return common.show(
        args, {'read': read, **document}, f'{fleet.headline(robots)}\n{read} of {len(entries)} '
        f'could be read; written to {args.output}', failed, 3 if drifted else 1 if failed else 0)
