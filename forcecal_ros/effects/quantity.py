"""One number, vector or word of a rig file: its unit, shape and limits, and their check."""

from collections.abc import Mapping
import math
from typing import Any

from forcecal_ros.errors import ConfigError
import numpy as np

Metadata = Mapping[str, Any]

def quantity(unit: str, note: str = '', shape: tuple[int, ...] = (), *,
             positive: bool = False, least: float = -math.inf) -> Metadata:
    """Describe a field that holds numbers of one unit in one shape, within limits."""
    return {'unit': unit, 'note': note, 'shape': shape, 'positive': positive, 'least': least}


def choice(note: str, words: tuple[str, ...]) -> Metadata:
    """Describe a field that holds one of some words."""
    return {'note': note, 'words': words}


def _expected(unit: str, shape: tuple[int, ...]) -> str:
    what = {(): 'a number', (3, 3): '3 rows of 3 numbers'}
    return f'{what.get(shape) or f"a list of {shape[0]} numbers"} [{unit}]'


def _tuples(values: Any) -> Any:
    return tuple(map(_tuples, values)) if isinstance(values, list) else values


def _all_numbers(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_all_numbers, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def checked(name: str, value: Any, metadata: Metadata) -> Any:
    """
    Check one value against its field's metadata.

    Parameters
    ----------
    name : str
        The key to name in an error.
    value : object
        A number, a (nested) list, tuple or array of numbers, or a word.
    metadata : mapping
        Of the dataclass field, from :func:`quantity` or :func:`choice`.

    Returns
    -------
    float, str or (nested) tuple of float

    Raises
    ------
    ConfigError
        Wrong type or shape, not finite, outside its limits.
    """
    if 'words' in metadata:
        if value not in metadata['words']:
            raise ConfigError(f'{name}: expected one of {", ".join(metadata["words"])}, '
                              f'got {value!r}; write one of these')
        return value
    shape = metadata['shape']
    expected = _expected(metadata['unit'], shape)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if not _all_numbers(value):
        hint = ('; YAML reads an exponent as a number only with a dot and a sign, as in 2.0e-5'
                if isinstance(value, str) and 'e' in value.lower() else '; write it so')
        raise ConfigError(f'{name}: expected {expected}, got {value!r}{hint}')
    try:
        array = np.array(value, dtype=float)
    except (ValueError, OverflowError):
        raise ConfigError(f'{name}: expected {expected}, got {value!r}; '
                          'make the rows equally long and the numbers finite') from None
    if array.shape != shape:
        raise ConfigError(f'{name}: expected {expected}, got {value!r}; write it in this shape')
    if not np.isfinite(array).all():
        raise ConfigError(f'{name}: expected {expected}, got {value!r}; '
                          'every number must be finite')
    if metadata['positive'] and (array <= 0).any():
        raise ConfigError(f'{name}: must be above 0 [{metadata["unit"]}], got {value!r}')
    if (array < metadata['least']).any():
        raise ConfigError(f'{name}: must be at least {metadata["least"]:g} '
                          f'[{metadata["unit"]}], got {value!r}')
    return _tuples(array.tolist())
