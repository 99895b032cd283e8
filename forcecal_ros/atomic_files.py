"""Files that are either the old one or the new one, whole: nothing is ever half written."""

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import errno
import os
from pathlib import Path
import shutil
import tempfile

from forcecal_ros.errors import ConfigError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of Linux."""


def _sync_file(path: Path) -> None:
    with path.open('rb') as handle:
        os.fsync(handle.fileno())


def _sync_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def refuse_share_directory(path: Path) -> None:
    """
    Refuse a place inside an installed package's share directory.

    Raises
    ------
    ConfigError
        ``path`` lies below ``share/forcecal_ros``.
    """
    parts = path.absolute().parts
    if any(pair == ('share', 'forcecal_ros') for pair in zip(parts, parts[1:])):
        raise ConfigError(
            f'{path}: a package share directory is replaced at the next install; '
            'choose a folder of your own')


def write_text(path: Path | str, text: str, *, backup: bool = True) -> None:
    """
    Replace a text file atomically and durably.

    Parameters
    ----------
    path : Path or str
        Its folder is made where it is missing.
    text : str
    backup : bool
        Keep what was there before as ``path~``.

    Raises
    ------
    ConfigError
        The place is a package's share directory, or cannot be written to.
    """
    write_bytes(path, text.encode(), backup=backup)


def write_bytes(path: Path | str, data: bytes, *, backup: bool = True) -> None:
    """
    Replace a file atomically and durably; see :func:`write_text`.

    Raises
    ------
    ConfigError
        The place is a package's share directory, or cannot be written to.
    """
    path = Path(path)
    refuse_share_directory(path)
    with _blamed(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
                dir=path.parent, prefix=f'.{path.name}.', delete=False) as file:
            temporary = Path(file.name)
            try:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
                if backup and path.exists():
                    _keep(path)
                temporary.chmod(0o644)
                temporary.replace(path)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        _sync_directory(path.parent)


@contextmanager
def _blamed(path: Path) -> Iterator[None]:
    """Say in one line what could not be written, and why."""
    try:
        yield
    except OSError as error:
        remedy = ('free some space' if error.errno in _FULL
                  else 'choose a folder that exists and belongs to you')
        raise ConfigError(f'{path}: cannot be written ({error.strerror}); {remedy}') from error


def _keep(path: Path) -> None:
    """Keep a file as ``path~``, which is at any time the backup before or this one, whole."""
    holder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}.'))
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
    refuse_share_directory(path)
    with _blamed(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        holder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}.'))
    try:
        scratch = holder / path.name
        yield scratch
        with _blamed(path):
            for file in (*scratch.rglob('*'), scratch):
                if file.is_file():
                    _sync_file(file)
                else:
                    _sync_directory(file)
            _take_place(scratch, path)
            _sync_directory(path.parent)
    finally:
        shutil.rmtree(holder, ignore_errors=True)


def _take_place(scratch: Path, path: Path) -> None:
    """Put a folder where another may be, which is kept as ``path~``."""
    if not os.path.lexists(path):
        scratch.rename(path)
        return
    exchanged = _exchange(scratch, path)
    kept = backup_of(path)
    if kept.is_dir() and not kept.is_symlink():
        shutil.rmtree(kept)
    else:
        kept.unlink(missing_ok=True)
    if exchanged:
        scratch.rename(kept)
    else:
        path.rename(kept)
        scratch.rename(path)


def _exchange(one: Path, other: Path) -> bool:
    """Let two paths change places in one step; False where the system cannot."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    return bool(rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)
