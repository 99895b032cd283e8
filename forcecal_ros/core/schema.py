"""One table for every value that a user may write: what it means, its type, unit, range, default.

A row is the annotation of a dataclass field, as in
``mass: Annotated[float, Row('Of the tool', 'kg', above=0.0)] = 1.0``: name, type and default are
the field's own. From the rows are made the reader of a YAML file (:func:`load`), the check
whenever a :class:`Section` is made, the line that states what was expected, the text that is
written (:func:`plain`), and the ROS parameters with their descriptors and files.

Why no library: of those that Ubuntu 24.04 brings, attrs 23.2 with cattrs 23.2 and pydantic 1.10
were tried on the rig. Both take ``true`` and ``'1'`` for a number unless every type gets a hook of
its own, neither knows shapes or units, and their messages name neither the value nor the bound
(``invalid value @ $.tool.com``), or spread over several lines. Code written against pydantic 1
does not run with the pydantic 2 of PyPI. What they would have saved, the walk over the fields, is
what is shortest here.
"""

from collections.abc import Callable, Iterable, Mapping
import dataclasses
from dataclasses import dataclass, is_dataclass
from datetime import date, datetime
from difflib import get_close_matches
from functools import cache, reduce, singledispatch
import math
from math import inf, isfinite
from operator import or_
from pathlib import Path
import re
import types
from typing import (
    Annotated,
    Any,
    ClassVar,
    get_args,
    get_origin,
    get_type_hints,
    NamedTuple,
    TYPE_CHECKING,
    TypeVar,
    Union,
)

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.safe_yaml import LARGEST, load_yaml
import numpy as np
import yaml

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable  # Python 3.11


