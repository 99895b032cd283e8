"""Tables for a terminal; estimates as rows, each with its standard error and the truth."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import decimals_of, HALF, rounded, scaled
import numpy as np

MOST_DECIMALS = 7
"""Of a number in a table: the part of a unit vector along its axis would have ten, which is not
known."""

FINEST = 0.5 * 10.0 ** -MOST_DECIMALS / HALF
"""Standard error below which a table shows none of it."""

HALF_WIDTH = '± is the half-width of the 95 % interval.'
"""What a page or a table explains once."""

AXES = ('x', 'y', 'z')
WRENCH_AXES = ('force x', 'force y', 'force z', 'torque x', 'torque y', 'torque z')


@dataclass(frozen=True)
class Row:
    """
    One identified number.

    Attributes
    ----------
    name, key, unit : str
        Words for people, key in ``calibration.yaml``, SI unit.
    truth : float or None
        Known in simulation only.
    """

    name: str
    key: str
    unit: str
    value: float
    std: float
    truth: float | None = None


def estimates(calibration: Calibration) -> Iterator[tuple[str, str, Estimate, tuple[str, ...]]]:
    """
    Yield every physical estimate of a calibration.

    Yields
    ------
    name, key, estimate, labels : str, str, Estimate, tuple of str
        One label an element, empty for scalars.
    """
    c = calibration
    yield 'tool mass', 'mass', c.mass, ()
    yield 'centre of mass', 'com', c.com, AXES
    yield 'bias', 'wrench_bias', c.wrench_bias, WRENCH_AXES
    if c.inertia:
        # symmetric: an empty label leaves an element out
        yield 'inertia', 'inertia', c.inertia, tuple(
            AXES[i] + AXES[j] if i <= j else '' for i in range(3) for j in range(3))
    if c.accelerometer:
        a = c.accelerometer
        yield 'accelerometer offset', 'accelerometer.offset', a.offset, AXES
        yield 'accelerometer gain', 'accelerometer.gain', a.gain, AXES
        yield 'accelerometer map', 'accelerometer.map', a.map, tuple(
            f'{i}{j}' for i in AXES for j in AXES)
        yield 'accelerometer delay', 'accelerometer.delay', a.delay, ()
    if c.tool:
        yield 'tool stiffness', 'tool.stiffness', c.tool.stiffness, ()
        yield 'tool damping', 'tool.damping', c.tool.damping, ()


def table(calibration: Calibration, truth: Mapping[str, Array] | None = None) -> list[Row]:
    """
    Return every estimate as rows.

    Parameters
    ----------
    truth : mapping of str to ndarray, optional
        By key, as ``mass`` or ``accelerometer.gain``, where it is known.
    """
    return rows(estimates(calibration), truth)


def rows(found: Iterable[tuple[str, str, Estimate, tuple[str, ...]]],
         truth: Mapping[str, Array] | None = None) -> list[Row]:
    """Return what :func:`estimates` yields as rows; see :func:`table`."""
    out = []
    for name, key, estimate, labels in found:
        values, stds = estimate.value.ravel(), estimate.std.ravel()
        known = np.asarray(truth[key], dtype=float).ravel() if truth and key in truth else None
        for i, label in enumerate(labels or ('',)):
            if labels and not label:
                continue
            axis = '.' + label.replace(' ', '.') if label else ''
            out.append(Row(
                name=f'{name} {label}'.strip(), key=key + axis, unit=estimate.unit_of(i),
                value=float(values[i]), std=float(stds[i]),
                truth=None if known is None else float(known[i])))
    return out


def promises(calibration: Calibration) -> list[Row]:
    """Return how quick and how sure filter kalman is to be; files without them none."""
    kalman = {} if calibration.observer is None else calibration.observer.kalman
    return [Row(f'{words} {label}'.strip(), f'observer.kalman.{key}', kalman[key].unit_of(i),
                float(value), float('nan'))
            for key, words, labels in (
                ('bandwidth', 'contact wrench: bandwidth (-3 dB)', ('',)),
                ('rise_time', 'contact wrench: rise time (10-90 %)', ('',)),
                ('std', 'contact wrench: noise (RMS),', WRENCH_AXES)) if key in kalman
            for i, (label, value) in enumerate(zip(labels, kalman[key].value.ravel()))]


def residuals(calibration: Calibration) -> list[Row]:
    """Return the RMS residual of the static poses, or of the motion, one row a channel."""
    rms = calibration.quality.get('residual_rms', ())
    where = 'in motion' if calibration.quality.get('method') == 'motion' else 'at rest'
    return [Row(f'residual {label} {where}', f'quality.residual_rms.{label.replace(" ", ".")}',
                'N' if i < 3 else 'N m', float(value), float('nan'))
            for i, (label, value) in enumerate(zip(WRENCH_AXES, rms))]


def as_text(shown: list[Row]) -> str:
    """
    Return rows as a table for a terminal.

    Returns
    -------
    str
        Truth and its distance appear where at least one truth is known.
    """
    head, *body = cells(shown)
    return '\n'.join([*ruled(head, body, left=(0, 3)), HALF_WIDTH])


def cells(shown: Iterable[Row]) -> list[list[str]]:
    """Return rows as the cells of a table, its head first; see :func:`as_text`."""
    given = list(shown)
    shown = [handy(row, max(abs(one.value) for one in given if one.unit == row.unit))
             for row in given]
    with_truth = any(row.truth is not None for row in shown)
    return [['estimate', 'value', '±', 'unit', *['truth', 'off by'] * with_truth], *(
        [row.name, value(row), error(row), '' if row.unit == '1' else row.unit,
         *(against_truth(row) if with_truth else ())] for row in shown)]


def printed(columns: Sequence[str], body: Sequence[Sequence[Any]]) -> list[list[str]]:
    """
    Return a table as cells, its head first.

    Parameters
    ----------
    columns : sequence of str
        Where ``value``, ``standard error`` and ``unit`` follow each other, :func:`cells` makes
        the cells of these.
    """
    plain = [[f'{one:.6g}' if isinstance(one, float) else str(one) for one in row]
             for row in (columns, *body)]
    if 'standard error' not in columns:
        return plain
    k = columns.index('value')
    found = cells(Row('', '', row[k + 2], row[k], row[k + 1]) for row in body)
    return [[*row[:k], *shown[1:], *row[k + 3:]] for row, shown in zip(plain, found)]


def handy(row: Row, beside: float = 0.0) -> Row:
    """Return a row in a unit of a handy size, that of ``beside`` if larger; shares as they are."""
    if row.unit == '1':
        return row
    shown, factor = scaled(max(abs(row.value), abs(beside)), row.unit, row.std)
    return replace(row, unit=shown, value=row.value * factor, std=row.std * factor,
                   truth=None if row.truth is None else row.truth * factor)


def value(row: Row) -> str:
    """Return the value as text, to the digits that its standard error warrants."""
    if negligible(row):
        return f'{round(row.value, MOST_DECIMALS) + 0.0:.{MOST_DECIMALS}g}'
    return number(row.value, row.std)


def against_truth(row: Row) -> tuple[str, ...]:
    """Return the truth and how far from it the value is, as text."""
    if row.truth is None:
        return '', ''
    return tuple(value(replace(row, value=x)) for x in (row.truth, row.value - row.truth))


def error(row: Row) -> str:
    """Return half the 95 % interval as text, or a dash where it is not known."""
    if negligible(row):
        return f'< 1e-{MOST_DECIMALS}'
    return number(HALF * row.std, row.std) if row.std > 0 else '-'


def negligible(row: Row) -> bool:
    """Whether a standard error is known, and less than the last digit that a table shows."""
    return 0 < row.std < FINEST


def number(x: float, std: float) -> str:
    """Return a number as text, to the digits that half its 95 % interval warrants."""
    if not std > 0:
        return rounded(x)
    decimals = min(MOST_DECIMALS, decimals_of(HALF * std))
    return f'{round(x, decimals) + 0.0:.{decimals}f}'  # + 0.0: no minus before a zero


def ruled(head: Sequence[str], body: Sequence[Sequence[str]], left: Container[int]) -> list[str]:
    """Return a table as :func:`aligned` does, a rule below its head."""
    rule = ['-' * max(map(len, column)) for column in zip(head, *body)]
    return aligned([head, rule, *body], left)


def aligned(rows: Sequence[Sequence[str]], left: Container[int] = (0,)) -> list[str]:
    """Return rows of cells as lines in columns, those of ``left`` aligned to the left."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ['  '.join(cell.ljust(width) if k in left else cell.rjust(width)
                      for k, (cell, width) in enumerate(zip(row, widths))).rstrip()
            for row in rows]
