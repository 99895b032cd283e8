"""``forcecal fleet``: what drifted, of many robots over many nights."""

import argparse
from functools import partial
import json
from typing import Any

from forcecal_ros.cli.calibrate import add_identification, calibrated, check_identification
from forcecal_ros.cli.common import (
    add_sensor_pose,
    add_topics,
    bar,
    Listed,
    new_parser,
    positive,
    print_json,
    read_checked,
    say,
    warn,
)
from forcecal_ros.cli.many import add_workers, check_workers, each
from forcecal_ros.cli.outputs import add_output, RESULTS
from forcecal_ros.core.files import write_results

FILES = ('fleet.html', 'fleet.csv', 'fleet.json')
"""All that a run writes; the last one keeps what was read, for the next run."""

HOW = ('topic', 'sensor_from_pose', 'wrench_sign', 'gravity', 'gravity_direction',
       'sensor_rotation', 'coupling', 'cutoff', 'accelerometer_position', 'theta', 'filter',
       'design', 'contact_walk', 'bandwidth_min', 'bandwidth_max', 'robot')
"""Arguments that the calibration of a recording depends on."""


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = new_parser(subparsers, 'fleet', example='forcecal fleet nights/ -o fleet')
    parser.add_argument('places', metavar='DIR', nargs='+', action=Listed,
                        help='folder with calibrations, diagnoses and recordings of robots, which '
                             'is searched, or one of them; several, or @FILE with one a line')
    add_output(parser, '-o', '--output', kind=RESULTS, metavar='OUT', required=True,
               help='folder for fleet.html, fleet.csv and fleet.json, by which the next run knows '
                    'what it has read')
    parser.add_argument('--no-bags', action='store_true',
                        help='leave recordings out; without it each of them is calibrated')
    parser.add_argument('--run-length', metavar='N', type=positive, default=1000.0,
                        help='calibrations of a robot between two false alarms, on average, over '
                             'all its numbers')
    add_topics(parser)
    add_sensor_pose(parser)
    parser.add_argument('--wrench-sign', type=int, choices=(1, -1), default=1,
                        help='-1 for drivers that report the wrench of the tool on its '
                             'environment')
    add_identification(parser)
    add_workers(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Carry it out."""
    from forcecal_ros.fleet.entries import find, plain
    from forcecal_ros.fleet.history import histories, once
    from forcecal_ros.fleet.page import as_csv, headline, render, to_document

    check_workers(args)
    check_identification(args)
    found = find(args.places, args.output, not args.no_bags)
    kept = _kept(args)
    entries = _read(args, found, kept)
    fresh = sum(one.path not in kept or kept[one.path][0] != _mark(args, one) for one in found)
    counted = once(entries)
    robots = histories(counted, args.run_length)
    memory = {one.path: [_mark(args, one), plain(entry)] for one, entry in zip(found, entries)}
    write_results(args.output, {
        'fleet.html': render(counted, robots, args.run_length),
        'fleet.csv': as_csv(counted, robots),
        'fleet.json': json.dumps({'format': 'forcecal-fleet/1', 'read': memory}) + '\n'}, FILES)
    failed = [entry for entry in entries if entry.error]
    for entry in failed:
        warn(f'{entry.path}: {entry.error}')
    if args.json:
        print_json({'read': len(entries) - len(failed), 'new': fresh,
                    **to_document(counted, robots)})
    else:
        say(f'{headline(robots)}\n{len(entries) - len(failed)} of {len(entries)} could be read, '
            f'{fresh} were new; written to {args.output}')
    return 1 if failed else 0


def _mark(args: argparse.Namespace, one: Any) -> str:
    """Say what an entry depends on: the file, and how a recording is calibrated."""
    from forcecal_ros import __version__

    how = {name: getattr(args, name) for name in HOW} if one.kind == 'bag' else {}
    return json.dumps([__version__, one.folder, one.mark, how])


def _kept(args: argparse.Namespace) -> dict[str, Any]:
    """Return what a run before has read, mark and entry by path; nothing where it is damaged."""
    from pathlib import Path

    from forcecal_ros.fleet.entries import again

    try:
        document = json.loads((Path(args.output) / 'fleet.json').read_text())
        return {path: (mark, again(entry)) for path, (mark, entry) in document['read'].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _read(args: argparse.Namespace, found: list[Any], kept: dict[str, Any]) -> list[Any]:
    """Read what is new, and take the rest as it was read before."""
    entries: list[Any] = [None] * len(found)
    new = []
    for i, one in enumerate(found):
        mark, before = kept.get(one.path, ('', None))
        if mark == _mark(args, one):
            entries[i] = before
        else:
            new.append(i)
    work = partial(read_one, argparse.Namespace(**{
        name: value for name, value in vars(args).items() if name in HOW}))
    with bar(args, total=len(new), unit=' files') as done:
        for outcome in each(work, [found[i] for i in new], jobs=args.jobs, dask=args.dask or ''):
            i = new[outcome.index]
            entries[i] = outcome.value or _unreadable(found[i], outcome.error)
            done.update()
    return entries


def _unreadable(one: Any, error: str) -> Any:
    """Return the entry of what could not be read; its path is not said twice."""
    from pathlib import Path

    from forcecal_ros.fleet.entries import Entry

    why = error.removeprefix(one.path).removeprefix(':').strip()
    return Entry(one.folder, one.kind, one.path, Path(one.path).stat().st_mtime, error=why)


def read_one(args: argparse.Namespace, one: Any) -> Any:
    """Read one file, or calibrate one recording."""
    from forcecal_ros.fleet.entries import (
        BAG,
        DIAGNOSIS,
        of_calibration,
        read_calibration,
        read_diagnosis,
    )

    if one.kind == BAG:
        return of_calibration(calibrated(read_checked(args, one.path, ['wrench', 'pose']), args),
                              BAG, one.path, one.folder)
    return (read_diagnosis if one.kind == DIAGNOSIS else read_calibration)(one.path, one.folder)
