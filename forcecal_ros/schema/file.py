"""A YAML file that is one section: opened, read and checked, with one line where that fails."""

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from forcecal_ros.errors import ConfigError
from forcecal_ros.safe_yaml import LARGEST, load_yaml
from forcecal_ros.schema.row import shown
from forcecal_ros.schema.sections import read

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
    :func:`~forcecal_ros.schema.sections.read`.

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
        raise ConfigError(f'{name}: cannot be read ({error.strerror}); {remedy}') from error
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
