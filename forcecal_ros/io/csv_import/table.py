"""One table of a file, CSV or MATLAB: cells of named columns as text, numbers and exact times."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from functools import partial
from itertools import islice
from operator import lt
from pathlib import Path
import re
import struct
from typing import Any
import zlib

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import MANY_MESSAGES, SLOWEST_HZ
from forcecal_ros.io.csv_import.specification import Column, DATE, NANOSECONDS, Written
import numpy as np
from numpy.typing import NDArray
import pandas as pd

MATLAB = '.mat'
_STORED = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 9: 'f8', 12: 'i8',
           13: 'u8'}
"""How a MATLAB file stores numbers; over any other type scipy.io.loadmat ends the process."""

_DECIMAL_COMMA = re.compile(r'\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*')
_DATE = re.compile(r'\s*\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}')
_DATE_AND_TIME = re.compile(
    r'(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[ T_/-](\d{1,2})(:\d{2}:\d{2})(?:[.,](\d{1,9}))?\s*'
    r'(Z|[+-]\d{2}:?\d{2})?')
"""As ISO 8601 and its neighbours write them; year first, because others are ambiguous."""

_MAX_TIME = 1 << 62
"""Later times are out of range of 64 bits once they are shifted [ns]."""


FASTEST = 50_000.0
"""No force sensor sends more rows a second [Hz]."""


@dataclass(frozen=True)
class Table:
    """
    Cells as text.

    Attributes
    ----------
    frame : DataFrame
        Its index counts the rows of the file below ``top`` lines, from 0.
    comment : str
        Begins lines that are not counted.
    notes : tuple of str
        What was left out.
    """

    path: Path
    frame: pd.DataFrame
    comment: str = ''
    top: int = 0
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frame)

    def place(self, row: int) -> str:
        """Return the file and the line of a row."""
        number = int(self.frame.index[row])
        if self.path.suffix == MATLAB:
            return f'{self.path} row {number + 1}'
        return f'{self.path} line {_line(self.path, self.comment, self.top, number)}'

    def select(self, rows: NDArray[Any], *notes: str) -> 'Table':
        """Return some of the rows, by a mask or by their numbers."""
        return replace(self, frame=self.frame.iloc[np.arange(len(self))[rows]],
                       notes=(*self.notes, *notes))

    def columns(self, names: Sequence[Column]) -> pd.DataFrame:
        """
        Return columns by their names, or by their numbers from 0.

        Raises
        ------
        DataError
            There is no such column, or more than one.
        """
        known = list(self.frame)
        for name in names:
            if isinstance(name, int) and name >= len(known):
                raise DataError(f'{self.path}: no column {name}; there are {len(known)}, counted '
                                'from 0')
            if isinstance(name, str) and name not in known and all(map(is_number, known)):
                raise DataError(
                    f'{self.path}: no column {name!r}: the header line contains numbers; set '
                    'header to the line of the names, or to 0 and count columns from 0')
            if isinstance(name, str) and known.count(name) != 1:
                problem = 'several columns' if name in known else 'no column'
                raise DataError(f'{self.path}: {problem} {name!r}; there are {", ".join(known)}')
        return self.frame.iloc[:, [one if isinstance(one, int) else known.index(one)
                                   for one in names]]

    def cells(self, name: str) -> list[str]:
        """Return a column as it was written; see :meth:`columns`."""
        return list(self.columns([name]).iloc[:, 0])

    def numbers(self, names: Sequence[Column]) -> Array:
        """
        Return columns as numbers, shape (n, k).

        Raises
        ------
        DataError
            A column is missing or a cell is not a number; the line is named.
        """
        found = self.columns(names)
        try:
            return np.asarray(found, dtype=float)
        except ValueError:
            for k, name in enumerate(names):
                self.require(name, found.iloc[:, k], float)
            raise

    def require(self, name: Column, cells: Iterable[str], convert: Callable[[str], object]
                ) -> None:
        """Raise DataError with the line of the first cell of a column that is not a number."""
        for row, cell in enumerate(cells):
            try:
                convert(cell)
            except (ValueError, InvalidOperation):
                raise DataError(f'{self.place(row)}: {cell[:40]!r} in column {name!r} is not a '
                                f'number{_remedy(cell)}') from None

    def renewed(self, names: Sequence[str]) -> 'Table':
        """
        Return the rows that differ from the one before in any of some columns.

        A program that logs the newest message of each stream writes one again that has not been
        renewed, its stamp included.
        """
        frame = self.columns(names)
        same = np.asarray((frame == frame.shift()).all(axis=1))
        return self.select(~same, f'{self.path}: {same.sum()} rows repeat stamp and values of the '
                                  'previous row and were left out'
                           ) if same.any() else self

    def having(self, names: Sequence[str]) -> NDArray[np.bool_]:
        """
        Return which rows have a cell that is not empty in any of some columns.

        Tables that merge streams of several rates leave the others' cells empty; all rows are
        returned if all are empty.
        """
        cells = self.columns(names).to_numpy()
        filled = np.array([any(cell.strip() for cell in row) for row in cells])
        return filled if filled.any() else ~filled

    def widened(self, time: str, unit: str, name: str, value: str) -> 'Table':
        """Return a table of one row a signal as one of a column a signal, in order of time."""
        frame = self.columns([time, name, value])
        twice = frame.duplicated([time, name])
        if twice.any():
            row = int(np.argmax(twice))
            raise DataError(f'{self.place(row)}: {frame.iloc[row, 1]!r} at time '
                            f'{frame.iloc[row, 0]} appears twice; import each recording '
                            'separately')
        first = frame.drop_duplicates(time)[time]
        wide = frame.pivot(index=time, columns=name, values=value)  # noqa: PD010 - not twice
        wide = wide.reindex(first).fillna('')
        wide.insert(0, time, first.to_numpy())
        found = replace(self, frame=wide.set_index(first.index))
        return found.select(np.argsort(_times(found, time, unit), kind='stable'))


def read_tables(path: Path, dialect: Written, *, named: bool = True, rows: int | None = None,
                text: bool = True) -> Iterator[Table]:
    """
    Read a CSV file, in parts of so many rows or as a whole.

    An empty cell behind the last named column is ignored: programs write a delimiter there.

    Parameters
    ----------
    named : bool
        Whether the line of the header names the columns; else their names are 0, 1, 2 ...
    text : bool
        False: columns that hold numbers alone are read as such, which is faster.

    Raises
    ------
    DataError
        The file cannot be read, has no row, or a row has more cells than there are columns.
    """
    top, width = max(0, dialect.header - 1) + (0 if named else dialect.skip), 0
    read = partial(
        pd.read_csv, path, header=None, dtype=object if text else None, keep_default_na=False,
        na_values=[], sep=r'\s+' if dialect.delimiter == ' ' else dialect.delimiter,
        comment=dialect.comment or None, decimal=dialect.decimal,
        encoding='utf-8-sig')
    try:
        names = _names(read(nrows=1, skiprows=top, dtype=object).iloc[0].tolist(), named)
        width = len(names)
        notes: tuple[str, ...] = ()
        if named:
            skipped = read(names=range(width + 1), nrows=1 + dialect.skip, skiprows=top)
            notes = tuple(_skipped(Table(path, skipped[1:], dialect.comment, top)))
            top = _line(path, dialect.comment, top, dialect.skip)
        found = read(names=range(width + 1), skiprows=top, chunksize=rows)
        for frame in [found] if isinstance(found, pd.DataFrame) else found:
            if not len(frame):
                raise pd.errors.EmptyDataError
            if not isinstance(frame.index, pd.RangeIndex):
                raise _too_wide(f'{path} line {top + 1}', width)
            behind = frame.pop(width) != ''
            if text and dialect.decimal != '.':
                frame = frame.apply(lambda one: one.str.replace(dialect.decimal, '.'))
            table = Table(path, frame.set_axis(names, axis=1), dialect.comment, top, notes)
            if behind.any():
                raise _too_wide(table.place(int(np.argmax(behind))), width)
            yield table
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror}); paths are relative to the '
                        'folder of the specification, or to --tables') from error
    except pd.errors.EmptyDataError:
        raise DataError(f'{path}: no rows; expected a line of column names, then '
                        'numbers') from None
    except (UnicodeDecodeError, pd.errors.ParserError) as error:
        line = re.search(r'in line (\d+), saw', str(error))
        if line is not None:
            raise _too_wide(f'{path} line {line[1]}', width) from error
        raise DataError(f'{path}: not a text table ({str(error).strip()}); save it in '
                        'UTF-8') from error


def _line(path: Path, comment: str, top: int, row: int) -> int:
    """Return the line of a row, counted below ``top`` lines without blank ones and comments."""
    with path.open(encoding='utf-8-sig') as file:
        lines = (number for number, text in enumerate(file, 1) if number > top and text.strip()
                 and not (comment and text.startswith(comment)))
        return next(islice(lines, row, None))


def _names(cells: list[str], named: bool) -> list[str]:
    """Return the names of columns without the mark of a comment that programs write before."""
    while cells and not cells[-1].strip():
        cells.pop()
    if not named:
        return [str(k) for k in range(len(cells))]
    return cells[1:] if cells[:1] == ['#'] else [cell.strip().lstrip('# ') for cell in cells]


def _skipped(lines: Table) -> Iterator[str]:
    """Return how many lines the key skip leaves out, and whether they hold numbers."""
    if len(lines):
        numbers = [row for row, cells in enumerate(lines.frame.to_numpy())
                   if all(is_number(cell) for cell in cells if cell)]
        yield (f'{lines.path}: the key skip ignores {len(lines)} line{"s" * (len(lines) > 1)}'
               + (f'; {lines.place(numbers[0])} contains numbers, not names or units: is skip too '
                  'large?' if numbers else ''))


def _too_wide(place: str, width: int) -> DataError:
    return DataError(f'{place}: more cells than the {width} columns of the header; check the keys '
                     'delimiter, header and comment')


def read_table(path: Path, dialect: Written, names: Sequence[str]) -> Table:
    """
    Read a CSV file or the variables of a MATLAB file.

    A last line that is cut short, within a line, is left out.

    Parameters
    ----------
    names : sequence of str
        Variables that are read.

    Raises
    ------
    DataError
        See :func:`read_tables`, or a MATLAB file lacks a variable.
    """
    if path.suffix == MATLAB:
        return _read_matlab(path, names)
    table, = read_tables(path, dialect, named=dialect.header > 0)
    if len(table) > 1 and not table.frame.iloc[-1, -1] and not (
            path.read_bytes().endswith((b'\n', b'\r'))):
        table = table.select(np.arange(len(table) - 1),
                             f'{table.place(-1)}: the last line is incomplete and was left out')
    return table


def _read_matlab(path: Path, names: Sequence[str]) -> Table:
    """Read variables of one length; of a matrix x the columns x(1), x(2), of a struct s s.x."""
    try:
        content = path.read_bytes()
        order = {b'\0\1IM': '<', b'\1\0MI': '>'}[content[124:128]]
        found = {name: column for kind, one in _elements(content[128:], order) if kind == 14
                 for name, column in _columns(one, order) if name}
    except OSError as error:
        raise DataError(f'{path}: cannot be read ({error.strerror})') from error
    except Exception as error:  # any error of a damaged file
        raise DataError(f'{path}: not an intact MATLAB file of version 5 to 7 ({error}); save it '
                        "with '-v7'") from error
    if lacking := [name for name in names if name not in found]:
        raise DataError(f'{path}: no column {lacking[0]!r}; there are {", ".join(found)}')
    lengths = {name: len(found[name]) for name in names}
    if len(set(lengths.values())) != 1:
        raise DataError(f'{path}: columns have the lengths {lengths}, expected one length; list '
                        'signals of other rates as separate tables')
    return Table(path, pd.DataFrame({name: [str(one) for one in found[name]] for name in names},
                                    dtype=object))


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and content of the elements of a MATLAB file, those that are compressed too."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f'{order}2I', data, at)
        at += 8
        content = data[at:at + size]
        if kind >> 16:  # up to four bytes, within the tag
            yield kind & 0xffff, data[at - 4:at - 4 + (kind >> 16)]
        elif kind == 15:
            yield from _elements(zlib.decompressobj().decompress(content, 1 << 28), order)
            at += size
        else:
            yield kind, content
            at += -(-size // 8) * 8


def _columns(array: bytes, order: str, name: str = '') -> Iterator[tuple[str, list[Any]]]:
    """Yield names and cells of the columns of an array, none where it holds no real numbers."""
    parts = list(_elements(array, order))
    if len(parts) < 4:  # empty
        return
    (_, flags), (_, shape), (_, own), (stored, values), *fields = parts
    name, kind = name or own.decode(), struct.unpack_from(f'{order}I', flags)[0] & 0x8ff
    if kind == 2:  # struct
        (size,), names = struct.unpack(f'{order}I', values), fields.pop(0)[1]
        keys = [names[k:k + size].rstrip(b'\0').decode() for k in range(0, len(names), size)]
        for key, (_, one) in zip(keys, fields if len(fields) == len(keys) else ()):
            yield from _columns(one, order, f'{name}.{key}')
    elif kind in range(6, 16):  # double to uint64, not complex
        found = np.frombuffer(values, order + _STORED[stored]).reshape(
            np.frombuffer(shape, f'{order}i4'), order='F').squeeze()
        if found.ndim == 1:
            yield name, found.tolist()
        elif found.ndim == 2:
            yield from ((f'{name}({k})', one.tolist()) for k, one in enumerate(found.T, 1))


def is_number(cell: str) -> bool:
    """Whether a cell holds a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _remedy(cell: str) -> str:
    if _DECIMAL_COMMA.fullmatch(cell):
        return "; for a decimal comma, set decimal: ','"
    if _DATE_AND_TIME.fullmatch(cell.strip()):
        return '; if the times are dates, set unit: date'
    if _DATE.match(cell):
        return ('; write times as seconds since 1970, or as year-month-day hour:minute:second '
                'with unit: date')
    return '' if cell.strip() else '; remove rows with empty cells'


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
    stamps = _times(table, name, unit)
    if further is not None:
        if (stamps % 10**9).any():
            raise DataError(f'{table.path}: column {name!r} has fractions of a second, so '
                            f'nanoseconds {further!r} cannot be added; use only one of them')
        more = _times(table, further, 'ns')
        _require_nanoseconds(table, further, more, len(np.unique(stamps)))
        stamps = stamps + more
    if (np.diff(stamps) <= 0).any():
        raise DataError(_disorder(table, stamps, name))
    return stamps


