"""Numbers as a person writes them: as many digits as are known, in units of a handy size."""

from collections.abc import Sequence
from dataclasses import replace
from math import floor, isfinite, log10

from forcecal_ros.report.rows import Row

SCALES = {
    's': ((1e-3, 'µs', 1e6), (0.5, 'ms', 1e3), (float('inf'), 's', 1.0)),
    'm': ((1e-3, 'µm', 1e6), (0.5, 'mm', 1e3), (float('inf'), 'm', 1.0)),
    'rad': ((float('inf'), 'deg', 57.29577951308232),),
    '1': ((1e-3, 'ppm', 1e6), (float('inf'), '%', 100.0)),
    'V': ((0.1, 'mV', 1e3), (float('inf'), 'V', 1.0)),
}
"""SI unit -> (below which size, unit that is shown, factor); other units stay as they are."""

LARGE = 1e5
"""From here on a number is written with its power of ten."""


def quantity(value: float, std: float, unit: str, *, signed: bool = False) -> str:
    """
    Write an estimate: value, standard error and unit.

    Parameters
    ----------
    value, std : float
        In ``unit``; a standard error that is not known (0 or NaN) is left out.
    unit : str
        SI; ``1``: relative.
    signed : bool
        With a plus where it is positive.

    Returns
    -------
    str
        ``4.000 ± 0.014 ms``
    """
    shown, factor = _scale(value, unit)
    value, std = value * factor, std * factor
    sign = '+' if signed and value > 0 else ''
    if abs(value) >= LARGE:
        power = floor(log10(abs(value)))
        return (f'({sign}{pair(value / 10 ** power, std / 10 ** power)}) x 10^{power} {shown}')
    return f'{sign}{pair(value, std)} {shown}'


def size(value: float, unit: str, digits: int = 3) -> str:
    """Write a number of unknown error and its unit, in a few digits."""
    shown, factor = _scale(value, unit)
    return f'{rounded(value * factor, digits)} {shown}'


def handy(row: Row) -> Row:
    """Return a row in a unit of a handy size; shares stay as they are."""
    if row.unit == '1':
        return row
    shown, factor = _scale(row.value, row.unit)
    return replace(row, unit=shown, value=row.value * factor, std=row.std * factor,
                   truth=None if row.truth is None else row.truth * factor)


def beside(values: Sequence[float], unit: str) -> tuple[str, list[str]]:
    """Write numbers of one row, the last of which is their noise: the unit, and each number."""
    shown, factor = _scale(max(map(abs, values)), unit)
    noise = abs(values[-1]) * factor
    decimals = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 3
    written = [f'{value * factor:.{decimals}f}' for value in values]
    return shown, [one if float(one) else '0' for one in written]


def rounded(value: float, digits: int = 3) -> str:
    """Write a number in so many significant digits, without an exponent where it is readable."""
    if not isfinite(value) or value == 0.0:
        return f'{value:g}'
    power = floor(log10(abs(value)))
    if not -4 <= power < 5:
        return f'{value:.{digits - 1}e}'
    return f'{round(value, digits - 1 - power):.{max(0, digits - 1 - power)}f}'


def _scale(value: float, unit: str) -> tuple[str, float]:
    for below, shown, factor in SCALES.get(unit, ()):
        if abs(value) < below and value:
            return shown, factor
    *_, (_, shown, factor) = SCALES.get(unit, ((0.0, unit, 1.0),))
    return shown, factor


def with_error(value: float, std: float) -> tuple[str, str]:
    """Write both to the digits of the error: two where it begins with 1 or 2, else one."""
    if not std > 0.0 or not isfinite(std):
        return rounded(value), '-'
    power = floor(log10(std))
    decimals = max(0, (1 if std / 10.0 ** power < 2.95 else 0) - power)
    return f'{round(value, decimals) + 0.0:.{decimals}f}', f'{std:.{decimals}f}'


def pair(value: float, std: float) -> str:
    """Write both, the error where it is known."""
    number, error = with_error(value, std)
    return number if error == '-' else f'{number} ± {error}'
