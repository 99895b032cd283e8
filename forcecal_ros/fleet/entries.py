"""One calibration or diagnosis as an entry of a fleet's history: whose, when, which numbers."""

from collections.abc import Mapping
from datetime import datetime, timezone
import json
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.calibration.file import load
from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import DataError
from forcecal_ros.report.rows import table

CALIBRATION, DIAGNOSIS, BAG = 'calibration', 'diagnosis', 'bag'

HALF = 1.96
"""Standard errors from the middle of a 95 % interval to its end."""


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
        Number(*one[:-1], nan if one[-1] is None else one[-1]) for one in document['numbers'])})


def read_calibration(path: str, folder: str) -> Entry:
    """Read a ``calibration.yaml``."""
    return of_calibration(load(path), CALIBRATION, path, folder)


def read_diagnosis(path: str, folder: str) -> Entry:
    """
    Read a ``diagnosis.json``.

    Raises
    ------
    DataError
        It is none.
    """
    document = load_diagnosis(path)
    source = document.get('source', {})
    return Entry(str(source.get('robot') or folder), DIAGNOSIS, path, _time(source, path),
                 said=document['verdict'], numbers=tuple(_gap(document)))


def load_diagnosis(path: str) -> dict[str, Any]:
    """
    Read the document of a diagnosis.

    Raises
    ------
    DataError
        It is none.
    """
    from forcecal_ros.diagnose.result import FORMAT  # loads what diagnoses

    try:
        document = json.loads(Path(path).read_text())
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); name a diagnosis.json of '
                        '`forcecal diagnose`') from error
    except ValueError as error:
        raise DataError(f'{path}: is damaged ({error}); diagnose again') from error
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise DataError(f'{path}: is no diagnosis of this version ({FORMAT}); diagnose again')
    return document


def _gap(document: Mapping[str, Any]) -> list[Number]:
    gap = document.get('gap')
    if not gap:
        return []
    low, high = gap['closed_ci95']
    found = [Number('gap.nominal', 'gap as the model is', 'noise RMS', gap['nominal'], nan),
             Number('gap.recalibrated', 'gap, recalibrated', 'noise RMS', gap['recalibrated'],
                    nan),
             Number('gap.closed', 'share of the gap explained', '1', gap['closed'],
                    (high - low) / (2.0 * HALF))]
    return [one for one in found if isfinite(one.value)]


def _time(source: Mapping[str, Any], path: str) -> float:
    for key in ('recorded', 'created'):
        try:
            moment = datetime.fromisoformat(str(source[key]))
        except (KeyError, ValueError):
            continue
        return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
    return Path(path).stat().st_mtime
