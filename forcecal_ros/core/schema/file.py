"""A section as a YAML file and as plain values: read and checked, one line where that fails."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from datetime import date, datetime
from functools import singledispatch
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING, TypeVar

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.safe_yaml import LARGEST, load_yaml
from forcecal_ros.core.schema.row import shown
from forcecal_ros.core.schema.sections import columns, read, UNKNOWN
import numpy as np
import yaml

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable  # Python 3.11

T = TypeVar('T')

OURS = 'forcecal-'
"""Begins the formats of this package's files."""


def load(kind: type[T], source: 'Path | Traversable', *, name: str = '', form: str = '',
         remedy: str = 'correct the file', extra: bool = False) -> T:
    """
    Read a file that holds one section.

    ``name`` is what messages call the file, by default its path; ``form`` what its key ``format``
    must say, where it has one; ``remedy`` ends every message; ``extra`` is as of
    :func:`~forcecal_ros.core.schema.sections.read`.

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
        there = 'name a file that is there' if isinstance(error, FileNotFoundError) else remedy
        raise ConfigError(f'{name}: cannot be read ({error.strerror}); {there}') from error
    if form and isinstance(document, dict):
        if document.get('format') != form:
            raise ConfigError(f'{name}: format is {shown(document.get("format"))}, expected '
                              f'{form}; {remedy}')
        document = {key: value for key, value in document.items() if key != 'format'}
    elif isinstance(document, dict) and str(document.get('format')).startswith(OURS):
        raise ConfigError(f'{name}: is a file of format {shown(document["format"])}, which is not '
                          f'what is read here; {remedy}')
    try:
        return read(kind, document, extra=extra)
    except ConfigError as error:
        raise ConfigError(f'{name}: {error}; {remedy}') from None


@singledispatch
def plain(value: Any) -> Any:
    """
    Return a value as plain numbers, words, lists and dicts; what is not finite becomes None.

    A section becomes what :func:`~forcecal_ros.core.schema.sections.read` reads.

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
