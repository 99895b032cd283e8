"""Entries in the order of time, by robot: which numbers changed, when, and which first."""

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

from forcecal_ros.fleet.control import Change, Chart, chart, limit
from forcecal_ros.fleet.entries import DIAGNOSIS, Entry, Number


class Series(NamedTuple):
    """One number of one robot over time; ``entries`` and ``numbers`` go together."""

    key: str
    entries: tuple[Entry, ...]
    numbers: tuple[Number, ...]
    chart: Chart

    @property
    def last(self) -> Change | None:
        """The last change, if there was one."""
        return self.chart.changes[-1] if self.chart.changes else None

    @property
    def began(self) -> float:
        """When the first change began [s since the epoch]."""
        return self.entries[self.chart.changes[0].onset].time


class Robot(NamedTuple):
    """
    One robot's history.

    Attributes
    ----------
    name : str
    entries : tuple of Entry
        What could be read, in the order of time.
    series : tuple of Series
        The earliest change first, then what did not change.
    """

    name: str
    entries: tuple[Entry, ...]
    series: tuple[Series, ...]

    @property
    def changed(self) -> tuple[Series, ...]:
        """Those that changed, the earliest first."""
        return tuple(one for one in self.series if one.chart.changes)


def histories(entries: Iterable[Entry], run_length: float) -> list[Robot]:
    """
    Sort entries by robot, and follow each number.

    Parameters
    ----------
    run_length : float
        Calibrations of a robot between two false alarms on average, over all its numbers.
    """
    by_robot: dict[str, list[Entry]] = defaultdict(list)
    for entry in entries:
        if not entry.error:
            by_robot[entry.robot].append(entry)
    return [_robot(name, sorted(mine, key=lambda one: (one.time, one.path)), run_length)
            for name, mine in sorted(by_robot.items())]


def once(entries: Iterable[Entry]) -> list[Entry]:
    """Leave out a calibration of a recording that another entry is of, by robot and time."""
    seen: set[tuple[str, bool, float]] = set()
    kept = []
    for entry in sorted(entries, key=lambda one: (bool(one.error), one.kind == 'bag', one.path)):
        what = entry.robot, entry.kind == DIAGNOSIS, entry.time
        if entry.error or what not in seen:
            kept.append(entry)
            seen.add(what)
    return kept


def _robot(name: str, entries: list[Entry], run_length: float) -> Robot:
    rows: dict[str, list[tuple[Entry, Number]]] = defaultdict(list)
    for entry in entries:
        for number in entry.numbers:
            rows[f'{number.key} [{number.unit}]'].append((entry, number))
    h = limit(run_length * max(1, len(rows)))
    series = []
    for pairs in rows.values():
        numbers = tuple(number for _, number in pairs)
        series.append(Series(numbers[0].key, tuple(entry for entry, _ in pairs), numbers, chart(
            [one.value for one in numbers], [one.std for one in numbers], h)))
    return Robot(name, tuple(entries), tuple(sorted(series, key=lambda one: (
        one.began if one.chart.changes else float('inf')))))
