"""Numbers as a person writes them: as many digits as are known, in units of a handy size."""

from collections.abc import Sequence
from math import floor, inf, isfinite, log10, nan

HALF = 1.96
"""Standard errors from the middle of a 95 % interval to its end."""

SCALES = {
    's': ((1e-3, 'µs', 1e6), (0.5, 'ms', 1e3), (inf, 's', 1.0)),
    'm': ((1e-3, 'µm', 1e6), (0.5, 'mm', 1e3), (inf, 'm', 1.0)),
    'rad': ((inf, 'deg', 57.29577951308232),),
    '1': ((1e-3, 'ppm', 1e6), (inf, '%', 100.0)),
    'V': ((0.1, 'mV', 1e3), (inf, 'V', 1.0)),
    'V/(m/s^2)': ((0.5, 'mV/(m/s^2)', 1e3), (inf, 'V/(m/s^2)', 1.0)),
    'kg': ((0.1, 'g', 1e3), (inf, 'kg', 1.0)),
    'kg m^2': ((0.01, 'g m^2', 1e3), (inf, 'kg m^2', 1.0)),
    'N': ((0.01, 'mN', 1e3), (inf, 'N', 1.0)),
    'N m': ((0.01, 'mN m', 1e3), (inf, 'N m', 1.0)),
}
"""SI unit -> (below which size, unit that is shown, factor); other units stay as they are."""


def quantity(value: float, std: float, unit: str, *, signed: bool = False) -> str:
    """
    Write an estimate: value ± half its 95 % interval, and unit.

    Parameters
    ----------
    value, std : float
        With its standard error, in ``unit``; one that is not known (0 or NaN) is left out.
    unit : str
        SI; ``1``: relative.
    signed : bool
        With a plus where it is positive.

    Returns
    -------
    str
        ``4.000 ± 0.014 ms``
    """
    shown, factor = scaled(value, unit, std)
    value, std = value * factor, std * factor
    sign = '+' if signed and value > 0 else ''
    power = floor(log10(abs(value))) if abs(value) >= 1e5 else 0
    text = f'{sign}{pair(value / 10 ** power, std / 10 ** power)}'
    return f'({text}) x 10^{power} {shown}' if power else f'{text} {shown}'


def size(value: float, unit: str, digits: int = 3, largest: float = 0.0) -> str:
    """Write a number of unknown error in a few digits, and its unit, that of ``largest``."""
    shown, factor = scaled(max(abs(value), largest), unit)
    return f'{rounded(value * factor, digits)} {shown}'


def sizes(values: Sequence[float], unit: str, digits: int = 2) -> str:
    """Write numbers of one kind in a few digits each, and their unit once."""
    shown, factor = scaled(max(map(abs, values)), unit)
    return f'{", ".join(rounded(value * factor, digits) for value in values)} {shown}'


def beside(values: Sequence[float], unit: str, largest: float = 0.0) -> tuple[str, list[str]]:
    """
    Write numbers of one row, the last of which is their noise: the unit, and each number.

    Parameters
    ----------
    largest : float
        Of other rows of the same quantity, which have the same unit.
    """
    shown, factor = scaled(max(largest, *map(abs, values)), unit)
    noise = abs(values[-1]) * factor
    decimals = max(0, 2 - floor(log10(noise))) if noise > 0.0 else 3
    written = [f'{value * factor:.{decimals}f}' for value in values]
    return shown, [one if float(one) else '0' for one in written]


def rounded(value: float, digits: int = 3) -> str:
    """Write a number in so many significant digits, without an exponent where it is readable."""
    if not isfinite(value) or value == 0.0:
        return f'{value:g}'
    power = int(f'{value:.{digits - 1}e}'.partition('e')[2])  # of what it is rounded to
    if not -4 <= power < 5:
        return f'{value:.{digits - 1}e}'
    return f'{round(value, digits - 1 - power):.{max(0, digits - 1 - power)}f}'


def scaled(value: float, unit: str, std: float = nan) -> tuple[str, float]:
    """Return the unit in which a number, or its larger error, is of a handy size, and how many."""
    largest = max(abs(value), 0.0, std)
    scales = SCALES.get(unit, ((inf, unit, 1.0),))
    _, shown, factor = next((one for one in scales if 0.0 < largest < one[0]), scales[-1])
    return shown, factor


def with_error(value: float, std: float) -> tuple[str, str]:
    """Write a value and half its 95 % interval, to the digits that this warrants."""
    if not std > 0.0 or not isfinite(std):
        return rounded(value), '-'
    decimals = decimals_of(HALF * std)
    return f'{round(value, decimals) + 0.0:.{decimals}f}', f'{HALF * std:.{decimals}f}'


def decimals_of(std: float) -> int:
    """Return how many decimals an error warrants: of two digits if it begins with 1 or 2."""
    power = floor(log10(std))
    return max(0, (1 if std / 10.0 ** power < 2.95 else 0) - power)


def pair(value: float, std: float) -> str:
    """Write a value ± half its 95 % interval where its standard error is known."""
    number, error = with_error(value, std)
    return number if error == '-' else f'{number} ± {error}'