def _times(table: Table, name: str, unit: str) -> Times:
    convert = _date if unit == DATE else partial(_exact, unit=NANOSECONDS[unit])
    cells = table.cells(name)
    try:
        times = [convert(cell) for cell in cells]
    except (ValueError, InvalidOperation):
        table.require(name, cells, convert)
        raise
    if max(map(abs, times)) >= _MAX_TIME:
        raise DataError(f'{table.path}: times in column {name!r} are out of range; check the unit')
    return np.array(times, dtype=np.int64)


def _require_nanoseconds(table: Table, name: str, more: Times, seconds: int) -> None:
    """Refuse what is no part of a second, and parts of one that are in a larger unit."""
    if more.min() < 0 or more.max() >= 10**9:
        raise DataError(f'{table.path}: column {name!r} is from {more.min()} to {more.max()}, '
                        'expected nanoseconds from 0 to 999999999')
    if len(more) < max(50, 3 * seconds):
        return
    for unit, factor in (('milliseconds', 10**6), ('microseconds', 10**3)):
        if more.max() * factor < 10**9:
            raise DataError(f'{table.path}: column {name!r} never exceeds {more.max()}: these '
                            f'are {unit}; multiply them by {factor}')


def _disorder(table: Table, stamps: Times, name: str) -> str:
    """Return where times do not grow, and why if that is plain."""
    steps = np.diff(stamps)
    row = int(np.argmax(steps <= 0)) + 1
    cells = table.cells(name)
    where = (f'{table.place(row)}: time {cells[row]} in column {name!r} is not after '
             f'{cells[row - 1]} in the row before')
    if steps[row - 1] < -23 * 3600 * 10**9:
        return f'{where}: the time of day passes midnight; add 24 h from there on'
    if _lacks_zeros(cells):
        return (f'{where}: the nanoseconds after the decimal point have no leading zeros; write '
                'nine digits, or use separate columns')
    if steps.min() < 0:
        return (f'{where}; sort the table, or import each part separately if the clock was set '
                'back or a second log begins')
    return (f'{where}, as in {int((steps == 0).sum())} rows: the resolution of the times is too '
            'low. If rows are evenly spaced, set rate instead of time; if the table merges '
            'streams, list it once for each stream with its own time column')


