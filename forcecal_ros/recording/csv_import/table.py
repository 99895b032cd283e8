"""One CSV file: named columns of cells, and numbers and times out of them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
import csv
from decimal import Decimal, InvalidOperation
from itertools import islice
from pathlib import Path
import re
from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

_FARTHEST = 1 << 62
"""Times beyond are out of range of 64 bits once they are shifted [ns]."""


_DECIMAL_COMMA = re.compile(r'\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*')
_DATE = re.compile(r'\s*\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}')


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
        Line of the file that names the columns.
    skip : int
        Lines between that one and the numbers, as one of units.
    """

    delimiter: str = ','
    decimal: str = '.'
    comment: str = ''
    header: int = 1
    skip: int = 0


def rows_of(file: Iterable[str], dialect: Dialect) -> Iterator[tuple[int, list[str]]]:
    """Yield the names of the columns and then the rows, each with its line in the file."""
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

    Attributes
    ----------
    names : list of str
    skipped : list of (int, list of str)
        Lines that the key skip leaves out.

    Raises
    ------
    DataError
        There is no such file, no row in it, or a row of another length than the first.
    """

    def __init__(self, path: Path, dialect: Dialect = Dialect()) -> None:
        self.path = path
        rows = self._read(dialect._replace(skip=0))
        self.skipped = rows[1:1 + dialect.skip]
        rows = rows[:1] + rows[1 + dialect.skip:]
        if len(rows) < 2:
            raise DataError(f'{path}: no rows; expected the names of the columns and then numbers')
        self.names = [name.strip() for name in rows[0][1]]
        require_width(path, rows, len(self.names), rows[0][0])
        self._lines = [line for line, _ in rows[1:]]
        self._columns = [tuple(cell.replace(dialect.decimal, '.') for cell in column)
                         for column in zip(*(cells for _, cells in rows[1:]))]

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
            raise DataError(f'{self.path}: not a table of text ({error})') from error

    def cells(self, name: str) -> Sequence[str]:
        """
        Return a column as it was written.

        Raises
        ------
        DataError
            There is no column of that name, or more than one.
        """
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
            raise self._not_a_number(name, float) from None

    def _not_a_number(self, name: str, convert: Callable[[str], object]) -> DataError:
        return not_a_number(self.path, zip(self._lines, self.cells(name)), name, convert)

    def nanoseconds(self, name: str, unit: int) -> NDArray[np.int64]:
        """
        Return a column of times, exact to the nanosecond, shape (n,).

        Parameters
        ----------
        unit : int
            Nanoseconds in the unit of the column.

        Raises
        ------
        DataError
            A cell is no number, out of range, or not after the one before; the line is named.
        """
        try:
            times = [_exact(cell, unit) for cell in self.cells(name)]
        except (ValueError, InvalidOperation):
            raise self._not_a_number(name, Decimal) from None
        if max(times) >= _FARTHEST or min(times) <= -_FARTHEST:
            raise DataError(f'{self.path}: times in column {name!r} are out of range; is the unit '
                            'right?')
        stamps = np.array(times, dtype=np.int64)
        early = np.flatnonzero(np.diff(stamps) <= 0)
        if len(early):
            row = int(early[0]) + 1
            cells = self.cells(name)
            raise DataError(f'{self.path} line {self._lines[row]}: time {cells[row]} in column '
                            f'{name!r} is not after {cells[row - 1]} in the row before; sort the '
                            'table and take out repeated rows')
        return stamps

    def line(self, row: int) -> int:
        """Return the line of the file that a row stands in."""
        return self._lines[row]


def _remedy(cell: str) -> str:
    if _DECIMAL_COMMA.fullmatch(cell):
        return "; has the table decimal: ','?"
    if _DATE.match(cell):
        return '; write times as seconds since 1970'
    return '' if cell.strip() else '; take out rows with empty cells'


def _exact(cell: str, unit: int) -> int:
    """Convert a time without passing through binary fractions."""
    try:
        return int(cell) * unit
    except ValueError:
        number = Decimal(cell.strip())
    if not number.is_finite():
        raise ValueError(cell)
    return _FARTHEST if number.adjusted() > 18 else int((number * unit).to_integral_value())
