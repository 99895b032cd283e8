"""The page and the table of a fleet."""

from collections.abc import Iterator, Sequence
import csv
from datetime import datetime, timezone
from io import StringIO
from math import floor, isfinite, log10
import shlex
from typing import Any

from forcecal_ros.core.quantity import quantity
from forcecal_ros.fleet.control import LEAST
from forcecal_ros.fleet.entries import BAG, DIAGNOSIS, Entry, Number
from forcecal_ros.fleet.history import Robot, Series
from forcecal_ros.report.page import Fact, render_page
from forcecal_ros.report.rows import HALF

COLUMNS = ('robot', 'time', 'kind', 'path', 'said', 'error', 'key', 'unit', 'value', 'std', 'low',
           'high', 'cusum', 'change')

SHOWN = 8
"""Pictures of a robot at most: what changed, and then what a person asks for first."""

FIRST = ('mass', 'gap.nominal', 'gap.closed')
"""What a person asks for first."""

WIDTH, HEIGHT, STRIP = 640.0, 130.0, 26.0
"""Of a picture, of it the numbers, and of it the sums below them [px]."""


def as_csv(entries: Sequence[Entry], robots: Sequence[Robot]) -> str:
    """Return one row for each number of each entry, and one for each that could not be read."""
    buffer = StringIO()
    out = csv.writer(buffer, lineterminator='\n')
    out.writerow(COLUMNS)
    for entry in entries:
        if entry.error or not entry.numbers:
            out.writerow([*_of(entry), *[''] * 8])
    for robot in robots:
        for series in robot.series:
            changes = {change.noticed: change for change in series.chart.changes}
            for i, (entry, one) in enumerate(zip(series.entries, series.numbers)):
                change = changes.get(i)
                out.writerow([
                    *_of(entry), one.key, one.unit, one.value, *_known(one),
                    f'{series.chart.level[i]:.4f}',
                    f'since {_when(series.entries[change.onset].time)}' if change else ''])
    return buffer.getvalue()


def _of(entry: Entry) -> list[str]:
    return [entry.robot, _when(entry.time), entry.kind, entry.path, entry.said, entry.error]


def _known(one: Number) -> list[object]:
    if not (isfinite(one.std) and one.std > 0.0):
        return ['', '', '']
    return [one.std, one.value - HALF * one.std, one.value + HALF * one.std]


def render(entries: Sequence[Entry], robots: Sequence[Robot], run_length: float) -> str:
    """Return the page: what drifted first, a line for each robot, pictures folded below it."""
    failed = [one for one in entries if one.error]
    changed = [robot for robot in robots if robot.changed]
    return render_page(
        'fleet.html.j2', 'Fleet', tone='doubt' if changed else 'bad' if failed else 'good',
        word=f'{len(changed)} of {len(robots)} robots changed' if changed else (
            f'{len(failed)} not read' if failed else 'steady'),
        headline=headline(robots), facts=list(_facts(robots, run_length, failed)),
        origin=[f'{len(entries) - len(failed)} calibrations and diagnoses of {len(robots)} robots',
                f'{len(failed)} could not be read'] if failed else [
                    f'{len(entries)} calibrations and diagnoses of {len(robots)} robots'],
        head=('robot', 'drifted first', 'last verdict', 'last', 'read'),
        rows=[_line(robot) for robot in sorted(robots, key=lambda one: not one.changed)],
        robots=[_shown(robot) for robot in robots],
        failed=[(one.robot, one.path, one.error) for one in failed],
        width=WIDTH, height=HEIGHT + STRIP, strip=HEIGHT)


def _first(robots: Sequence[Robot]) -> tuple[Robot, Series] | None:
    """Return what drifted first of all."""
    changed = [(robot, robot.changed[0]) for robot in robots if robot.changed]
    return min(changed, key=lambda one: one[1].began, default=None)


def _facts(robots: Sequence[Robot], run_length: float, failed: Sequence[Entry]) -> Iterator[Fact]:
    """Say how sure that is, and what to do next."""
    first = _first(robots)
    yield Fact('How sure', (f'By chance a robot leaves its limits once in {run_length:g} '
                            'calibrations, all its numbers counted.'))
    if first is not None:
        _, series = first
        change = series.chart.changes[0]
        pair = [series.entries[i] for i in (change.onset - 1, change.noticed)]
        if any(entry.kind == BAG for entry in pair):
            yield Fact('Next', f'Ask what was done to it at {_day(series.began)}.')
        else:
            yield Fact('Next', 'See what else changed with it:', shlex.join(
                ('forcecal', 'compare', *(entry.path for entry in pair))))
    elif failed:
        yield Fact('Next', 'Mend or take away what could not be read; it is listed below.')


def headline(robots: Sequence[Robot]) -> str:
    """Say in a sentence or two what drifted first."""
    first = _first(robots)
    if first is None:
        return 'No number of any robot left its control limits.'
    robot, series = first
    more = sum(1 for one in robots if one.changed) - 1
    rest = f' {more} other robot{"s" * (more > 1)} changed later.' if more else ''
    return f'First to drift: {in_words(robot, series)}.{rest}'


