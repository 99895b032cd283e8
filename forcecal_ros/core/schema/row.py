"""One row: what a value means, its unit and range, and the check that says what was expected."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite
import re
import types
from typing import Any, get_args, get_origin, Union

from forcecal_ros.core.errors import ConfigError
import numpy as np

Vector3 = tuple[float, float, float]
Vector4 = tuple[float, float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Vector7 = tuple[float, float, float, float, float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
TEXT = '.+'
"""Pattern of a text that must not be empty."""

Shape = tuple[int | None, ...]
"""Lengths of an array along its axes; None: any."""

_MOST_SHOWN = 80
"""Characters of a wrong value that a message repeats: one line of a terminal with the rest."""

_SWITCH: Mapping[Any, bool] = {'on': True, 'off': False}


class Mismatch(ConfigError):
    """A value is not what its row says; the message names key, value and what was expected."""

    def __init__(self, where: str, value: Any, expected: str, hint: str = '') -> None:
        self.where, self._rest = where, f' is {shown(value)}, expected {expected}{hint}'
        super().__init__(f'{where or "the file"}{self._rest}')

    def at(self, where: str) -> 'Mismatch':
        """Return the same complaint about another key."""
        other = Mismatch(where, None, '')
        other._rest, other.args = self._rest, (f'{where}{self._rest}',)
        return other


def shown(value: Any) -> str:
    """Return a value as it may stand in a message: short, and in one line whatever is in it."""
    text = repr(value)
    return text if len(text) <= _MOST_SHOWN else f'{text[:_MOST_SHOWN - 3]}...'


def is_optional(kind: Any) -> bool:
    """Whether None is of this type."""
    return get_origin(kind) in (Union, types.UnionType) and type(None) in get_args(kind)


def without_none(kind: Any) -> Any:
    """Return ``X`` of ``X | None``, and any other type as it is."""
    if not is_optional(kind):
        return kind
    first, *more = (one for one in get_args(kind) if one is not type(None))
    return Union[(first, *more)] if more else first


@dataclass(frozen=True)
class Row:
    """
    What a field's type cannot say, as ``speed: Annotated[float, Row('Peak', 'm/s', 0.0)]``.

    Attributes
    ----------
    meaning, unit : str
        For files, ROS parameters and messages.
    low, high : float
        Range of each number, both ends included.
    above, below : float
        The same, both ends excluded.
    words : tuple
        The only values there are; empty: any.
    shape : Shape or None
        Of an array, whose type does not say it; None: any of up to two axes.
    pattern, wanted : str
        What a text has to match, and that in words.
    finite : bool
        Whether NaN and infinity are refused.
    key : str
        The key of a file, with dots between groups; empty: the field's name.
    omit : bool
        Whether a file leaves the key out where the value is None.
    """

    meaning: str = ''
    unit: str = ''
    low: float = -inf
    high: float = inf
    above: float = -inf
    below: float = inf
    words: tuple[Any, ...] = ()
    shape: Shape | None = ()
    pattern: str = ''
    wanted: str = ''
    finite: bool = True
    key: str = ''
    omit: bool = False

    def take(self, kind: Any, value: Any, where: str) -> Any:
        """
        Check a value, and convert it to a type.

        ``kind`` is the type: bool, int, float, str, an array, or a (nested) tuple of one of them.

        Raises
        ------
        Mismatch
            Wrong type, shape, range or word.
        """
        if not self.words and _holds(kind) is float and self._right(value, shape_of(kind)):
            return value
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if self.words:
            if type(value) is bool or value not in self.words:
                raise self.wrong(kind, value, where)
            return self.words[self.words.index(value)]
        if kind is bool:
            return self._switch(value, where)
        if kind is str:
            return self._text(value, where)
        if get_origin(kind) is tuple and get_args(kind)[0] is str:
            return self._texts(kind, value, where)
        return self._numbers(kind, value, where)

    def expected(self, kind: Any) -> str:
        """Say what is expected, with unit and range."""
        if self.wanted:
            return self.wanted
        if self.words:
            return f'{"one of " * (len(self.words) > 1)}{", ".join(map(str, self.words))}'
        if kind is bool:
            return 'on or off'
        if kind is str:
            return 'a text'
        return self._expected_numbers(kind)

    def wrong(self, kind: Any, value: Any, where: str, hint: str = '') -> Mismatch:
        """Return the complaint about a value."""
        return Mismatch(where, value, self.expected(kind), hint)

    def range(self) -> str:
        """Say between what the numbers lie; empty where nothing bounds them."""
        if isfinite(self.low) and isfinite(self.high):
            return f'from {_shortly(self.low)} to {_shortly(self.high)}'
        return ' and '.join(f'{word} {_shortly(bound)}' for word, bound in (
            ('at least', self.low), ('above', self.above), ('at most', self.high),
            ('below', self.below)) if isfinite(bound))

    def _right(self, value: Any, shape: Shape) -> bool:
        """Say quickly whether floats are right as they are, so that sections are cheap to make."""
        if shape:
            return type(value) is tuple and len(value) == shape[0] and all(
                self._right(one, shape[1:]) for one in value)
        return (type(value) is float and self.low <= value <= self.high
                and self.above < value < self.below)

    def _switch(self, value: Any, where: str) -> bool:
        if isinstance(value, str):
            value = _SWITCH.get(value, value)
        if not isinstance(value, bool):
            raise self.wrong(bool, value, where)
        return value

    def _text(self, value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise self.wrong(str, value, where,
                             f'; put it in quotes: {str(value)!r}' if _is_number(value) else '')
        if self.pattern and not re.fullmatch(self.pattern, value, re.DOTALL):
            raise self.wrong(str, value, where)
        return value

    def _texts(self, kind: Any, value: Any, where: str) -> tuple[str, ...]:
        length = None if get_args(kind)[-1] is ... else len(get_args(kind))
        if not isinstance(value, list | tuple) or length not in (None, len(value)):
            raise Mismatch(where, value, f'a list of {length or "one or more"} texts')
        return tuple(self._text(one, where) for one in value)

    def _numbers(self, kind: Any, value: Any, where: str) -> Any:
        if not _all_numbers(value):
            raise self.wrong(kind, value, where)
        try:
            array = np.array(value, dtype=float)
        except (ValueError, OverflowError):
            raise self.wrong(kind, value, where) from None
        if not _fits(array.shape, self._shape(kind)):
            raise self.wrong(kind, value, where)
        if self.finite and not np.isfinite(array).all():
            raise Mismatch(where, value, self.expected(kind).replace('number', 'finite number', 1))
        within = (array >= self.low) & (array <= self.high) & (
            (array > self.above) | (self.above == -inf)) & ((array < self.below)
                                                             | (self.below == inf))
        if not (within | np.isnan(array)).all() or (_holds(kind) is int and (array % 1).any()):
            raise self.wrong(kind, value, where)
        if get_origin(kind) is tuple or kind in (int, float):
            return _converted(_holds(kind), value)
        return array

    def _shape(self, kind: Any) -> Shape | None:
        return shape_of(kind) if self.shape == () else self.shape

    def _expected_numbers(self, kind: Any) -> str:
        shape = self._shape(kind)
        number = 'whole number' if _holds(kind) is int else 'number'
        what = f'a {number}'
        if shape is None:
            what = f'{number}s'
        elif len(shape) == 1:
            what = f'a list of {shape[0] or "one or more"} {number}s'
        elif len(shape) == 2:
            what = f'{shape[0] or "one or more"} rows of {shape[1] or "equally many"} {number}s'
        range_ = self.range().replace('at least', 'of at least')
        return ' '.join(filter(None, (what, range_, self.unit and f'[{self.unit}]')))


@cache
def shape_of(kind: Any) -> Shape:
    """Return the shape of a number, or of (nested) tuples of numbers."""
    if get_origin(kind) is not tuple:
        return ()
    first, *more = get_args(kind)
    return (None if more == [...] else 1 + len(more), *shape_of(first))


@cache
def _holds(kind: Any) -> Any:
    return _holds(get_args(kind)[0]) if get_origin(kind) is tuple else kind


def _fits(shape: tuple[int, ...], wanted: Shape | None) -> bool:
    if wanted is None:
        return len(shape) <= 2
    return len(shape) == len(wanted) and all(
        n == want if want is not None else n > 0 for n, want in zip(shape, wanted))


def _shortly(bound: float) -> str:
    short = f'{bound:g}'
    return short if float(short) == bound else repr(bound)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _all_numbers(value: Any) -> bool:
    return all(map(_all_numbers, value)) if isinstance(value, list | tuple) else _is_number(value)


def _converted(to: Any, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(_converted(to, one) for one in value)
    return to(value)
