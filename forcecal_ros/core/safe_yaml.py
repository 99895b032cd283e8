"""YAML documents, read so that no small file takes unbounded time or memory."""

import re
from typing import Any

from forcecal_ros.core.errors import ConfigError
import yaml

LARGEST = 1 << 18
_DEEPEST = 32
_LONGEST_NUMBER = 1000


class _Loader(yaml.SafeLoader):
    """Safe loader without aliases, deep nests, endless numbers and keys that come twice."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError('aliases (*name) are not allowed')
        self._depth += 1
        if self._depth > _DEEPEST:
            raise yaml.YAMLError(f'nested more than {_DEEPEST} deep')
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_scalar(self, node: Any) -> Any:
        if node.tag.endswith((':int', ':float')) and len(node.value) > _LONGEST_NUMBER:
            raise yaml.YAMLError(f'a number has {len(node.value)} digits')
        return super().construct_scalar(node)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        mapping = super().construct_mapping(node, deep=deep)
        if len(mapping) != len(node.value):
            raise yaml.YAMLError(f'duplicate key {node.start_mark}')
        return mapping


# YAML 1.2, in which 2e-5 is a number; PyYAML requires a point and a sign
_Loader.add_implicit_resolver('tag:yaml.org,2002:float', re.compile(
    r'[-+]?(\.\d+|\d+(\.\d*)?)[eE][-+]?\d+$', re.ASCII), list('-+.0123456789'))


def load_yaml(text: str | bytes, name: str, largest: int = LARGEST) -> Any:
    """
    Read one YAML document of plain values.

    Parameters
    ----------
    name : str
        File or topic, for messages.
    largest : int
        Most that is read [characters].

    Returns
    -------
    object
        dict, list, str, number, ... or None for an empty document.

    Raises
    ------
    ConfigError
        It is too large, nested too deep, has aliases, tags or a key twice, or is no YAML.
    """
    head = text[:1024]
    if '\0' in head if isinstance(head, str) else b'\0' in head:
        raise ConfigError(f'{name}: binary data, expected YAML; pass the YAML file')
    if len(text) > largest:
        raise ConfigError(f'{name}: larger than the limit of {largest} bytes; pass the YAML file')
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 - a stricter SafeLoader
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError, TypeError) as error:
        raise ConfigError(f'{name}: not YAML of plain values: {_in_one_line(error)}') from error


def _in_one_line(error: Exception) -> str:
    """Say in one line what is wrong and where, without the text itself."""
    reason = str(error)
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
        mark = error.problem_mark
        reason = f'{error.problem} in line {mark.line + 1}, column {mark.column + 1}'
    return ' '.join(reason.split())[:200]
