"""One calibration or diagnosis as an entry of a fleet's history: whose, when, which numbers."""

from collections.abc import Mapping
from datetime import datetime, timezone
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.calibration.file import load
from forcecal_ros.calibration.model import Calibration
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
    from forcecal_ros.diagnose.say.result import load as load_diagnosis  # with all that diagnoses
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
