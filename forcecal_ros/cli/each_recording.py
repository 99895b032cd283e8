"""One command over one recording or many: here, on several cores, or on a Dask cluster."""

import argparse
from collections.abc import Callable, Mapping, Sequence
import json
import os
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.cli.argument_types import address, at_least_one
from forcecal_ros.cli.common import add_bag, add_json, print_json, say, warn
from forcecal_ros.cli.outputs import (
    of_many,
    Output,
    refuse_inputs,
    RESULTS,
    stdout_is_taken,
)
from forcecal_ros.cli.progress import add_quiet, bar
from forcecal_ros.core.errors import ConfigError, DataError, UsageError
from forcecal_ros.core.files import blamed


class Answer(NamedTuple):
    """
    What a command has to say about one recording.

    Attributes
    ----------
    document : mapping
        What ``--json`` prints.
    text : str
        The same to read.
    headline : str
        One line of it, for many recordings.
    notes : tuple of str
        What the user should know of.
    status : int
        Exit status.
    """

    document: Mapping[str, Any]
    text: str
    headline: str
    notes: tuple[str, ...] = ()
    status: int = 0


def add_bags(parser: argparse.ArgumentParser) -> None:
    """Add the recordings, what :func:`add_bag` adds, ``--jobs``, ``--dask`` and ``--json``."""
    add_bag(parser, several='each is worked on by itself')
    add_workers(parser)
    add_quiet(parser)
    add_json(parser)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add ``--jobs`` and ``--dask``."""
    parser.add_argument('--jobs', metavar='N', type=at_least_one, default=1,
                        help='how many recordings are worked on at once')
    parser.add_argument('--dask', metavar='ADDRESS', type=address,
                        help='scheduler of a Dask cluster to work there, as tcp://host:8786; its '
                             'workers need this package and the same files in the same places')


def check_workers(args: argparse.Namespace) -> None:
    """Refuse --jobs together with --dask."""
    if args.dask and args.jobs > 1:
        raise UsageError('--jobs counts processes of this machine, --dask works elsewhere; '
                         'leave --jobs out')


def run(args: argparse.Namespace, answer: Callable[[argparse.Namespace], Answer]) -> int:
    """
    Answer for every recording and print each answer as soon as it is there.

    One recording is written to what ``--output`` names. Of many, or where ``--output`` ends with
    a slash, that is a folder which holds the results under the names of the recordings, below
    what their paths have in common.

    Parameters
    ----------
    args : argparse.Namespace
        Of a parser with :func:`add_bags` and ``--output``.
    answer : callable
        Of a module of this package; takes the same arguments with one ``bag``.

    Returns
    -------
    int
        Exit status: 1 where any recording has no answer.
    """
    check_workers(args)
    many = of_many(args)
    tasks = _tasks(args, args.bag) if many else [_with(args, bag=args.bag[0])]
    if many or args.dask:
        return _show_each(tasks, answer, args, many)
    return _show(answer(tasks[0]), args)


def _with(args: argparse.Namespace, **changes: Any) -> argparse.Namespace:
    return argparse.Namespace(**{**vars(args), **changes})


def _tasks(args: argparse.Namespace, bags: Sequence[str]) -> list[argparse.Namespace]:
    """Return the arguments for each recording alone, which any working directory will do for."""
    named = [Path(bag).absolute() for bag in bags]
    paths = [Path(os.path.normpath(path)) for path in named]  # `..` would lead out of DIR
    common = Path(os.path.commonpath([path.parent for path in paths]))
    shared = {name: str(Path(value).absolute()) for name in args.inputs
              if name != 'bag' and (value := getattr(args, name)) and Path(value).exists()}
    tasks, owner, read = [], dict[Path, Path](), set[str]()
    for bag, path in zip(named, paths, strict=True):
        inside = path.relative_to(common)
        name = inside.with_suffix('') if path.suffix in ('.mcap', '.db3') else inside
        if os.path.realpath(bag) in read:
            raise UsageError(f'{path} is named twice; name each recording once')
        read.add(os.path.realpath(bag))
        if name in owner:
            raise UsageError(f'{owner[name]} and {path} would both be written to {name}; '
                              'give each its own command')
        owner[name] = path
        written = {one.name: str(Path(value).absolute() / f'{name}{one.suffix}')
                   for one in args.outputs if (value := getattr(args, one.name))}
        tasks.append(_with(args, bag=str(bag), quiet=True, **shared, **written))
    for task in tasks:
        for one in args.outputs:
            if place := getattr(task, one.name):
                _make_room(place, one, bags)
    return tasks


def _make_room(place: str, output: Output, bags: Sequence[str]) -> None:
    """Make the folder of one of many results, none of which takes the place of a recording."""
    if output.kind != RESULTS:
        try:
            refuse_inputs(place, output.kind, bags)
        except ConfigError as error:
            raise UsageError(f'{output.option}: {error}') from error
    with blamed(Path(place)):
        Path(place).parent.mkdir(parents=True, exist_ok=True)


def _set_aside(task: argparse.Namespace) -> None:
    """Rename what an earlier run found in a recording that has no answer now."""
    from forcecal_ros.core.files import set_aside

    for one in task.outputs:
        place = getattr(task, one.name)
        if place and os.path.lexists(place):
            set_aside(Path(place))


def _show_each(tasks: Sequence[argparse.Namespace],
               answer: Callable[[argparse.Namespace], Answer], args: argparse.Namespace,
               many: bool) -> int:
    from forcecal_ros.cli.parallel import each

    answered = 0
    with bar(args, total=len(tasks), unit=' recordings') as done:
        for outcome in each(answer, tasks, jobs=args.jobs, dask=args.dask or ''):
            done.clear()
            if not many and outcome.error:
                raise DataError(outcome.error)
            if not many and outcome.value is not None:
                return _show(outcome.value, args)
            if outcome.error:
                _set_aside(tasks[outcome.index])
            answered += _show_one_of_many(
                tasks[outcome.index].bag, outcome.value, outcome.error, args.json)
            done.update()
    if not args.json:
        say(f'{answered} of {len(tasks)} recordings have an answer, in {args.output}')
    return 0 if answered == len(tasks) else 1


def _show(answer: Answer, args: argparse.Namespace) -> int:
    if args.json:
        print_json(answer.document)
    else:
        for note in answer.notes:
            warn(note)
        if not stdout_is_taken(args):
            say(answer.text)
    if answer.status:
        warn(answer.headline)
    return answer.status


def _show_one_of_many(bag: str, answer: Answer | None, error: str, as_json: bool) -> bool:
    """Print one line, with ``--json`` one document; tell whether there is an answer."""
    if answer is None:
        warn(f'{bag}: {error}')
        if as_json:
            say(json.dumps({'recording': bag, 'error': error}))
        return False
    if as_json:
        say(json.dumps({'recording': bag, **answer.document}, allow_nan=False))
    else:
        for note in answer.notes:
            warn(f'{bag}: {note}')
        say(f'{bag}: {answer.headline}')
    return answer.status == 0
