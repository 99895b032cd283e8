"""Places that a command writes to: declared with its arguments, checked before any work."""

import argparse
from collections.abc import Iterable, Iterator
import os
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.cli.common import group, OUTPUT
from forcecal_ros.core.errors import ConfigError, UsageError
from forcecal_ros.core.files import descriptor_of, refuse_file, refuse_folder, STANDARD_OUTPUT

FILE, RESULTS, RECORDING = 'file', 'results', 'recording'
"""A file may be standard output; a folder of results is written into, a recording replaced."""


class Output(NamedTuple):
    """
    An argument that names a place to write to.

    Attributes
    ----------
    name, option : str
        In the parsed arguments, and as the user writes it.
    kind : str
        ``file``, ``results`` or ``recording``.
    suffix : str
        Follows a recording's name if results of many recordings go to one folder.
    """

    name: str
    option: str
    kind: str
    suffix: str = ''


def add_output(parser: argparse.ArgumentParser, *options: str, kind: str, suffix: str = '',
               **settings: Any) -> None:
    """Add an argument that names a place to write to."""
    action = group(parser, OUTPUT).add_argument(*options, **settings)
    declared = parser.get_default('outputs') or ()
    parser.set_defaults(outputs=(*declared, Output(action.dest, options[0], kind, suffix)))


def is_many(args: argparse.Namespace) -> bool:
    """Return whether results go to a folder, under the names of the recordings."""
    return isinstance(getattr(args, 'bag', ''), list) and not getattr(
        args, 'one_result', False) and (
        len(args.bag) > 1 or str(args.output or '').endswith('/'))


def check_outputs(args: argparse.Namespace) -> None:
    """
    Make sure that what a command will write can be written; ``-`` becomes standard output.

    Raises
    ------
    UsageError
        A place cannot be written to, or is one that the command reads.
    """
    taken: dict[Path, str] = {}
    for output in getattr(args, 'outputs', ()):
        value = getattr(args, output.name)
        if value is None:
            continue
        try:
            path = _check(args, output, value)
        except ConfigError as error:
            raise UsageError(f'{output.option}: {error}') from error
        if path in taken:
            raise UsageError(f'{taken[path]} and {output.option} both name {value}; '
                             f'give {output.option} another place')
        taken[path] = output.option


def _check(args: argparse.Namespace, output: Output, value: str) -> Path:
    """Return the place, links followed."""
    many = is_many(args)
    if not value:
        raise ConfigError('the name is empty; give one')
    if value == '-':
        if many or output.kind != FILE:
            raise ConfigError('standard output takes one file, this is a folder; name it')
        value = str(STANDARD_OUTPUT)
        setattr(args, output.name, value)
    if many:
        if output.suffix and value.endswith(output.suffix) and not Path(value).is_dir():
            raise ConfigError(f'of several {value} would be a folder; name one, as results/')
        refuse_folder(value, replaced=False)
    elif output.kind == FILE:
        refuse_file(value)
        if getattr(args, 'json', False) and is_stdout(value):
            raise ConfigError('standard output takes one document; leave --json out')
    else:
        if output.kind == RECORDING and Path(value).is_file():
            raise ConfigError(f'{value} is a file, a recording is a folder; name another place')
        refuse_folder(value, replaced=output.kind == RECORDING)
    if output.kind != RESULTS and not many:
        refuse_inputs(value, output.kind, _inputs(args))
    return Path(os.path.realpath(value))


def refuse_inputs(place: str, kind: str, inputs: Iterable[str]) -> None:
    """Raise ConfigError if ``place`` is one of ``inputs``, holds one, or is part of one."""
    path = Path(os.path.realpath(place))
    part = path.name == 'metadata.yaml' or not {'.mcap', '.db3'}.isdisjoint(path.suffixes)
    for name in inputs:
        source = Path(os.path.realpath(name))
        if path in (source, *(source.parents if kind == RECORDING else ())) or (
                source in path.parents and part):
            raise ConfigError(f'{place} would take the place of {name}, which is read; name '
                              f'another {"folder" if kind == RECORDING else "file"}')


def is_stdout(value: str | None) -> bool:
    """Return whether a file goes where results are printed."""
    return value is not None and descriptor_of(Path(value)) == 1


def stdout_is_taken(args: argparse.Namespace) -> bool:
    """Return whether a file goes to standard output."""
    return any(o.kind == FILE and is_stdout(getattr(args, o.name))
               for o in getattr(args, 'outputs', ()))


def _inputs(args: argparse.Namespace) -> Iterator[str]:
    for name in getattr(args, 'inputs', ()):
        value = getattr(args, name)
        if value:
            yield from [value] if isinstance(value, str) else value
