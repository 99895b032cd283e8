"""Columns of a table that say when its rows were measured, exact to the nanosecond."""

from collections.abc import Callable, Sequence
from datetime import datetime, timedelta, timezone
from decimal import Decimal, InvalidOperation
from operator import lt

from forcecal_ros.core.errors import DataError
from forcecal_ros.io.csv_import.table import DATE_AND_TIME, Table
from forcecal_ros.io.csv_import.units import DATE, NANOSECONDS
import numpy as np
from numpy.typing import NDArray

_FARTHEST = 1 << 62
"""Times beyond are out of range of 64 bits once they are shifted [ns]."""

_SECOND, _HOUR, _DAY = 10**9, 3600 * 10**9, 86400 * 10**9

_MANY = 50
"""Of so many stamps, several in each second, some are in the last part of theirs."""

Times = NDArray[np.int64]


def nanoseconds(table: Table, name: str, unit: str, further: str | None = None) -> Times:
    """
    Return a column of times, shape (n,).

    Parameters
    ----------
    unit : str
        Of the column; a date without a zone is taken for UTC.
    further : str, optional
        Column of nanoseconds that come on top.

    Raises
    ------
    DataError
        A cell is no number, out of range, or not after the one before; the line is named.
    """
    stamps = _times(table, name, _date if unit == DATE else _exactly_in(NANOSECONDS[unit]))
    if further is not None:
        if (stamps % _SECOND).any():
            raise DataError(f'{table.path}: column {name!r} is not in whole seconds, on top of '
                            f'which {further!r} could come; name one of them')
        more = _times(table, further, _exactly_in(1))
        _require_nanoseconds(table, further, more, len(np.unique(stamps)))
        stamps = stamps + more
    if (np.diff(stamps) <= 0).any():
        raise DataError(f'{table.path} {_disorder(table, stamps, name)}')
    return stamps


def _times(table: Table, name: str, exact: Callable[[str], int]) -> Times:
    try:
        times = [exact(cell) for cell in table.cells(name)]
    except (ValueError, InvalidOperation):
        raise table.not_a_number(name, exact) from None
    if max(times) >= _FARTHEST or min(times) <= -_FARTHEST:
        raise DataError(f'{table.path}: times in column {name!r} are out of range; is the unit '
                        'right?')
    return np.array(times, dtype=np.int64)


def _require_nanoseconds(table: Table, name: str, more: Times, seconds: int) -> None:
    """Refuse what is no part of a second, and parts of one that are in a larger unit."""
    if more.min() < 0 or more.max() >= _SECOND:
        raise DataError(f'{table.path}: column {name!r} holds {more.min()} to {more.max()}, '
                        'not nanoseconds within a second')
    if len(more) < max(_MANY, 3 * seconds):
        return
    for unit, factor in (('milliseconds', 10**6), ('microseconds', 10**3)):
        if more.max() * factor < _SECOND:
            raise DataError(f'{table.path}: column {name!r} never exceeds {more.max()}: these '
                            f'are {unit}; multiply them by {factor}')


def _disorder(table: Table, stamps: Times, name: str) -> str:
    """Say where times do not grow, and why if that is plain."""
    steps = np.diff(stamps)
    row = int(np.argmax(steps <= 0)) + 1
    cells = table.cells(name)
    where = (f'line {table.line(row)}: time {cells[row]} in column {name!r} is not after '
             f'{cells[row - 1]} in the row before')
    if steps[row - 1] < _HOUR - _DAY:
        return f'{where}: a time of day that passed midnight; add a day from there on'
    if _lacks_zeros(cells):
        return (f'{where}: behind the point stand nanoseconds without their leading zeros; write '
                'nine digits, or both numbers into columns of their own')
    if steps.min() < 0:
        return (f'{where}; sort the table, or import each part by itself where a clock was set '
                'back or a second log begins')
    return (f'{where}, as in {int((steps == 0).sum())} rows: they are nearer to one another than '
            'their times tell; where they are evenly apart, state rate instead of time; where the '
            'table merges streams, list it once for each, with its own signals and stamps')


def _lacks_zeros(cells: Sequence[str]) -> bool:
    """Whether times grow if what stands behind the point counts nanoseconds."""
    parts = [cell.strip().partition('.') for cell in cells]
    if not all(whole.isdigit() and more.isdigit() for whole, _, more in parts):
        return False
    times = [(int(whole), int(more)) for whole, _, more in parts]
    return len({len(more) for *_, more in parts}) > 1 and all(map(lt, times, times[1:]))


_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


def _date(cell: str) -> int:
    """Convert a date to nanoseconds since 1970; of no other form than year first."""
    found = DATE_AND_TIME.fullmatch(cell.strip())
    if found is None:
        raise ValueError(cell)
    *numbers, fraction, zone = found.groups()
    at = datetime(*map(int, numbers), tzinfo=timezone.utc)  # type: ignore[misc, arg-type]
    if zone and zone != 'Z':
        hours, minutes = int(zone[1:3]), int(zone[-2:])
        at -= (1 if zone[0] == '+' else -1) * timedelta(hours=hours, minutes=minutes)
    return (at - _EPOCH) // timedelta(seconds=1) * _SECOND + int((fraction or '').ljust(9, '0'))


def _exactly_in(unit: int) -> Callable[[str], int]:
    return lambda cell: _exact(cell, unit)


def _exact(cell: str, unit: int) -> int:
    """Convert a time without passing through binary fractions."""
    try:
        return int(cell) * unit
    except ValueError:
        number = Decimal(cell.strip())
    if not number.is_finite():
        raise ValueError(cell)
    return _FARTHEST if number.adjusted() > 18 else int((number * unit).to_integral_value())
