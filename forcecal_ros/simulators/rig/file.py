"""The rig file: YAML in, a checked :class:`~forcecal_ros.effects.rig.Rig` out, and back."""

from collections.abc import Iterator
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from types import UnionType
import typing
from typing import Any

from forcecal_ros.effects.chosen import Chosen, chosen_effects, named_effects
from forcecal_ros.effects.library import EFFECTS
from forcecal_ros.effects.quantity import checked
from forcecal_ros.effects.rig import Rig, Section
from forcecal_ros.errors import ConfigError
from forcecal_ros.safe_yaml import LARGEST, load_yaml
import yaml

_COLUMN = 46


def load_rig(path: Path | str | None = None) -> Rig:
    """
    Read and check a rig file.

    Parameters
    ----------
    path : Path or str, optional
        The nominal rig of this package where none is given. A bare name of a file that is not
        there is looked for among the rigs of this package (``rig.yaml``, ``rigid_tool.yaml``).

    Returns
    -------
    Rig

    Raises
    ------
    ConfigError
        The file is missing or no YAML; a key is missing, unknown, or its value is wrong.
    """
    source = 'rig.yaml' if path is None else str(path)
    packaged = files('forcecal_ros') / 'config' / source
    take_packaged = path is None or (
        Path(source).name == source and not Path(source).exists() and packaged.is_file())
    try:
        with (packaged if take_packaged else Path(source)).open('rb') as file:
            document = load_yaml(file.read(LARGEST + 1), source)
    except OSError as error:
        raise ConfigError(f'{source}: cannot be read ({error.strerror}); give the path of a rig '
                          'file, or none for the nominal rig') from error
    try:
        rig: Rig = _section(Rig, document, '')
    except ConfigError as error:
        raise ConfigError(f'{source}: {error}') from None
    return rig


def _section(section: type[Section], document: Any, path: str) -> Any:
    names = [f.name for f in fields(section)]
    where = path or 'a rig'
    if not isinstance(document, dict):
        raise ConfigError(f'{where}: expected the keys {", ".join(names)}, got {document!r}; '
                          'compare with config/rig.yaml')
    unknown = [str(key) for key in document if key not in names]
    if unknown:
        raise ConfigError(f'{where}: unknown key {", ".join(unknown)}; expected only '
                          f'{", ".join(names)}: remove or rename it')
    missing = [name for name in names if name not in document and name != 'effects']
    if missing:
        raise ConfigError(f'{where}: missing key {", ".join(missing)}; copy it from '
                          'config/rig.yaml')
    types = typing.get_type_hints(section)
    values: dict[str, Any] = {}
    for f in fields(section):
        key, value = f'{path}.{f.name}'.lstrip('.'), document.get(f.name)
        kind = types[f.name]
        if f.name == 'effects':
            values[f.name] = chosen_effects(value)
        elif f.metadata:
            values[f.name] = checked(key, value, f.metadata)
        elif isinstance(kind, UnionType):
            optional = typing.get_args(kind)[0]
            values[f.name] = None if value is None else _section(optional, value, key)
        else:
            values[f.name] = _section(kind, value, key)
    return section(**values)


def dump_rig(rig: Rig) -> str:
    """
    Write a rig as the text of a rig file, each number with its unit as comment.

    Parameters
    ----------
    rig : Rig

    Returns
    -------
    str
        YAML that :func:`load_rig` reads back to an equal rig.
    """
    return '\n'.join(_lines(rig, '')) + '\n'


def _lines(section: Section, indent: str) -> Iterator[str]:
    for f in fields(section):
        value = getattr(section, f.name)
        if f.name == 'effects':
            yield from _effect_lines(value)
            continue
        if not f.metadata:
            summary = (type(value).__doc__ or '').split('\n')[0]
            yield f'{indent}{f.name}:' + (' null' if value is None else f'  # {summary}')
            if value is not None:
                yield from _lines(value, indent + '  ')
            continue
        note = ', '.join(filter(None, (f.metadata.get('unit'), f.metadata['note'])))
        yield f'{indent}{f.name}: {_number(value)}'.ljust(_COLUMN) + f' # {note}'


def _effect_lines(chosen: Chosen) -> Iterator[str]:
    if chosen:
        yield 'effects:  # In what the rig differs from the numbers above.'
    for name, values in named_effects(chosen).items():
        effect = EFFECTS[name]
        yield f'  {name}:  # {effect.stage}'
        for q in effect.parameters:
            yield f'    {q.name}: {_number(values[q.name])}'.ljust(_COLUMN) + f' # {q.unit}'


def _number(value: Any) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(map(_number, value))}]'
    return yaml.safe_dump(value).removesuffix('...\n').strip()
