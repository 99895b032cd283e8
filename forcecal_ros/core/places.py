"""What a path for results leads to, and whether anything may be written there.

A link is followed. What is neither file nor folder is never replaced: pipes and character devices
can be written to, all else is refused.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
from itertools import pairwise
import os
from pathlib import Path
import stat
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError

STANDARD_OUTPUT = Path('/proc/self/fd/1')

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says where there is no room."""

_LINKS = 40
"""As many links as Linux follows in one path."""


class Place(NamedTuple):
    """
    Where a path leads.

    Attributes
    ----------
    path : Path
        With links followed.
    exists : bool
    stream : bool
        It is a pipe or a character device.
    """

    path: Path
    exists: bool
    stream: bool


def follow(path: Path, *, folder: bool = False) -> Place:
    """
    Find out where a path leads.

    Raises
    ------
    ConfigError
        To what can be neither replaced nor written to, to a file where ``folder`` is False and a
        folder is there, or below ``share/forcecal_ros``.
    OSError
        Nobody can tell; Linux refuses links that others have planted in a common folder.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        mode = None
    place = Place(Path(os.path.realpath(path)), mode is not None, mode is not None and (
        stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)))
    for named in (path, place.path):
        _refuse_share_directory(named)
    if mode is not None and stat.S_ISDIR(mode) and not folder:
        raise ConfigError(f'{path} is a folder; name a file in it')
    if mode is not None and not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)) and (
            folder or not place.stream):
        raise ConfigError(f'{path} is neither file nor folder; name another place')
    return place


def _refuse_share_directory(path: Path) -> None:
    parts = path.absolute().parts
    if any(pair == ('share', 'forcecal_ros') for pair in pairwise(parts)):
        raise ConfigError(
            f'{path}: a package share directory is replaced at the next install; '
            'choose a folder of your own')


def descriptor_of(path: Path) -> int | None:
    """Return which open file of this process a path such as /dev/stdout means, None: no one."""
    own = Path('/proc/self/fd').resolve()
    for _ in range(_LINKS):
        if path.name.isdigit() and path.parent.resolve() == own:
            return int(path.name)
        if not path.is_symlink():
            return None
        path = path.parent / path.readlink()
    return None


def refuse_file(path: Path | str) -> None:
    """
    Refuse a place where no file could be written, before the work is done.

    Raises
    ------
    ConfigError
        As of :func:`follow`; or its folder does not exist, or is not the user's.
    """
    path = Path(path)
    with blamed(path):
        number = descriptor_of(path)
        if number is not None:
            os.fstat(number)
            return
        place = follow(path)
        if not place.stream:
            _try_folder(place.path.parent)
        elif not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def refuse_folder(path: Path | str, *, replaced: bool) -> None:
    """
    Refuse a place where no folder could be written, before the work is done.

    Parameters
    ----------
    replaced : bool
        Another folder takes the place of the one that is there; else files are written into it.

    Raises
    ------
    ConfigError
        As of :func:`refuse_file`; or the working folder or a mount point would be replaced.
    """
    path = Path(path)
    with blamed(path):
        place = follow(path, folder=True)
        if place.exists and not replaced:
            _try_folder(place.path)
            return
        working = Path.cwd()
        if place.path in (working, *working.parents) or os.path.ismount(place.path):
            raise ConfigError(f'{path}: neither the working folder nor a mount point can be '
                              'replaced; name a new folder in it')
        _try_folder(place.path.parent)


def _try_folder(folder: Path) -> None:
    """Make a file without a name in a folder: no look at its permissions says as much."""
    import tempfile

    if folder.exists() and not folder.is_dir():
        raise ConfigError(f'{folder} is no folder; name one')
    if not folder.is_dir():
        raise ConfigError(f'{folder} is no folder that exists; make it first')
    with tempfile.TemporaryFile(dir=folder):
        pass


def remedy(error: OSError, otherwise: str) -> str:
    """Say what to do about an error of the file system: make room, or something else."""
    return 'free some space' if error.errno in FULL else otherwise


@contextmanager
def blamed(path: Path) -> Iterator[None]:
    """Say in one line what could not be written, and why."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        do = remedy(error, 'choose a folder that exists and belongs to you')
        raise ConfigError(f'{path}: cannot be written ({error.strerror}); {do}') from error