def _lacks_zeros(cells: Sequence[str]) -> bool:
    """Whether times grow if what stands behind the point counts nanoseconds."""
    parts = [cell.strip().partition('.') for cell in cells]
    if not all(whole.isdigit() and more.isdigit() for whole, _, more in parts):
        return False
    times = [(int(whole), int(more)) for whole, _, more in parts]
    return len({len(more) for *_, more in parts}) > 1 and all(map(lt, times, times[1:]))


def _date(cell: str) -> int:
    """Convert a date to nanoseconds since 1970; of no other form than year first."""
    found = _DATE_AND_TIME.fullmatch(cell.strip())
    if found is None:
        raise ValueError(cell)
    year, month, day, hour, more, fraction, zone = found.groups()
    return _MAX_TIME if not 1900 < int(year) < 2100 else int(pd.Timestamp(
        f'{year}-{month:0>2}-{day:0>2}T{hour:0>2}{more}.{fraction or 0}{zone or "Z"}').value)


def _exact(cell: str, unit: int) -> int:
    """Convert a time without passing through binary fractions."""
    try:
        return int(cell) * unit
    except ValueError:
        number = Decimal(cell.strip())
    if not number.is_finite():
        raise ValueError(cell)
    return _MAX_TIME if number.adjusted() > 18 else int((number * unit).to_integral_value())


def question_rate(rows: int, span: float, what: str, unit: str) -> Iterator[str]:
    """Question a rate that no sensor has; ``span`` from the first row to the last [s]."""
    if rows >= MANY_MESSAGES and rows <= SLOWEST_HZ * span:
        yield (f'{what}: {rows} rows over {span / 3600:.2g} h, {rows / span:.3g} per second; if '
               f'that is too slow, time is not in {unit}: correct the unit')
    if rows >= MANY_MESSAGES and rows > FASTEST * span:
        yield (f'{what}: {rows} rows in {span:.3g} s, more than any sensor sends; if time is not '
               f'in {unit}, correct the unit')
