"""Units that tables may be in, their size in SI, and what the name of a column says of them."""

from collections.abc import Mapping, Sequence
from math import pi
import re

from forcecal_ros.core.geometry import STANDARD_GRAVITY

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
