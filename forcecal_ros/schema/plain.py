"""Results and sections as plain numbers, words, lists and dicts, which any YAML or JSON takes."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from datetime import date, datetime
from functools import singledispatch
import math
from typing import Any

from forcecal_ros.schema.sections import columns, UNKNOWN
import numpy as np
import yaml


@singledispatch
def plain(value: Any) -> Any:
    """
    Return a value as plain numbers, words, lists and dicts; what is not finite becomes None.

    A section becomes what :func:`~forcecal_ros.schema.sections.read` reads.

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
