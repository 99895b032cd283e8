"""YAML documents, read so that no small file takes unbounded time or memory."""

from typing import Any

from forcecal_ros.errors import ConfigError
import yaml

LARGEST = 1 << 18
_DEEPEST = 32


class _Loader(yaml.SafeLoader):
    """Safe loader without aliases and deep nests, which only traps need."""

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


def load_yaml(text: str | bytes, name: str, largest: int = LARGEST) -> Any:
    """
    Read one YAML document of plain values.

    Parameters
    ----------
    text : str or bytes
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
        It is too large, nested too deep, has aliases or tags, or is no YAML.
    """
    if len(text) > largest:
        raise ConfigError(f'{name}: larger than {largest} bytes')
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, OverflowError) as error:
        raise ConfigError(f'{name}: not YAML of plain values: '
                          f'{" ".join(str(error).split())[:200]}') from error
