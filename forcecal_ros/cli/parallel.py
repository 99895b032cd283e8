"""The same work over many items: one after the other, on several cores, or on a Dask cluster.

The answers are the same wherever they are found, and each comes as soon as it is there. A worker
that is killed half-way costs nothing but time: what it had in hand is done again elsewhere.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from threading import Lock
from traceback import extract_tb
from typing import Generic, TypeVar

from forcecal_ros.core.errors import ConfigError, ForcecalError
from forcecal_ros.core.extras import installing

T = TypeVar('T')
R = TypeVar('R')

CONNECT = 10.0
"""How long a Dask scheduler may take to answer [s]."""

DEATHS = 2
"""Workers that an item may kill, alone on the machine, before it is given up."""

UNORDERED = [1, 4]
"""The first joblib that hands out results as they come."""

_TURN = Lock()


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """
    What became of one item.

    Attributes
    ----------
    index : int
        Of the item.
    value : object or None
        What the work returned.
    error : str
        Why it returned nothing, in one line; empty where all went well.
    """

    index: int
    value: R | None = None
    error: str = ''


def each(work: Callable[[T], R], items: Sequence[T], *, jobs: int = 1, dask: str = ''
         ) -> Iterator[Outcome[R]]:
    """
    Do the same to every item and yield what becomes of each, in the order they are done.

    An item that fails does not keep the others from being done.

    Parameters
    ----------
    work : callable
        A function of an importable module (or a ``functools.partial`` of one): workers find it by
        its name. It takes an item; items and results travel between processes, so they are better
        names of files than their contents.
    jobs : int
        Processes on this machine; 1: none besides this one.
    dask : str
        Address of the scheduler of a Dask cluster that works instead, as ``tcp://host:8786``. Its
        workers need this package and the same files under the same names.

    Raises
    ------
    ConfigError
        No such number of processes, no such cluster, or the extra ``scale`` is not installed.
    """
    if jobs < 1:
        raise ConfigError(f'{jobs} jobs cannot do anything; give 1 or more')
    if dask:
        yield from _on_cluster(work, items, dask)
    elif jobs > 1 and len(items) > 1:
        yield from _on_cores(work, items, jobs)
    else:
        for index, item in enumerate(items):
            yield attempt(work, index, item)


def attempt(work: Callable[[T], R], index: int, item: T) -> Outcome[R]:
    """
    Do one item; threads of one process take turns, as not all that is used here is thread-safe.

    Parameters
    ----------
    work : callable
    """
    try:
        with _TURN:
            return Outcome(index, work(item))
    except ForcecalError as error:
        return Outcome(index, error=str(error))
    except Exception as error:  # noqa: BLE001 - of one recording, and the others go on
        at = extract_tb(error.__traceback__)[-1]
        return Outcome(
            index, error=f'{type(error).__name__}: {error} ({at.filename}:{at.lineno})')


def _missing(option: str, error: ImportError) -> ConfigError:
    module = str(error.name).partition('.')[0]
    return ConfigError(f'{option} wants the Python package {module}; install it by '
                       f'{installing("scale", module)}')


def _on_cores(work: Callable[[T], R], items: Sequence[T], jobs: int) -> Iterator[Outcome[R]]:
    """Work in processes; after a death, what may have caused it is done alone."""
    try:
        from joblib import __version__
        from joblib.externals.loky.process_executor import TerminatedWorkerError
    except ImportError as error:
        raise _missing('--jobs', error) from error
    if [int(number) for number in __version__.split('.')[:2]] < UNORDERED:
        raise ConfigError(f'--jobs wants joblib {".".join(map(str, UNORDERED))}, this is '
                          f'{__version__}; install it by {installing("scale", "joblib")}')
    left = list(range(len(items)))
    suspects: list[int] = []
    deaths = 0
    while left:
        try:
            for outcome in _in_processes(work, items, suspects[:1] or left, jobs):
                left.remove(outcome.index)
                yield outcome
            suspects, deaths = suspects[1:], 0
        except TerminatedWorkerError:
            deaths += 1
            if not suspects:
                # they were handed out in this order
                suspects, deaths = left[:jobs], 0
            elif deaths == DEATHS:
                index = suspects.pop(0)
                left.remove(index)
                deaths = 0
                yield Outcome(index, error=f'{DEATHS} processes that worked on it alone were '
                              'killed; is there memory enough?')


def _in_processes(work: Callable[[T], R], items: Sequence[T], indices: Sequence[int], jobs: int
                  ) -> Iterator[Outcome[R]]:
    from joblib import delayed, Parallel, parallel_config

    # one thread each: more would only wait for each other, and round in another order
    with parallel_config('loky', inner_max_num_threads=1):
        parallel = Parallel(jobs, return_as='generator_unordered', batch_size=1, max_nbytes=None)
    yield from parallel(delayed(attempt)(work, index, items[index]) for index in tuple(indices))


def _on_cluster(work: Callable[[T], R], items: Sequence[T], address: str
                ) -> Iterator[Outcome[R]]:
    try:
        from distributed import as_completed, Client
    except ImportError as error:
        raise _missing('--dask', error) from error
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f'no Dask scheduler answers at {address} ({error}); start one with '
                          '`dask scheduler`, and workers with `dask worker`') from error
    with client:
        index_of = {client.submit(attempt, work, index, item, pure=False): index
                    for index, item in enumerate(items)}
        for future in as_completed(list(index_of), loop=client.loop):
            index = index_of.pop(future)
            problem = future.exception()
            if problem is None:
                yield future.result()
            else:
                yield Outcome(index, error=f'{type(problem).__name__}: {problem}')
