"""``forcecal compare``: what changed between two calibrations, or two diagnoses."""

import argparse
from pathlib import Path
from typing import Any, TYPE_CHECKING

from forcecal_ros.cli.common import new_parser, show
from forcecal_ros.core.errors import UsageError

if TYPE_CHECKING:
    from forcecal_ros.report.comparison import Comparison


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(
        subparsers, 'compare',
        example='forcecal compare before.yaml after.yaml')
    parser.add_argument('first', metavar='A', help='calibration.yaml, or diagnosis.json (or the '
                        'folder of a diagnosis); usually the older one')
    parser.add_argument('second', metavar='B', help='the same of another time, or of another '
                        'robot')
    parser.add_argument('--fail-on', choices=('drift',),
                        help='drift: exit with status 3 if a number changed beyond chance')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.report.comparison import as_text, to_document

    kinds = [_is_diagnosis(path) for path in (args.first, args.second)]
    if any(kinds) != all(kinds):
        one, other = sorted((args.first, args.second), key=_is_diagnosis, reverse=True)
        raise UsageError(f'{one} is a diagnosis, {other} is not; name two of a kind')
    comparison = (_of_diagnoses if all(kinds) else _of_calibrations)(args.first, args.second)
    show(args, {'first': args.first, 'second': args.second, **to_document(comparison)},
         as_text(comparison))
    return 3 if args.fail_on and comparison.changed else 0


def _is_diagnosis(path: str) -> bool:
    return path.endswith('.json') or (Path(path) / 'diagnosis.json').exists()


def _of_calibrations(first: str, second: str) -> 'Comparison':
    from forcecal_ros.io.calibration_file import load
    from forcecal_ros.report.comparison import compare

    return compare(load(first), load(second))


def _of_diagnoses(first: str, second: str) -> 'Comparison':
    from forcecal_ros.diagnose.result import load_diagnosis
    from forcecal_ros.report.comparison import compare_diagnoses

    return compare_diagnoses(load_diagnosis(first)[0], load_diagnosis(second)[0])
