"""What the name of a column says of its unit, or of its place in a quaternion."""

from collections.abc import Mapping, Sequence
import re

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
