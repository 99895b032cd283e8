"""Files that are either the old one or the new one, whole: nothing is ever half written."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import tempfile

from forcecal_ros.errors import ConfigError


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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
                dir=path.parent, prefix=f'.{path.name}.', delete=False) as file:
            temporary = Path(file.name)
            try:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
                if backup and path.exists():
                    shutil.copy2(path, path.with_name(path.name + '~'))
                temporary.chmod(0o644)
                temporary.replace(path)
            except BaseException:
                temporary.unlink(missing_ok=True)
                raise
        _sync_directory(path.parent)
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror}); choose a folder '
                          'that exists and belongs to you') from error


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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        holder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}.'))
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror}); choose a folder '
                          'that exists and belongs to you') from error
    try:
        scratch = holder / path.name
        yield scratch
        for file in scratch.rglob('*'):
            if file.is_file():
                with file.open('rb') as handle:
                    os.fsync(handle.fileno())
        if path.exists():
            kept = path.with_name(path.name + '~')
            if kept.is_dir():
                shutil.rmtree(kept)
            else:
                kept.unlink(missing_ok=True)
            path.rename(kept)
        scratch.rename(path)
        _sync_directory(path.parent)
    finally:
        shutil.rmtree(holder, ignore_errors=True)
