"""``forcecal compare``: what changed between two calibrations, or two diagnoses."""

import argparse
from pathlib import Path
from typing import Any

from forcecal_ros.cli import common
from forcecal_ros.core.errors import UsageError


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = common.new_parser(
        subparsers, 'compare',
        example='forcecal compare before.yaml after.yaml')
    parser.add_argument('first', metavar='A', help='calibration.yaml, or diagnosis.json (or the '
                        'folder of a diagnosis); usually the older one')
    parser.add_argument('second', metavar='B', help='the same kind of file, of another time or '
                        'another robot')
    parser.add_argument('--fail-on', choices=('drift',),
                        help='drift: exit with status 3 if a value changed beyond chance')


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.diagnose.result import load_diagnosis
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.report.comparison import as_text, compare, compare_diagnoses, to_document

    paths = (args.first, args.second)
    kinds = [_is_diagnosis(path) for path in paths]
    if any(kinds) != all(kinds):
        one, other = sorted(paths, key=_is_diagnosis, reverse=True)
        raise UsageError(f'{one} is a diagnosis, {other} is not; compare two '
                         'diagnoses, or two calibrations')
    found = (compare_diagnoses(*(load_diagnosis(path)[0] for path in paths)) if all(kinds)
             else compare(*map(load, paths)))
    document = {'first': args.first, 'second': args.second, **to_document(found)}
    return common.show(args, document, as_text(found),
                       status=3 if args.fail_on and found.changed else 0)


def _is_diagnosis(path: str) -> bool:
    return path.endswith('.json') or (Path(path) / 'diagnosis.json').exists()