def in_words(robot: Robot, series: Series) -> str:
    """Say of a series what changed first, when, and by how much."""
    change = series.chart.changes[0]
    began, noticed = (_day(series.entries[i].time) for i in (change.onset, change.noticed))
    by = quantity(change.after - change.before, change.std, series.numbers[0].unit, signed=True)
    return (f'{series.numbers[0].name} of {robot.name}, by {by}, since {began} (noticed '
            f'{noticed})')


def to_document(entries: Sequence[Entry], robots: Sequence[Robot]) -> dict[str, Any]:
    """Return what changed as JSON can hold it."""
    return {
        'format': 'forcecal-fleet/1', 'headline': headline(robots),
        'robots': {robot.name: {
            'entries': len(robot.entries),
            'changed': [{'key': one.key, 'unit': one.numbers[0].unit,
                         'since': _when(one.entries[change.onset].time),
                         'noticed': _when(one.entries[change.noticed].time),
                         'before': change.before, 'after': change.after, 'std': change.std}
                        for one in robot.changed for change in one.chart.changes]}
            for robot in robots},
        'unreadable': [{'path': one.path, 'error': one.error} for one in entries if one.error]}


def _line(robot: Robot) -> list[str]:
    said = [entry.said for entry in robot.entries if entry.kind == DIAGNOSIS]
    first = robot.changed[0] if robot.changed else None
    return [robot.name,
            'nothing' if first is None else in_words(robot, first).replace(
                f' of {robot.name}', '', 1),
            said[-1].replace('_', ' ') if said else '-', _day(robot.entries[-1].time),
            str(len(robot.entries))]


def _shown(robot: Robot) -> dict[str, Any]:
    wanted = [one for one in robot.series if not one.chart.changes and one.key in FIRST]
    series = [*robot.changed[:SHOWN], *wanted][:SHOWN]
    return {'name': robot.name, 'open': bool(robot.changed),
            'pictures': [_picture(one) for one in series if len(one.numbers) > 1],
            'more': len(robot.changed) - SHOWN}


def _picture(series: Series) -> dict[str, Any]:
    """Return a series as the paths of a drawing: intervals, numbers, means and sums."""
    times = [entry.time for entry in series.entries]
    spans = [HALF * one.std if isfinite(one.std) else 0.0 for one in series.numbers]
    values = [one.value for one in series.numbers]
    low = min(v - s for v, s in zip(values, spans))
    high = max(v + s for v, s in zip(values, spans))
    length, room = times[-1] - times[0] or 1.0, 1.1 * (high - low) or 1.0
    middle = 0.5 * (low + high)
    x = [(t - times[0]) / length * (WIDTH - 12.0) + 6.0 for t in times]

    def y(value: float) -> float:
        return HEIGHT * (0.5 - (value - middle) / room)

    unit = series.numbers[0].unit
    return {
        'title': series.numbers[0].name, 'from': _day(times[0]), 'to': _day(times[-1]),
        'range': _range(low, high, unit),
        'said': '; '.join(_changes(series)) or (
            'within its limits' if len(values) >= LEAST else 'too few to say'),
        'intervals': _path(f'M{a:.1f} {y(v - s):.1f}V{y(v + s):.1f}'
                           for a, v, s in zip(x, values, spans) if s),
        'dots': _path(f'M{a:.1f} {y(v):.1f}h0' for a, v in zip(x, values)),
        'odd': _path(f'M{x[i]:.1f} {y(values[i]):.1f}h0' for i in series.chart.odd),
        'changes': _path(f'M{x[c.onset]:.1f} 0V{HEIGHT:.0f}' for c in series.chart.changes),
        'sums': _path(f'{"L" if i else "M"}{a:.1f} {HEIGHT + STRIP - 2 - min(level, 1.2) * 18:.1f}'
                      for i, (a, level) in enumerate(zip(x, series.chart.level))),
        'limit': HEIGHT + STRIP - 20.0}


def _range(low: float, high: float, unit: str) -> str:
    """Say what the bottom and the top of a picture are, to the digits that tell them apart."""
    if unit == '1':
        low, high, unit = 100.0 * low, 100.0 * high, '%'
    decimals = max(0, 1 - floor(log10(high - low))) if high > low else 3
    return f'bottom {low:.{decimals}f}, top {high:.{decimals}f} {unit}'


def _changes(series: Series) -> Iterator[str]:
    for change in series.chart.changes:
        by = quantity(change.after - change.before, change.std, series.numbers[0].unit,
                      signed=True)
        yield f'{by} since {_day(series.entries[change.onset].time)}'


def _path(parts: Iterator[str]) -> str:
    return ''.join(parts)


def _day(time: float) -> str:
    return datetime.fromtimestamp(time, timezone.utc).strftime('%Y-%m-%d %H:%M')


def _when(time: float) -> str:
    return datetime.fromtimestamp(time, timezone.utc).isoformat(timespec='seconds')
