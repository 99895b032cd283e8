"""Calibrations and diagnoses of a folder by robot, in the order of time, each number charted."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import datetime, timezone
from math import inf, isfinite
import os
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError, ForcecalError
from forcecal_ros.fleet.control import Chart, chart, limit
from forcecal_ros.io.calibration_file import load
from forcecal_ros.report.rows import Row, table


class Entry(NamedTuple):
    """
    One calibration or diagnosis.

    Attributes
    ----------
    robot, path : str
    time : float
        When it was recorded, or made, or its file was written [s since the epoch].
    rows : tuple of Row
    verdict : str
        Of a diagnosis.
    error : str
        Why it could not be read; else empty.
    """

    robot: str
    path: str
    time: float
    rows: tuple[Row, ...] = ()
    verdict: str = ''
    error: str = ''


class Series(NamedTuple):
    """One number of one robot over time; ``entries`` and ``rows`` go together."""

    entries: tuple[Entry, ...]
    rows: tuple[Row, ...]
    chart: Chart

    @property
    def began(self) -> float:
        """When the first change began [s since the epoch]; infinite without a change."""
        changes = self.chart.changes
        return self.entries[changes[0].onset].time if changes else inf


class Robot(NamedTuple):
    """One robot's readable entries in the order of time; its series, the earliest change first."""

    name: str
    entries: tuple[Entry, ...]
    series: tuple[Series, ...]

    @property
    def changed(self) -> tuple[Series, ...]:
        """Those that changed, the earliest first."""
        return tuple(one for one in self.series if one.chart.changes)


def read(place: str) -> Iterator[Entry]:
    """
    Read every calibration and diagnosis of a folder, or one file.

    Hidden folders, links to folders, backups and ``calibration_patched.yaml`` are left out.

    Raises
    ------
    DataError
        The place cannot be searched, or holds neither.
    """
    top = Path(place)
    paths = [*filter(_is_result, [top] if top.is_file() else _walk(top))]
    if not paths:
        raise DataError(f'{place} holds neither calibration.yaml nor diagnosis.json; name another '
                        'folder, or calibrate its recordings first (forcecal calibrate)')
    for path in paths:
        parts = path.relative_to(top).parts
        yield _entry(path, parts[0] if len(parts) > 1 else path.resolve().parent.name)


def _walk(top: Path) -> Iterator[Path]:
    def refuse(error: OSError) -> None:
        raise DataError(f'{error.filename}: cannot be searched ({error.strerror})') from error

    for folder, folders, names in os.walk(top, onerror=refuse):
        folders[:] = sorted(one for one in folders if not one.startswith('.'))
        yield from (Path(folder, name) for name in sorted(names))


def _is_result(path: Path) -> bool:
    """Return whether it is a diagnosis or a calibration; a patch of a diagnosis is neither."""
    if path.suffix not in ('.yaml', '.yml'):
        return path.name == 'diagnosis.json'
    if path.name == 'calibration_patched.yaml' or not path.is_file():
        return False
    with path.open('rb') as file:
        return file.readline().startswith(b'format: forcecal-calibration')


def _entry(path: Path, folder: str) -> Entry:
    from forcecal_ros.diagnose.result import load_diagnosis
    from forcecal_ros.report.comparison import gap_rows

    verdict = ''
    try:
        if path.suffix == '.json':
            diagnosis, document = load_diagnosis(str(path))
            verdict, source, rows = diagnosis.verdict, document.get('source'), gap_rows(diagnosis)
        else:
            calibration = load(str(path))
            source, rows = calibration.source, iter(table(calibration))
    except ForcecalError as error:
        why = str(error).removeprefix(str(path)).removeprefix(':').strip()
        return Entry(folder, str(path), path.stat().st_mtime, error=why)
    source = source if isinstance(source, Mapping) else {}
    return Entry(str(source.get('robot') or folder), str(path), _time(source, path),
                 tuple(row for row in rows if isfinite(row.value)), verdict)


def _time(source: Mapping[str, Any], path: Path) -> float:
    for key in ('recorded', 'created'):
        with suppress(KeyError, ValueError):
            moment = datetime.fromisoformat(str(source[key]))
            return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
    return path.stat().st_mtime


def histories(entries: Iterable[Entry], run_length: float) -> list[Robot]:
    """
    Sort entries by robot, and chart each number; copies of an entry count once.

    Parameters
    ----------
    run_length : float
        Calibrations of a robot between two false alarms on average, over all its numbers.

    Returns
    -------
    list of Robot
        The earliest change first.
    """
    robots: dict[str, dict[tuple[float, bool], Entry]] = defaultdict(dict)
    for entry in sorted(entries, key=lambda one: one.path):
        if not entry.error:
            robots[entry.robot].setdefault((entry.time, entry.verdict != ''), entry)
    found = [_robot(name, [robots[name][key] for key in sorted(robots[name])], run_length)
             for name in sorted(robots)]
    return sorted(found, key=lambda one: min((s.began for s in one.series), default=inf))


def _robot(name: str, entries: list[Entry], run_length: float) -> Robot:
    pairs: dict[tuple[str, str], list[tuple[Entry, Row]]] = defaultdict(list)
    for entry in entries:
        for row in entry.rows:
            pairs[row.key, row.unit].append((entry, row))
    h = limit(run_length * max(1, len(pairs)))
    series = [Series(tuple(entry for entry, _ in mine), tuple(row for _, row in mine), chart(
        [row.value for _, row in mine], [row.std for _, row in mine], h))
        for mine in pairs.values()]
    return Robot(name, tuple(entries), tuple(sorted(series, key=lambda one: one.began)))
