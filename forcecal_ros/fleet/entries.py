"""Entries of a fleet's history: one calibration or diagnosis each, found in a folder of many."""

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime, timezone
from math import isfinite, nan
import os
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import DataError
from forcecal_ros.io.calibration_file import load
from forcecal_ros.report.rows import table

CALIBRATION, DIAGNOSIS, BAG = 'calibration', 'diagnosis', 'bag'


class Number(NamedTuple):
    """One number of an entry; ``std`` is NaN where it is not known."""

    key: str
    name: str
    unit: str
    value: float
    std: float


class Entry(NamedTuple):
    """
    What one file or recording says.

    Attributes
    ----------
    robot, kind, path : str
    time : float
        When it was recorded, or made, or its file was written [s since the epoch].
    said : str
        The verdict of a diagnosis.
    error : str
        Why there is nothing; empty: there is.
    numbers : tuple of Number
    """

    robot: str
    kind: str
    path: str
    time: float
    said: str = ''
    error: str = ''
    numbers: tuple[Number, ...] = ()


def of_calibration(c: Calibration, kind: str, path: str, folder: str) -> Entry:
    """
    Return what a calibration says.

    Parameters
    ----------
    kind : str
        ``calibration``, or ``bag`` where it was made of one here.
    folder : str
        Name of the robot where ``source.robot`` gives none.
    """
    numbers = tuple(Number(row.key, row.name, row.unit, row.value, row.std) for row in table(c)
                    if isfinite(row.value))
    return Entry(str(c.source.get('robot') or folder), kind, path, _time(c.source, path),
                 numbers=numbers)


def plain(entry: Entry) -> dict[str, Any]:
    """Return an entry as JSON can hold it."""
    return {**entry._asdict(), 'numbers': [
        [*one[:-1], one.std if isfinite(one.std) else None] for one in entry.numbers]}


def again(document: Mapping[str, Any]) -> Entry:
    """Return the entry that :func:`plain` made a document of."""
    return Entry(**{**document, 'numbers': tuple(
        Number(key, name, unit, value, nan if std is None else std)
        for key, name, unit, value, std in document['numbers'])})


def read_calibration(path: str, folder: str) -> Entry:
    """Read a ``calibration.yaml``."""
    return of_calibration(load(path), CALIBRATION, path, folder)


def read_diagnosis(path: str, folder: str) -> Entry:
    """
    Read a ``diagnosis.json``.

    Raises
    ------
    DataError
        It is none, or damaged.
    """
    from forcecal_ros.diagnose.result import load_diagnosis
    from forcecal_ros.report.comparison import gap_rows

    diagnosis, document = load_diagnosis(path)
    given = document.get('source')
    source = given if isinstance(given, dict) else {}
    return Entry(str(source.get('robot') or folder), DIAGNOSIS, path, _time(source, path),
                 said=diagnosis.verdict, numbers=tuple(
                     Number(row.key, row.name, row.unit, row.value, row.std)
                     for row in gap_rows(diagnosis) if isfinite(row.value)))


def _time(source: Mapping[str, Any], path: str) -> float:
    for key in ('recorded', 'created'):
        try:
            moment = datetime.fromisoformat(str(source[key]))
        except (KeyError, ValueError):
            continue
        return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
    return Path(path).stat().st_mtime


BEGINS = b'format: forcecal-calibration'
"""How every calibration.yaml begins."""

BAGS = ('.mcap', '.db3')

DERIVED = 'calibration_patched.yaml'
"""Written by a diagnosis, and no calibration of its own."""


class FleetFile(NamedTuple):
    """
    A file or recording.

    Attributes
    ----------
    kind, path : str
    folder : str
        First folder on the way from what was named, or that itself: the robot's name where
        nothing else says it.
    mark : str
        Names, sizes and times of its files: another one means that it has to be read again.
    """

    kind: str
    path: str
    folder: str
    mark: str


def find(places: Iterable[str], without: str, bags: bool) -> list[FleetFile]:
    """
    Find all calibrations, diagnoses and recordings.

    Parameters
    ----------
    places : iterable of str
        Folders, which are searched, or files and recordings.
    without : str
        Folder that is left out.
    bags : bool
        Whether recordings are wanted.

    Raises
    ------
    DataError
        A place is not there, or holds nothing of this kind.
    """
    found: dict[str, FleetFile] = {}
    for place in places:
        path = Path(os.path.realpath(place))
        if not path.exists():
            raise DataError(f'{place}: is not there; name a folder or file')
        here = [one for one in _in(path, Path(os.path.realpath(without)), path)
                if bags or one.kind != BAG]
        if not here:
            raise DataError(f'{place}: holds neither calibration.yaml nor diagnosis.json'
                            f'{" nor a recording" * bags}; name another folder')
        found.update({one.path: one for one in here})
    return sorted(found.values(), key=lambda one: one.path)


def _in(path: Path, without: Path, top: Path) -> Iterator[FleetFile]:
    if path == without or (path.name.startswith('.') and path != top) or path.name.endswith('~'):
        return
    if path.is_file():
        kind = _kind(path)
        if kind:
            yield _found(kind, path, top, [path])
        return
    try:
        inside = sorted(path.iterdir())
    except OSError as error:
        raise DataError(f'{path}: cannot be searched ({error.strerror})') from error
    parts = [one for one in inside if not {*BAGS}.isdisjoint(one.suffixes) and one.is_file()]
    if (path / 'metadata.yaml').exists():
        yield _found(BAG, path, top, [path / 'metadata.yaml', *parts])
        inside = [one for one in inside if one not in parts]
    for one in inside:
        if not one.is_symlink() or one.is_file():
            yield from _in(one, without, top)


def _kind(path: Path) -> str:
    if path.suffix in BAGS:
        return BAG
    if path.name == 'diagnosis.json':
        return DIAGNOSIS
    if path.suffix not in ('.yaml', '.yml') or path.name == DERIVED:
        return ''
    try:
        with path.open('rb') as file:
            return CALIBRATION if file.read(len(BEGINS)) == BEGINS else ''
    except OSError:
        return ''


def _found(kind: str, path: Path, top: Path, files: Iterable[Path]) -> FleetFile:
    below = path.relative_to(top).parts
    folder = top.name if top.is_dir() and top != path else path.parent.name
    marks = []
    for file in files:
        state = file.stat()
        marks.append(f'{file.name} {state.st_size} {state.st_mtime_ns}')
    return FleetFile(kind, str(path), below[0] if len(below) > 1 else folder, '; '.join(marks))
