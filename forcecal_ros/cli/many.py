"""One command over one recording or many: here, on several cores, or on a Dask cluster.

The answers are the same everywhere, and each comes as soon as it is there. A worker that is killed
costs nothing but time: its work is done again.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import json
import os
from pathlib import Path
import signal
from threading import Lock
from typing import Any, NamedTuple

from forcecal_ros.cli import common
from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, UsageError, with_id
from forcecal_ros.core.files import naming, set_aside

_TURN = Lock()

MANY = '; with several BAGs, a folder'
"""Ends the help of an output of a command with several recordings."""


@dataclass(frozen=True)
class Outcome:
    """Index of an item, what the work returned, and why it returned nothing, in one line."""

    index: int
    value: Any = None
    error: str = ''


def each(work: Callable[[Any], Any], items: Sequence[Any], *, jobs: int = 1, dask: str = ''
         ) -> Iterator[Outcome]:
    """
    Do the same to every item and yield each outcome, in the order they are done.

    An item that fails does not keep the others from being done.

    Parameters
    ----------
    work : callable
        A function of an importable module (or a ``functools.partial`` of one): workers find it by
        its name. Items and results travel between processes.
    jobs : int
        Processes on this machine; 1: this one.
    dask : str
        Address of the scheduler of a Dask cluster, as ``tcp://host:8786``. Its workers need this
        package and the same files under the same names.

    Raises
    ------
    ConfigError
        There is no such cluster, or the extra ``scale`` is not installed.
    """
    if dask:
        yield from _on_cluster(work, items, dask)
    elif jobs > 1 and len(items) > 1:
        yield from _on_cores(work, items, jobs)
    else:
        for index, item in enumerate(items):
            yield attempt(work, index, item)


def attempt(work: Callable[[Any], Any], index: int, item: Any) -> Outcome:
    """Do one item; threads of one process take turns, as not everything here is thread-safe."""
    try:
        with _TURN:
            return Outcome(index, work(item))
    except ForcecalError as error:
        return Outcome(index, error=with_id(error))
    except Exception as error:  # noqa: BLE001 - of one recording, and the others go on
        from traceback import extract_tb

        at = extract_tb(error.__traceback__)[-1]
        return Outcome(
            index, error=f'{type(error).__name__}: {error} ({at.filename}:{at.lineno})')


def _on_cores(work: Callable[[Any], Any], items: Sequence[Any], jobs: int) -> Iterator[Outcome]:
    """Work in processes; after a death, the items that may have caused it are done alone."""
    from concurrent.futures import as_completed, ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool
    from multiprocessing import get_context

    for threads in ('OMP', 'OPENBLAS', 'MKL'):  # more would round in another order
        os.environ.setdefault(f'{threads}_NUM_THREADS', '1')
    left, suspects = list(range(len(items))), list[int]()
    while left:
        batch = suspects[:1] or list(left)
        pool = ProcessPoolExecutor(min(jobs, len(batch)), get_context('spawn'),
                                   signal.signal, (signal.SIGINT, signal.SIG_IGN))
        try:
            futures = [pool.submit(attempt, work, index, items[index]) for index in batch]
            for future in as_completed(futures):
                outcome = future.result()
                left.remove(outcome.index)
                yield outcome
            suspects = suspects[1:]
        except BrokenProcessPool:
            if suspects:
                left.remove(suspects[0])
                yield Outcome(suspects.pop(0), error='its process was killed; check that there '
                              'is enough memory')
            else:  # items are handed out in this order, one ahead of the processes
                suspects = left[:2 * jobs + 1]
        finally:
            for process in list((pool._processes or {}).values()):  # noqa: SLF001
                process.terminate()
            pool.shutdown(cancel_futures=True)


def _on_cluster(work: Callable[[Any], Any], items: Sequence[Any], scheduler: str
                ) -> Iterator[Outcome]:
    try:
        from distributed import as_completed, Client
    except ImportError as error:
        from forcecal_ros.core.extras import installing

        raise ConfigError('--dask requires the Python package distributed; install it with '
                          f'{installing("scale", "distributed")}') from error
    try:
        # how long a Dask scheduler may take to answer
        client = Client(scheduler, timeout=10.0, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f'no Dask scheduler answers at {scheduler} ({error}); start one with '
                          '`dask scheduler`, and workers with `dask worker`') from error
    with client:
        index_of = {client.submit(attempt, work, index, item, pure=False): index
                    for index, item in enumerate(items)}
        for future in as_completed(list(index_of), loop=client.loop):
            index = index_of.pop(future)
            problem = future.exception()
            yield future.result() if problem is None else Outcome(
                index, error=f'{type(problem).__name__}: {problem}')


class Answer(NamedTuple):
    """
    What a command found in one recording.

    Attributes
    ----------
    document : mapping
        What ``--json`` prints.
    text, headline : str
        The same to read, and in one line of many recordings.
    notes : tuple of str
        For the user.
    status : int
        Exit status.
    """

    document: Mapping[str, Any]
    text: str
    headline: str
    notes: tuple[str, ...] = ()
    status: int = 0


def add_bags(parser: argparse.ArgumentParser) -> None:
    """Add the recordings, what :func:`add_bag` adds, ``--jobs`` and ``--dask``."""
    common.add_bag(parser, several='each is processed separately')
    options = common.group(parser, 'many recordings')
    options.add_argument('--jobs', metavar='N', type=common.at_least_one, default=1,
                         help='recordings processed in parallel')
    options.add_argument('--dask', metavar='ADDRESS', type=common.address,
                         help='scheduler of a Dask cluster, e.g. tcp://host:8786; its workers '
                              'require this package and the same files at the same paths')


def run(args: argparse.Namespace, answer: Callable[[argparse.Namespace], Answer]) -> int:
    """
    Answer for every recording and print each answer as soon as it is there.

    One recording is written to ``--output``. Of many, or if ``--output`` ends with a slash, that
    is a folder which holds the results under the names of the recordings, below what their paths
    have in common.

    Parameters
    ----------
    args : argparse.Namespace
        Of a parser with :func:`add_bags` and ``--output``.
    answer : callable
        Of a module of this package; takes the same arguments with one ``bag``.

    Returns
    -------
    int
        Exit status: the largest of all; 1 for a recording without an answer.
    """
    if args.dask and args.jobs > 1:
        raise UsageError('--jobs sets processes of this machine, and --dask uses a cluster; '
                         'leave --jobs out')
    many = common.is_many(args)
    tasks = _tasks(args, args.bag) if many else [_with(args, bag=args.bag[0])]
    if not (many or args.dask):
        return _show(answer(tasks[0]), args)
    statuses = []
    with common.bar(args, total=len(tasks), unit=' recordings') as done:
        for outcome in each(answer, tasks, jobs=args.jobs, dask=args.dask or ''):
            done.clear()
            task, found = tasks[outcome.index], outcome.value
            if not many:
                if found is None:
                    raise DataError(outcome.error)
                return _show(found, args)
            if found is None:  # what an earlier run found does not stand for this one
                for place in (getattr(task, one.name) for one in task.outputs):
                    if place and os.path.lexists(place):
                        set_aside(Path(place))
            statuses.append(_show_one_of_many(task.bag, found, outcome.error, args.json))
            done.update()
    if not args.json:
        common.say(f'{sum(status != 1 for status in statuses)} of {len(tasks)} recordings have a '
                   f'result, in {args.output}')
    return 1 if 1 in statuses else max(statuses)


def _with(args: argparse.Namespace, **changes: Any) -> argparse.Namespace:
    given = {name: value for name, value in vars(args).items() if name != 'parser'}
    return argparse.Namespace(**{**given, **changes})


def _tasks(args: argparse.Namespace, bags: Sequence[str]) -> list[argparse.Namespace]:
    """Return the arguments for each recording alone, with absolute paths."""
    named = [Path(bag).absolute() for bag in bags]
    paths = [Path(os.path.normpath(path)) for path in named]  # `..` would lead out of DIR
    shared_folder = Path(os.path.commonpath([path.parent for path in paths]))
    shared = {name: str(Path(value).absolute()) for name in args.inputs
              if name != 'bag' and (value := getattr(args, name)) and Path(value).exists()}
    tasks, owner, seen = [], dict[Path, Path](), set[str]()
    for bag, path in zip(named, paths, strict=True):
        inside = path.relative_to(shared_folder)
        name = inside.with_suffix('') if path.suffix in ('.mcap', '.db3') else inside
        if os.path.realpath(bag) in seen:
            raise UsageError(f'{path} is given twice; give each recording once')
        seen.add(os.path.realpath(bag))
        if name in owner:
            raise UsageError(f'{owner[name]} and {path} would both be written to {name}; '
                             'process them with separate commands')
        owner[name] = path
        written = {one.name: str(Path(value).absolute() / f'{name}{one.suffix}')
                   for one in args.outputs if (value := getattr(args, one.name))}
        tasks.append(_with(args, bag=str(bag), quiet=True, **shared, **written))
    for place, one in ((getattr(task, one.name), one) for task in tasks for one in args.outputs):
        if not place:
            continue
        if one.kind != 'results':
            try:
                common.refuse_inputs(place, one.kind, bags)
            except ConfigError as error:
                raise UsageError(f'{one.option}: {error}') from error
        with naming(Path(place)):
            Path(place).parent.mkdir(parents=True, exist_ok=True)
    return tasks


def _show(answer: Answer, args: argparse.Namespace) -> int:
    common.show(args, answer.document, answer.text, () if args.json else answer.notes)
    if answer.status == 1 and (args.json or common.stdout_is_taken(args)):  # no text there
        common.warn(answer.headline)
    return answer.status


def _show_one_of_many(bag: str, answer: Answer | None, error: str, as_json: bool) -> int:
    """Print one line, with ``--json`` one document; return the status."""
    if answer is None:
        common.warn(f'{bag}: {error}')
        if as_json:
            common.say(json.dumps({'recording': bag, 'error': error}))
        return 1
    if as_json:
        common.say(json.dumps({'recording': bag, **answer.document}, allow_nan=False))
    else:
        for note in answer.notes:
            common.warn(f'{bag}: {note}')
        common.say(f'{bag}: {answer.headline}')
    return answer.status