Vector3 = tuple[float, float, float]
Vector4 = tuple[float, float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Vector7 = tuple[float, float, float, float, float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
TEXT = '.+'
"""Pattern of a text that must not be empty."""

Shape = tuple[int | None, ...]
"""Lengths of an array along its axes; None: any."""


_SWITCH: Mapping[Any, bool] = {'on': True, 'off': False}


class Mismatch(ConfigError):
    """A value does not fit its row; the message names key, value and what was expected."""

    def __init__(self, where: str, value: Any, expected: str, hint: str = '') -> None:
        self.where, self.found = where, f'is {shown(value)}, expected {expected}{hint}'
        super().__init__(f'{where or "the file"} {self.found}')


def shown(value: Any) -> str:
    """Return a value as it may stand in a message: short, and in one line for any content."""
    text = repr(value)
    return text if len(text) <= 80 else f'{text[:77]}...'


def _unwrapped(kind: Any) -> tuple[Any, bool]:
    """Return ``X`` of ``X | None`` and whether there was a None."""
    parts = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    rest = tuple(one for one in parts if one is not type(None))
    return reduce(or_, rest), len(rest) < len(parts)


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
    pattern, wording : str
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
    wording: str = ''
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
        if hasattr(value, 'tolist'):  # arrays of NumPy, and of rclpy
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
        if self.wording:
            return self.wording
        if self.words:
            return f'{"one of " * (len(self.words) > 1)}{", ".join(map(str, self.words))}'
        if kind is bool:
            return 'on or off'
        if kind is str:
            return 'a string'
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
            raise Mismatch(where, value, f'a list of {length or "one or more"} strings')
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
        number = 'integer' if _holds(kind) is int else 'number'
        what = f'a{"n" * (number == "integer")} {number}'
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


def _fits(shape: tuple[int, ...], expected: Shape | None) -> bool:
    if expected is None:
        return len(shape) <= 2
    return len(shape) == len(expected) and all(
        n == need if need is not None else n > 0 for n, need in zip(shape, expected))


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


T = TypeVar('T')

UNKNOWN = 'not identified'
"""What a document holds in place of a value that is None."""

_ABSENT = dataclasses.MISSING


class Column(NamedTuple):
    """
    One field of a section: its name, its key in documents, its type without None, and its row.

    ``default`` is ``dataclasses.MISSING`` where there is none; ``holds_sections`` is whether it is
    a section, or a list or mapping of them.
    """

    name: str
    key: str
    kind: Any
    optional: bool
    row: Row
    default: Any
    holds_sections: bool

    def take(self, value: Any, where: str, extra: bool = False) -> Any:
        """Check a value of this column and convert it; ``extra`` is as of :func:`read`."""
        kind = self.kind
        if get_origin(kind) is Mapping:
            if not isinstance(value, Mapping):
                raise Mismatch(where, value, 'a mapping')
            inner = get_args(kind)[1]
            return value if inner in (Any, object) else {
                name(key): self._take_one(inner, one, path(where, name(key)), extra)
                for key, one in value.items()}
        if self.holds_sections and get_origin(kind) is tuple:
            inner = get_args(kind)[0]
            if not isinstance(value, list | tuple) or not value:
                raise Mismatch(where, value, f'a list of entries with {columns(inner)[0].key}')
            return tuple(self._take_one(inner, one, f'{where}[{_label(inner, one, n)}]', extra)
                         for n, one in enumerate(value, 1))
        return self._take_one(kind, value, where, extra)

    def _take_one(self, kind: Any, value: Any, where: str, extra: bool) -> Any:
        return (read(kind, value, where, extra=extra) if self.holds_sections
                else self.row.take(kind, value, where))


class Section:
    """
    Base of dataclasses that check every row whenever they are made.

    A subclass with a check across its fields extends ``__post_init__`` and raises
    :meth:`wrong`. ``class Target(Section, name='impedance')`` is what messages put before the
    name of a field.
    """

    section: ClassVar[str]

    def __init_subclass__(cls, name: str | None = None) -> None:
        cls.section = cls.__name__.lower() if name is None else name

    def __post_init__(self) -> None:
        for column in columns(type(self)):
            value = getattr(self, column.name)
            if not column.holds_sections and not (value is None and column.optional):
                value = column.take(value, path(self.section, column.name))
                object.__setattr__(self, column.name, value)

    def wrong(self, name: str, expected: str, found: Any = _ABSENT) -> Mismatch:
        """Return the complaint about a field, or with an empty name about the whole section."""
        return Mismatch(path(self.section, name),
                        getattr(self, name) if found is _ABSENT else found, expected)


def _columns(kind: Any) -> tuple[Column, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_column(name, hints[name], default) for name, default in _defaults(kind))


columns: Callable[[Any], tuple[Column, ...]] = cache(_columns)
"""Return the columns of a dataclass or NamedTuple, in their order."""


def _is_section(kind: Any) -> bool:
    return dataclasses.is_dataclass(kind) or hasattr(kind, '_fields')


def _defaults(kind: Any) -> Iterable[tuple[str, Any]]:
    if not dataclasses.is_dataclass(kind):
        return [(name, kind._field_defaults.get(name, _ABSENT)) for name in kind._fields]
    return [(f.name, f.default if f.default_factory is _ABSENT else f.default_factory())
            for f in dataclasses.fields(kind) if f.init]


def _column(name: str, hint: Any, default: Any) -> Column:
    kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    row = next((extra for extra in extras if isinstance(extra, Row)), Row())
    inner, optional = _unwrapped(kind)
    sections = type(row).take is Row.take and any(map(_is_section, (inner, *get_args(inner))))
    return Column(name, row.key or name, inner, optional, row, default, sections)


def path(where: str, key: str) -> str:
    """Return the path of a key in a group."""
    return f'{where}.{key}' if where and key else where or key


def name(key: Any) -> str:
    """Return a key as it may stand in a message, for any content of a document."""
    text = str(key)
    return (text if text.isprintable() else repr(text))[:40]


def instead(given: Any, known: Iterable[str]) -> str:
    """Say what may be meant by a name that is not known."""
    known = list(known)
    close = get_close_matches(str(given), known, n=3)
    return (f'did you mean {" or ".join(close)}?' if close
            else f'expected one of {", ".join(known)}')


def read(kind: type[T], document: Any, where: str = '', *, extra: bool = False) -> T:
    """
    Make a section of a document.

    Parameters
    ----------
    kind : type
        A dataclass; a field without default is a key that the document must have.
    document : object
        Plain values, as of YAML.
    where : str
        Path of the section in the file, for messages.
    extra : bool
        Whether keys that are not known may be there; one that looks like a known key that is
        missing is refused all the same.

    Raises
    ------
    ConfigError
        A key is missing, unknown, or its value does not fit its row; without the file's name.
    """
    rows = columns(kind)
    if not isinstance(document, Mapping):
        raise Mismatch(where, document, f'the keys {", ".join(_known(rows))}')
    _refuse_unknown(rows, document, where, extra)
    values = {row.name: _value(row, document, where, extra) for row in rows}
    if missing := [row.key for row in rows if values[row.name] is _ABSENT]:
        raise ConfigError(f'{where}{": " if where else ""}missing key {", ".join(missing)}; '
                          f'add {"it" if len(missing) == 1 else "them"}')
    try:
        return kind(**values)
    except Mismatch as error:  # of a check across fields, under the section's own name
        own = error.where.removeprefix(getattr(kind, 'section', '')).removeprefix('.')
        raise ConfigError(f'{path(where, own) or "the file"} {error.found}') from None


def _known(rows: Iterable[Column]) -> list[str]:
    return list(dict.fromkeys(row.key.partition('.')[0] for row in rows))


def _refuse_unknown(rows: tuple[Column, ...], document: Mapping[Any, Any], where: str,
                    extra: bool) -> None:
    known = _known(rows)
    unknown = [key for key in document if key not in known]
    if extra:
        free = [key for key in known if key not in document]
        unknown = [key for key in unknown if get_close_matches(str(key), free)]
    if unknown:
        raise ConfigError(f'{where}{": " if where else ""}unknown key '
                          f'{", ".join(map(name, unknown))}; {instead(unknown[0], known)}')


def _value(row: Column, document: Mapping[Any, Any], where: str, extra: bool) -> Any:
    value: Any = document
    *groups, last = row.key.split('.')
    for i, key in enumerate(groups):
        value = {} if value.get(key) is None else value[key]
        if not isinstance(value, Mapping):
            raise Mismatch(path(where, '.'.join(groups[:i + 1])), value, 'a mapping')
    value = value.get(last, _ABSENT)
    nothing = value is None or (row.optional and value == UNKNOWN)
    if value is _ABSENT or (nothing and row.default is not _ABSENT):
        return row.default
    return None if nothing and row.optional else row.take(value, path(where, row.key), extra)


def _label(kind: type, entry: Any, number: int) -> str:
    """Name an entry of a list by its number from 1 and, where it is a word, its first key."""
    first = entry.get(columns(kind)[0].key) if isinstance(entry, Mapping) else None
    return f'{number}: {name(first)}' if isinstance(first, str) else str(number)


OURS = 'forcecal-'
"""Begins the formats of this package's files."""


def load(kind: type[T], source: 'Path | Traversable', *, name: str = '', form: str = '',
         remedy: str = 'correct the file', extra: bool = False) -> T:
    """
    Read a file that holds one section.

    ``name`` is what messages call the file, by default its path; ``form`` what its key ``format``
    must say, where it has one; ``remedy`` ends every message; ``extra`` is as of
    :func:`~forcecal_ros.core.schema.read`.

    Raises
    ------
    ConfigError
        The file cannot be read, is no YAML, or is not what the section's rows say.
    """
    name = name or str(source)
    try:
        with source.open('rb') as file:
            document = load_yaml(file.read(LARGEST + 1), name)
    except OSError as error:
        there = 'pass an existing file' if isinstance(error, FileNotFoundError) else remedy
        raise ConfigError(f'{name}: cannot be read ({error.strerror}); {there}') from error
    if form and isinstance(document, dict):
        if document.get('format') != form:
            raise ConfigError(f'{name}: format is {shown(document.get("format"))}, expected '
                              f'{form}; {remedy}')
        document = {key: value for key, value in document.items() if key != 'format'}
    elif isinstance(document, dict) and str(document.get('format')).startswith(OURS):
        raise ConfigError(f'{name}: has format {shown(document["format"])}, which is not '
                          f'supported here; {remedy}')
    try:
        return read(kind, document, extra=extra)
    except ConfigError as error:
        raise ConfigError(f'{name}: {error}; {remedy}') from None


@singledispatch
def plain(value: Any) -> Any:
    """
    Return a value as plain numbers, words, lists and dicts; what is not finite becomes None.

    A section becomes what :func:`~forcecal_ros.core.schema.read` reads.

    Raises
    ------
    TypeError
        There is no such form of it.
    """
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, date | datetime):
        return value.isoformat()
    if is_dataclass(value) and not isinstance(value, type):
        return _section(value)
    raise TypeError(f'cannot write a {type(value).__name__} into a document')


def _section(section: Any) -> dict[str, Any]:
    document: dict[str, Any] = {}
    for column in columns(type(section)):
        value = getattr(section, column.name)
        if value is None and column.row.omit:
            continue
        *groups, last = column.key.split('.')
        place = document
        for key in groups:
            place = place.setdefault(key, {})
        place[last] = UNKNOWN if value is None and column.optional else plain(value)
    return document


def yaml_value(value: Any) -> str:
    """Return a number, word or (nested) list of them as YAML in one line."""
    if isinstance(value, list | tuple):
        return f'[{", ".join(map(yaml_value, value))}]'
    return yaml.safe_dump(value, allow_unicode=True).removesuffix('...\n').strip()
