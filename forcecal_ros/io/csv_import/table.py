"""One CSV file: named columns of cells in stated units, and numbers and exact times of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
import csv
from datetime import datetime, timedelta, timezone
from decimal import Decimal, InvalidOperation
from itertools import compress, islice, pairwise
from math import pi
from operator import lt
from os import SEEK_END
from pathlib import Path
import re
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
import numpy as np
from numpy.typing import NDArray

UNITS: Mapping[str, Mapping[str, float]] = {
    'force': {'N': 1.0, 'mN': 1e-3, 'kN': 1e3, 'kgf': STANDARD_GRAVITY, 'lbf': 4.4482216152605},
    'torque': {'N m': 1.0, 'Nm': 1.0, 'mN m': 1e-3, 'N mm': 1e-3, 'kN m': 1e3,
               'lbf in': 0.1129848290276167},
    'acceleration': {'m/s^2': 1.0, 'mm/s^2': 1e-3, 'g': STANDARD_GRAVITY,
                     'mg': 1e-3 * STANDARD_GRAVITY},
    'voltage': {'V': 1.0, 'mV': 1e-3},
    'angular velocity': {'rad/s': 1.0, 'deg/s': pi / 180},
    'length': {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'um': 1e-6},
    'angle': {'rad': 1.0, 'deg': pi / 180},
    'number': {'1': 1.0},
}
"""Quantity -> unit -> its size in SI."""

NANOSECONDS: Mapping[str, int] = {'s': 10**9, 'ms': 10**6, 'us': 10**3, 'ns': 1}
"""Nanoseconds in a unit of time."""

DATE = 'date'
"""In place of a unit of time: year, month, day, hour, minute and second, as ISO 8601 has them."""


_IN_BRACKETS = re.compile(r'[\[(]([^\])]*)[\])]\s*$')
_SUFFIX = re.compile(r'_([A-Za-z]{2,})$')
"""One letter is no unit: ``accel_g`` may as well be gravity."""
_LETTER = re.compile(r'([wxyz])\s*$', re.IGNORECASE)


def named_unit(column: str, units: Mapping[str, float]) -> str | None:
    """Return which of the units a name ends with, as ``x [mm]``, ``x (mm)`` or ``x_mm``."""
    found = _IN_BRACKETS.search(column) or _SUFFIX.search(column)
    word = found.group(1).replace(' ', '') if found else ''
    return next((unit for unit in units if unit.replace(' ', '') == word), None)


def contradiction(columns: Sequence[str], unit: str, units: Mapping[str, float]) -> str:
    """Return which column names another unit, as words; empty where none does."""
    for column in columns:
        said = named_unit(column, units)
        if said is not None and units[said] != units[unit]:
            return f'{said}, as the name of column {column!r} says'
    return ''


def is_xyzw(columns: Sequence[str]) -> bool:
    """Whether names that end with the letters w, x, y and z have them in the order xyzw."""
    found = [_LETTER.search(column) for column in columns]
    letters = ''.join(one.group(1).lower() for one in found if one)
    return sorted(letters) != list('wxyz') or letters == 'xyzw'


_DECIMAL_COMMA = re.compile(r'\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*')
_DATE = re.compile(r'\s*\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}')
DATE_AND_TIME = re.compile(
    r'(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[ T_/-](\d{1,2}):(\d{2}):(\d{2})'
    r'(?:[.,](\d{1,9}))?\s*(Z|[+-]\d{2}:?\d{2})?')
"""As ISO 8601 and its neighbours write them; year first, because others are ambiguous."""

_BLANKS = re.compile(' +')


Column = str | int
"""Name of a column, or its number from 0 in tables without names."""


class Dialect(NamedTuple):
    """
    How a table is written.

    Attributes
    ----------
    delimiter : str
        Between cells.
    decimal : str
        Between a number's whole part and its fraction.
    comment : str
        Lines that begin with it are left out; empty: none.
    header : int
        Line of the file that names the columns; 0: none does, and their names are 0, 1, 2 ...
    skip : int
        Lines between that one and the numbers, as one of units.
    """

    delimiter: str = ','
    decimal: str = '.'
    comment: str = ''
    header: int = 1
    skip: int = 0


def rows_of(file: Iterable[str], dialect: Dialect) -> Iterator[tuple[int, list[str]]]:
    """
    Yield the names of the columns and then the rows, each with its line in the file.

    Several blanks are one where blanks are between cells, as programs write that align columns.
    """
    if dialect.delimiter == ' ':
        file = (_BLANKS.sub(' ', line.strip(' ')) for line in file)
    reader = csv.reader(file, delimiter=dialect.delimiter, strict=True)
    rows = ((reader.line_num, cells) for cells in reader if cells
            and reader.line_num >= dialect.header
            and not (dialect.comment and cells[0].startswith(dialect.comment)))
    yield from islice(rows, 1)
    yield from islice(rows, dialect.skip, None)


def place_of(name: str, names: Sequence[str], path: Path) -> int:
    """
    Return where a column stands.

    Raises
    ------
    DataError
        There is no column of that name, or more than one.
    """
    if names.count(name) != 1:
        problem = 'several columns' if name in names else 'no column'
        raise DataError(f'{path}: {problem} {name!r}; there are {", ".join(names)}')
    return names.index(name)


def require_width(path: Path, rows: Iterable[tuple[int, list[str]]], width: int, header: int
                  ) -> None:
    """Refuse rows that have more or fewer cells than the line that names the columns."""
    for line, cells in rows:
        if len(cells) != width:
            raise DataError(
                f'{path} line {line}: {len(cells)} cells, but {width} columns in line {header}, '
                'which names them; compare the keys delimiter, header and comment')


def not_a_number(path: Path, cells: Iterable[tuple[int, str]], name: Column,
                 convert: Callable[[str], object]) -> DataError:
    """Return the complaint about the first cell of a column, given with lines, that is none."""
    for line, cell in cells:
        try:
            convert(cell)
        except (ValueError, InvalidOperation):
            break
    return DataError(f'{path} line {line}: {cell[:40]!r} in column {name!r} is not a number'
                     f'{_remedy(cell)}')


class Table:
    """
    The cells of a CSV file, one row of which names the columns.

    An empty cell behind the last named column is none: programs write a delimiter there. A last
    line that is cut short, within a line, is left out.

    Parameters
    ----------
    path : Path
    dialect : Dialect
    timed : bool
        Every row has a time, so that one which repeats the row before to the last character was
        written twice; such rows are left out.

    Attributes
    ----------
    names : list of str
    skipped : list of (int, list of str)
        Lines that the key skip leaves out.
    cut : int
        The last line, where it was cut short and is left out; else 0.
    repeated : int
        Rows that were left out because they repeat the one before.
    held : int
        The same of those that repeat it in some columns only, see :meth:`renewed`.

    Raises
    ------
    DataError
        There is no such file, no row in it, or a row of another length than the first.
    """

    def __init__(self, path: Path, dialect: Dialect = Dialect(), timed: bool = False) -> None:
        self.path = path
        rows = self._read(dialect._replace(skip=0))
        if not dialect.header and len(rows) > dialect.skip:
            rows.insert(0, (0, [str(k) for k in range(len(rows[dialect.skip][1]))]))
        self.skipped = rows[1:1 + dialect.skip]
        rows = rows[:1] + rows[1 + dialect.skip:]
        if len(rows) < 2:
            raise DataError(f'{path}: no rows; expected the names of the columns and then numbers')
        self.names = _names(rows[0][1])
        while self.names and not self.names[-1]:
            self.names.pop()
        width = len(self.names)
        rows = [(line, cells[:width] if not any(map(str.strip, cells[width:])) else cells)
                for line, cells in rows]
        self.cut = rows.pop()[0] if len(rows) > 2 and len(rows[-1][1]) < width and not (
            _ends_a_line(path)) else 0
        require_width(path, rows[1:], width, rows[0][0])
        again = [timed and cells == before for (_, before), (_, cells) in pairwise(rows)]
        self.repeated, self.held = sum(again), 0
        kept = [row for row, repeats in zip(rows[1:], again) if not repeats]
        self._lines = [line for line, _ in kept]
        self._columns = [tuple(cell.replace(dialect.decimal, '.') for cell in column)
                         for column in zip(*(cells for _, cells in kept))]

    def __len__(self) -> int:
        return len(self._lines)

    def _read(self, dialect: Dialect) -> list[tuple[int, list[str]]]:
        try:
            with self.path.open(encoding='utf-8-sig', newline='') as file:
                return list(rows_of(file, dialect))
        except OSError as error:
            raise DataError(f'{self.path}: cannot be read ({error.strerror}); paths count '
                            'from the folder of the specification or from --tables') from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise DataError(f'{self.path}: not a table of text ({error}); save it in '
                            'UTF-8') from error

    def renewed(self, names: Sequence[str]) -> 'Table':
        """
        Return the rows that differ from the one before in any of some columns.

        A program that logs the newest message of each stream writes one again that has not been
        renewed, its stamp included.
        """
        rows = list(zip(*(self.cells(name) for name in names)))
        new = np.array([True, *(a != b for a, b in pairwise(rows))])
        if new.all():
            return self
        part = self._rows(new)
        part.held = int((~new).sum())
        return part

    def having(self, names: Sequence[str]) -> tuple['Table', NDArray[np.bool_]]:
        """
        Return the rows in which any of some columns has a cell that is not empty, and which.

        Tables that merge streams of several rates leave the others' cells empty; all rows are
        returned where all are empty.
        """
        columns = [self.cells(name) for name in names]
        whole = np.ones(len(self), dtype=bool)
        if all(all(column) and not any(map(str.isspace, column)) for column in columns):
            return self, whole
        filled = np.any([[bool(cell.strip()) for cell in column] for column in columns], axis=0)
        if filled.all() or not filled.any():
            return self, whole
        return self._rows(filled), filled

    def _rows(self, kept: NDArray[np.bool_]) -> 'Table':
        part = copy(self)
        vars(part).update(_lines=list(compress(self._lines, kept)),
                          _columns=[tuple(compress(one, kept)) for one in self._columns])
        return part

    def cells(self, name: str) -> Sequence[str]:
        """
        Return a column as it was written.

        Raises
        ------
        DataError
            There is no column of that name, or more than one.
        """
        if name not in self.names and all(map(is_number, self.names)):
            raise DataError(
                f'{self.path}: no column {name!r}, and the line that should name the columns '
                'holds numbers; without names state header: 0 and count columns from 0, or state '
                'the line of the names, which must not begin with the key comment')
        return self._columns[place_of(name, self.names, self.path)]

    def numbers(self, names: Sequence[str]) -> Array:
        """
        Return columns as numbers, shape (n, k).

        Raises
        ------
        DataError
            A column is missing or a cell is no number; the line is named.
        """
        return np.stack([self._floats(name) for name in names], axis=1)

    def _floats(self, name: str) -> Array:
        cells = self.cells(name)
        try:
            return np.array(cells, dtype=float)
        except ValueError:
            raise self.not_a_number(name, float) from None

    def not_a_number(self, name: str, convert: Callable[[str], object]) -> DataError:
        """Return the complaint about the first cell of a column that is no number."""
        return not_a_number(self.path, zip(self._lines, self.cells(name)), name, convert)

    def line(self, row: int) -> int:
        """Return the line of the file that a row stands in."""
        return self._lines[row]


def _names(cells: Sequence[str]) -> list[str]:
    """Return the names of columns without the mark of a comment that programs write before."""
    first = cells[0].strip()
    names = [first.lstrip('# '), *(cell.strip() for cell in cells[1:])]
    return names[1:] if first == '#' else names


def is_number(cell: str) -> bool:
    """Whether a cell holds a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _ends_a_line(path: Path) -> bool:
    with path.open('rb') as file:
        file.seek(-1, SEEK_END)
        return file.read() in (b'\n', b'\r')


def _remedy(cell: str) -> str:
    if _DECIMAL_COMMA.fullmatch(cell):
        return "; has the table decimal: ','?"
    if DATE_AND_TIME.fullmatch(cell.strip()):
        return '; of times that are dates the unit is date'
    if _DATE.match(cell):
        return ('; write times as seconds since 1970, or as year-month-day hour:minute:second '
                'with unit: date')
    return '' if cell.strip() else '; take out rows with empty cells'


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
