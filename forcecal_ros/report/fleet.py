"""Calibrations and diagnoses of a folder by robot, in the order of time, each number charted."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
import csv
from datetime import datetime, timezone
from io import StringIO
from math import inf, isfinite
import os
from pathlib import Path
import shlex
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError, ForcecalError
from forcecal_ros.core.quantity import HALF, quantity
from forcecal_ros.io.calibration_file import load
from forcecal_ros.report.control_chart import Chart, chart, limit
from forcecal_ros.report.page import docs_link, render_page
from forcecal_ros.report.rows import number, Row, table

COLUMNS = ('robot', 'time', 'path', 'verdict', 'error', 'key', 'unit', 'value', 'std', 'cusum',
           'change')

MAX_PICTURES = 8
"""Pictures of a robot: what changed, then :data:`USUAL`."""

USUAL = ('mass', 'gap.nominal', 'gap.closed')
"""Numbers that are drawn although they did not change."""


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


def as_csv(entries: Sequence[Entry], robots: Sequence[Robot]) -> str:
    """Return one row for each number of each entry, and one for each that could not be read."""
    buffer = StringIO()
    out = csv.writer(buffer, lineterminator='\n')
    out.writerow(COLUMNS)
    for entry in entries:
        if not entry.rows:
            out.writerow([*_origin(entry), *[''] * 6])
    for series in (one for robot in robots for one in robot.series):
        began = {one.noticed: series.entries[one.onset].time for one in series.chart.changes}
        for i, (entry, row) in enumerate(zip(series.entries, series.rows)):
            out.writerow([
                *_origin(entry), row.key, row.unit, row.value, row.std if row.std > 0.0 else '',
                f'{series.chart.level[i]:.4f}', f'since {_when(began[i])}' if i in began else ''])
    return buffer.getvalue()


def _origin(entry: Entry) -> list[str]:
    return [entry.robot, _when(entry.time), entry.path, entry.verdict, entry.error]


def to_document(entries: Sequence[Entry], robots: Sequence[Robot]) -> dict[str, Any]:
    """Return what changed as JSON can hold it."""
    return {
        'format': 'forcecal-fleet/1', 'headline': headline(robots),
        'robots': {robot.name: {
            'entries': len(robot.entries),
            'changed': [{'key': one.rows[0].key, 'unit': one.rows[0].unit,
                         'since': _when(one.entries[change.onset].time),
                         'noticed': _when(one.entries[change.noticed].time),
                         'before': change.before, 'after': change.after, 'std': change.std}
                        for one in robot.changed for change in one.chart.changes]}
            for robot in robots},
        'unreadable': [{'path': one.path, 'error': one.error} for one in entries if one.error]}


def headline(robots: Sequence[Robot]) -> str:
    """Return in a sentence what drifted first, of :func:`histories`."""
    if not any(one.changed for one in robots):
        return 'No number of any robot left its control limits.'
    first = robots[0].changed[0]
    return f'First to drift on {robots[0].name}: {first.rows[0].name}, by {_steps(first)[0]}.'


def _steps(series: Series) -> list[str]:
    """Describe each change of a series: by how much, since when."""
    return [quantity(one.after - one.before, one.std, series.rows[0].unit, signed=True)
            + f', since {_minute(series.entries[one.onset].time)} (noticed '
              f'{_minute(series.entries[one.noticed].time)})' for one in series.chart.changes]


def render(entries: Sequence[Entry], robots: Sequence[Robot], run_length: float) -> str:
    """Return the page: what drifted first, a line for each robot, pictures folded below it."""
    failed = [(one.robot, one.path, one.error) for one in entries if one.error]
    changed = [one for one in robots if one.changed]
    compare = ''
    if changed:
        series, change = changed[0].changed[0], changed[0].changed[0].chart.changes[0]
        compare = shlex.join(('forcecal', 'compare', series.entries[change.onset - 1].path,
                              series.entries[change.noticed].path))
    return render_page(
        'fleet.html.j2', 'Fleet', tone='warn' if changed else 'bad' if failed else 'good',
        word=f'{len(changed)} of {len(robots)} robots changed', headline=headline(robots),
        pages=[docs_link('how-to/fleet', 'fleet')], compare=compare, failed=failed,
        origin=[f'{len(entries) - len(failed)} results of {len(robots)} robots'],
        head=('robot', 'drifted first', 'last verdict', 'last', 'read'),
        rows=[_line(robot) for robot in robots], run_length=run_length,
        robots=[(robot, list(_pictures(robot))) for robot in robots], shown=MAX_PICTURES)


def _line(robot: Robot) -> list[str]:
    verdicts = [entry.verdict for entry in robot.entries if entry.verdict] or ['-']
    drift = [f'{one.rows[0].name}, by {_steps(one)[0]}' for one in robot.changed] or ['nothing']
    return [robot.name, drift[0], verdicts[-1].replace('_', ' '),
            _minute(robot.entries[-1].time), str(len(robot.entries))]


def _pictures(robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield series as drawings: of each point time, value, half an interval and the sum."""
    usual = [one for one in robot.series if not one.chart.changes and one.rows[0].key in USUAL]
    for series in [one for one in [*robot.changed, *usual] if one.rows[1:]][:MAX_PICTURES]:
        times, rows, found = [one.time for one in series.entries], series.rows, series.chart
        spans = [HALF * row.std if row.std > 0.0 else 0.0 for row in rows]
        low = min(row.value - span for row, span in zip(rows, spans))
        high = max(row.value + span for row, span in zip(rows, spans))
        length, height = times[-1] - times[0] or 1.0, high - low or 1.0
        yield {
            'name': rows[0].name, 'from': _minute(times[0]), 'to': _minute(times[-1]),
            'range': ' to '.join(number(end, height / 20.0) for end in (low, high)),
            'unit': '' if rows[0].unit == '1' else f' {rows[0].unit}',
            'state': '; '.join(_steps(series)) or 'within its limits',
            'points': [((t - times[0]) / length, (row.value - low) / height, s / height, level)
                       for t, row, s, level in zip(times, rows, spans, found.level)],
            'odd': found.odd, 'onsets': [one.onset for one in found.changes]}


def _minute(time: float) -> str:
    return datetime.fromtimestamp(time, timezone.utc).strftime('%Y-%m-%d %H:%M')


def _when(time: float) -> str:
    return datetime.fromtimestamp(time, timezone.utc).isoformat(timespec='seconds')
