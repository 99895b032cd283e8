"""Where a command writes: declared with its arguments, checked before any work, owned by a run."""

import argparse
from collections.abc import Iterable, Iterator, Mapping
import os
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.core.errors import ConfigError, UsageError
from forcecal_ros.core.files import descriptor_of, refuse_file, refuse_folder, STANDARD_OUTPUT

FILE, RESULTS, RECORDING = 'file', 'results', 'recording'
"""A file may be standard output; a folder of results is written into, a recording replaced."""

STDOUT = 1


class Output(NamedTuple):
    """
    An argument that names a place to write to.

    Attributes
    ----------
    name : str
        In the parsed arguments.
    option : str
        As the user writes it.
    kind : str
        ``file``, ``results`` or ``recording``.
    suffix : str
        Follows a recording's name where results of many recordings go to one folder.
    """

    name: str
    option: str
    kind: str
    suffix: str = ''


def add_output(parser: argparse.ArgumentParser, *options: str, kind: str, suffix: str = '',
               **settings: Any) -> None:
    """Add an argument that names a place to write to."""
    action = parser.add_argument(*options, **settings)
    declared = parser.get_default('outputs') or ()
    parser.set_defaults(outputs=(*declared, Output(action.dest, options[0], kind, suffix)))


def of_many(args: argparse.Namespace) -> bool:
    """Tell whether results go to a folder, under the names of the recordings."""
    return isinstance(getattr(args, 'bag', ''), list) and (
        len(args.bag) > 1 or args.output.endswith('/'))


def check_outputs(args: argparse.Namespace) -> None:
    """
    Make sure that what a command will write can be written; ``-`` becomes standard output.

    Raises
    ------
    UsageError
        A place cannot be written to, or would take the place of what the command reads.
    """
    taken: dict[Path, str] = {}
    for output in getattr(args, 'outputs', ()):
        value = getattr(args, output.name)
        if value is None:
            continue
        try:
            path = _checked(args, output, value)
        except ConfigError as error:
            raise UsageError(f'{output.option}: {error}') from error
        if path in taken:
            raise UsageError(f'{taken[path]} and {output.option} both name {value}; '
                             f'give {output.option} another place')
        taken[path] = output.option


def _checked(args: argparse.Namespace, output: Output, value: str) -> Path:
    """Return the place, links followed."""
    many = of_many(args)
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
        if _as_json(args) and is_stdout(value):
            raise ConfigError('standard output takes one document; leave --json out')
    else:
        if output.kind == RECORDING and Path(value).is_file():
            raise ConfigError(f'{value} is a file, a recording is a folder; name another place')
        refuse_folder(value, replaced=output.kind == RECORDING)
    if output.kind != RESULTS and not many:
        refuse_inputs(value, output.kind, _inputs(args))
    return Path(os.path.realpath(value))


def refuse_inputs(place: str, kind: str, inputs: Iterable[str]) -> None:
    """
    Refuse to write over what is read.

    Parameters
    ----------
    kind : str
        ``file`` or ``recording``.

    Raises
    ------
    ConfigError
        ``place`` is one of ``inputs``, holds one, or is part of one.
    """
    path = Path(os.path.realpath(place))
    for name in inputs:
        read = Path(os.path.realpath(name))
        if path in (read, *(read.parents if kind == RECORDING else ())) or (
                read in path.parents and _of_recording(path)):
            another = 'folder' if kind == RECORDING else 'file'
            raise ConfigError(f'{place} would take the place of {name}, which is read; '
                              f'name another {another}')


def _of_recording(path: Path) -> bool:
    return path.name == 'metadata.yaml' or not {'.mcap', '.db3'}.isdisjoint(path.suffixes)


def _as_json(args: argparse.Namespace) -> bool:
    """Tell whether the result is printed as JSON."""
    return bool(getattr(args, 'json', False))


def is_stdout(value: str | None) -> bool:
    """Tell whether a file is to go where results are printed."""
    return value is not None and descriptor_of(Path(value)) == STDOUT


def stdout_is_taken(args: argparse.Namespace) -> bool:
    """Tell whether standard output is taken by a file."""
    return any(o.kind == FILE and is_stdout(getattr(args, o.name))
               for o in getattr(args, 'outputs', ()))


def _inputs(args: argparse.Namespace) -> Iterator[str]:
    for name in getattr(args, 'inputs', ()):
        value = getattr(args, name)
        if value:
            yield from [value] if isinstance(value, str) else value


def write_results(folder: Path | str, files: Mapping[str, str | bytes],
                  may_have: Iterable[str] = ()) -> None:
    """
    Write the files of a run, and set aside what an earlier run wrote and this one did not.

    Parameters
    ----------
    files : mapping of str to str or bytes
        Path in the folder -> contents.
    may_have : iterable of str
        Patterns of all that runs of the command may write; of these a file that is no part of
        ``files`` is renamed to NAME~, since it would contradict them.
    """
    from forcecal_ros.core.files import make_folder, set_aside, write_bytes

    folder = Path(folder)
    make_folder(folder)
    for old in sorted({path for pattern in may_have for path in folder.glob(pattern)}):
        if old.is_file() and str(old.relative_to(folder)) not in files:
            set_aside(old)
    for name, content in files.items():
        path = folder / name
        make_folder(path.parent)
        write_bytes(path, content.encode() if isinstance(content, str) else content)
