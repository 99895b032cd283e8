"""Files that are either the old one or the new one, whole: nothing is ever half written.

A link is written through: what it leads to is replaced, and the link stays.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import os
from pathlib import Path
import shutil
import sys
import tempfile

from forcecal_ros.core.places import blamed, descriptor_of, follow, refuse_folder

_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux."""


_LEGIBLE = 50
"""Letters of a name that tell what it was: four bytes each at most, of the 255 of Linux."""


def _sync_file(path: Path) -> None:
    with path.open('rb') as handle:
        os.fsync(handle.fileno())


def _sync_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path | str, text: str) -> None:
    """Replace a text file atomically and durably; see :func:`write_bytes`."""
    write_bytes(path, text.encode())


def write_bytes(path: Path | str, data: bytes) -> None:
    """
    Replace a file atomically and durably, or write to a pipe or character device.

    What a file held before is kept as ``path~``, beside the file where ``path`` is a link to it.

    Raises
    ------
    ConfigError
        The place is a package's share directory, or cannot be written to.
    """
    path = Path(path)
    with blamed(path):
        number = descriptor_of(path)
        if number is not None:
            sys.stdout.flush()
            _write_all(number, data)
            return
        place = follow(path)
        if place.stream:
            stream = os.open(path, os.O_WRONLY | os.O_NOCTTY)
            try:
                _write_all(stream, data)
            finally:
                os.close(stream)
        else:
            _replace(place.path, data)


def _write_all(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view):]


def _replace(path: Path, data: bytes) -> None:
    with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=_hidden(path), delete=False) as file:
        temporary = Path(file.name)
        try:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            if path.exists():
                _keep(path)
            temporary.chmod(0o644)
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    _sync_directory(path.parent)


def _hidden(path: Path) -> str:
    """Return how what is not yet ready is called: no longer than a long name may be."""
    return f'.{path.name[:_LEGIBLE]}.'


def _keep(path: Path) -> None:
    """Keep a file as ``path~``, which is at any time the backup before or this one, whole."""
    holder = Path(tempfile.mkdtemp(dir=path.parent, prefix=_hidden(path)))
    try:
        kept = holder / path.name
        try:
            os.link(path, kept)
        except OSError:  # a file system without links
            shutil.copy2(path, kept)
            _sync_file(kept)
        kept.replace(backup_of(path))
    finally:
        shutil.rmtree(holder, ignore_errors=True)


def make_folder(path: Path | str) -> None:
    """
    Make sure that there is a folder, in one that exists.

    Raises
    ------
    ConfigError
        It cannot be made.
    """
    path = Path(path)
    with blamed(path):
        path.mkdir(exist_ok=True)


def set_aside(path: Path) -> None:
    """
    Rename a file or folder to what its backup is called.

    Raises
    ------
    ConfigError
        It cannot be renamed.
    """
    with blamed(path):
        if path.is_dir() and not path.is_symlink():
            path.rename(_make_room(backup_of(path), _names(path)))
        else:
            path.replace(backup_of(path))


def backup_of(path: Path) -> Path:
    """Return where the predecessor of a file or folder is kept."""
    return path.with_name(path.name + '~')


@contextmanager
def new_directory(path: Path | str) -> Iterator[Path]:
    """
    Give a scratch folder that takes the place of ``path`` once the block ends without error.

    What was at ``path`` before is kept as ``path~``; after an error it is untouched.

    Yields
    ------
    Path
        A folder beside ``path`` that does not exist yet, for writers that make their own.

    Raises
    ------
    ConfigError
        The place is a package's share directory, or cannot be written to.
    """
    path = Path(path)
    refuse_folder(path, replaced=True)
    with blamed(path):
        target = follow(path, folder=True).path
        holder = Path(tempfile.mkdtemp(dir=target.parent, prefix=_hidden(target)))
    try:
        scratch = holder / target.name
        yield scratch
        with blamed(path):
            for file in (*scratch.rglob('*'), scratch):
                if file.is_file():
                    _sync_file(file)
                else:
                    _sync_directory(file)
            _take_place(scratch, target)
            _sync_directory(target.parent)
    finally:
        shutil.rmtree(holder, ignore_errors=True)


def _take_place(scratch: Path, path: Path) -> None:
    """Put a folder where another may be, which is kept as ``path~``."""
    if not os.path.lexists(path):
        scratch.rename(path)
        return
    names = _names(scratch)
    exchanged = _exchange(scratch, path)
    kept = _make_room(backup_of(path), names)
    if exchanged:
        scratch.rename(kept)
    else:
        path.rename(kept)
        scratch.rename(path)


def _make_room(kept: Path, names: set[Path]) -> Path:
    """
    Free the name of a backup; one with other files than the results has is no run's to delete.

    Returns
    -------
    Path
        ``kept``, or the first of ``kept2``, ``kept3``, ... that is free or may be deleted.
    """
    number, place = 1, kept
    while os.path.lexists(place):
        if place.is_symlink() or not place.is_dir():
            place.unlink()
        elif _names(place) <= names:
            shutil.rmtree(place)
        else:
            number += 1
            place = kept.with_name(f'{kept.name}{number}')
    return place


def _names(folder: Path) -> set[Path]:
    return {file.relative_to(folder) for file in folder.rglob('*')}


def _exchange(one: Path, other: Path) -> bool:
    """Let two paths change places in one step; False where the system cannot."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    return bool(rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)
