"""Groups of keys: dataclasses whose fields have rows; checked, read from documents."""

from collections.abc import Iterable, Mapping
import dataclasses
from difflib import get_close_matches
from functools import cache
from typing import (
    Annotated,
    Any,
    ClassVar,
    get_args,
    get_origin,
    get_type_hints,
    NamedTuple,
    TypeVar,
)

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.schema.row import is_optional, Mismatch, Row, without_none

T = TypeVar('T')

UNKNOWN = 'not identified'
"""What a document says in place of a value that is None."""

_ABSENT = dataclasses.MISSING
_LONGEST_NAME = 40
"""Characters of a key that a message repeats."""


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
        row, kind = self.row, self.kind
        if self.holds_sections:
            return _take_sections(kind, value, where, extra)
        if get_origin(kind) is Mapping:
            if not isinstance(value, Mapping):
                raise Mismatch(where, value, 'a group of keys')
            inner = get_args(kind)[1]
            return value if inner in (Any, object) else {
                name(key): row.take(inner, one, path(where, name(key)))
                for key, one in value.items()}
        return row.take(kind, value, where)


class Section:
    """
    Base of dataclasses that check every row whenever they are made.

    A subclass with a check across its fields extends ``__post_init__`` and raises
    :meth:`wrong`. ``class Wanted(Section, name='impedance')`` is what messages put before the
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


def columns(kind: Any) -> tuple[Column, ...]:
    """Return the columns of a dataclass or NamedTuple, in their order."""
    return _columns(kind)


@cache
def _columns(kind: Any) -> tuple[Column, ...]:
    hints = get_type_hints(kind, include_extras=True)
    return tuple(_column(name, hints[name], default) for name, default in _defaults(kind))


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
    inner = without_none(kind)
    sections = type(row).take is Row.take and any(map(_is_section, (inner, *get_args(inner))))
    return Column(name, row.key or name, inner, is_optional(kind), row, default, sections)


def path(where: str, key: str) -> str:
    """Return the path of a key in a group."""
    return f'{where}.{key}' if where and key else where or key


def name(key: Any) -> str:
    """Return a key as it may stand in a message, whatever a document has there."""
    text = str(key)
    return (text if text.isprintable() else repr(text))[:_LONGEST_NAME]


def instead(wanted: Any, known: Iterable[str]) -> str:
    """Say what may be meant by a name that is not known."""
    known = list(known)
    close = get_close_matches(str(wanted), known, n=3)
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
        A key is missing, unknown, or its value is not what its row says; without the file's name.
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
        raise error.at(path(where, own)) from None


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
            raise Mismatch(path(where, '.'.join(groups[:i + 1])), value, 'a group of keys')
    value = value.get(last, _ABSENT)
    nothing = value is None or (row.optional and value == UNKNOWN)
    if value is _ABSENT or (nothing and row.default is not _ABSENT):
        return row.default
    return None if nothing and row.optional else row.take(value, path(where, row.key), extra)


def _take_sections(kind: Any, value: Any, where: str, extra: bool) -> Any:
    if _is_section(kind):
        return read(kind, value, where, extra=extra)
    inner = get_args(kind)[0 if get_origin(kind) is tuple else 1]
    if get_origin(kind) is Mapping:
        if not isinstance(value, Mapping):
            raise Mismatch(where, value, 'a group of keys')
        return {name(key): read(inner, one, path(where, name(key)), extra=extra)
                for key, one in value.items()}
    if not isinstance(value, list | tuple) or not value:
        raise Mismatch(where, value, f'a list, each with {columns(inner)[0].key}')
    return tuple(read(inner, one, f'{where}[{_label(inner, one, n)}]', extra=extra)
                 for n, one in enumerate(value, 1))


def _label(kind: type, entry: Any, number: int) -> str:
    """Name an entry of a list by its number from 1 and, where it is a word, its first key."""
    first = entry.get(columns(kind)[0].key) if isinstance(entry, Mapping) else None
    return f'{number}: {name(first)}' if isinstance(first, str) else str(number)
