"""
Files and folders that are written whole or not at all; what was there is kept as ``NAME~``.

A link is followed: its target is replaced, and the link stays. Pipes, character devices and open
descriptors such as /dev/stdout are written to. Anything else that is neither file nor folder is
refused.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
import errno
from itertools import pairwise
import os
from pathlib import Path
import shutil
import stat
import sys
import tempfile

from forcecal_ros.core.errors import ConfigError

STANDARD_OUTPUT = Path('/proc/self/fd/1')


def write_text(path: Path | str, text: str) -> None:
    """Replace a text file; see :func:`write_bytes`."""
    write_bytes(path, text.encode())


def write_bytes(path: Path | str, data: bytes) -> None:
    """
    Replace a file at once and durably, or write to a pipe, device or open descriptor.

    Raises
    ------
    ConfigError
        The path is in a package's share directory, or cannot be written to.
    """
    path = Path(path)
    with naming(path):
        number = descriptor_of(path)
        target, stream = (path, True) if number is not None else target_of(path)
        if stream:
            sys.stdout.flush()
            opened = os.open(path, os.O_WRONLY | os.O_NOCTTY) if number is None else number
            with open(opened, 'wb', closefd=number is None) as file:
                file.write(data)
            return
        with _scratch_beside(target) as scratch:
            scratch.write_bytes(data)
            _take_place(scratch, target)


@contextmanager
def new_directory(path: Path | str) -> Iterator[Path]:
    """
    Yield a path for a new folder that takes the place of ``path`` if the block succeeds.

    The folder does not exist yet, for writers that make their own. After an error ``path`` is
    untouched. A process that is killed between the two renames leaves the old folder as NAME~.

    Raises
    ------
    ConfigError
        The path is in a package's share directory, or cannot be written to.
    """
    path = Path(path)
    refuse_folder(path, replaced=True)
    with naming(path):
        target, _ = target_of(path, folder=True)
    with _scratch_beside(target, path) as scratch:
        yield scratch
        with naming(path):
            _take_place(scratch, target)


def write_results(folder: Path | str, files: Mapping[str, str | bytes],
                  may_have: Iterable[str] = ()) -> None:
    """
    Write the files of a run, and set aside what an earlier run wrote and this one did not.

    Parameters
    ----------
    files : mapping of str to str or bytes
        Path in the folder -> contents.
    may_have : iterable of str
        Patterns of all files that the command may write. An existing one that is not in ``files``
        would contradict them, and is renamed to NAME~.
    """
    folder = Path(folder)
    make_folder(folder)
    for old in sorted({path for pattern in may_have for path in folder.glob(pattern)}):
        if old.is_file() and str(old.relative_to(folder)) not in files:
            set_aside(old)
    for name, content in files.items():
        make_folder((folder / name).parent)
        write_bytes(folder / name, content.encode() if isinstance(content, str) else content)


def make_folder(path: Path | str) -> None:
    """Make sure that a folder exists; raise ConfigError if it cannot be made."""
    with naming(Path(path)):
        Path(path).mkdir(exist_ok=True)


def backup_of(path: Path) -> Path:
    """Return where the predecessor of a file or folder is kept."""
    return path.with_name(path.name + '~')


def set_aside(path: Path) -> None:
    """Rename a file or folder to its backup; raise ConfigError if it cannot be renamed."""
    with naming(path):
        if path.is_dir() and not path.is_symlink():
            path.rename(_free_backup(path, _names_in(path)))
        else:
            path.replace(backup_of(path))


def refuse_file(path: Path | str) -> None:
    """Raise ConfigError if no file could be written to a path, before the work is done."""
    path = Path(path)
    with naming(path):
        number = descriptor_of(path)
        if number is not None:
            os.fstat(number)
            return
        target, stream = target_of(path)
        if not stream:
            _try_folder(target.parent)
        elif not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def refuse_folder(path: Path | str, *, replaced: bool) -> None:
    """
    Raise ConfigError if no folder could be written to a path, before the work is done.

    Parameters
    ----------
    replaced : bool
        The folder takes the place of an existing one; else files are written into it. Neither the
        working folder nor a mount point can be replaced.
    """
    path = Path(path)
    with naming(path):
        target, _ = target_of(path, folder=True)
        if target.exists() and not replaced:
            _try_folder(target)
            return
        if target in (Path.cwd(), *Path.cwd().parents) or os.path.ismount(target):
            raise ConfigError(f'{path}: neither the working folder nor a mount point can be '
                              'replaced; choose a new folder in it')
        _try_folder(target.parent)


def target_of(path: Path, *, folder: bool = False) -> tuple[Path, bool]:
    """
    Return where a path leads, links followed, and whether it is a pipe or character device.

    Raises
    ------
    ConfigError
        It can be neither replaced nor written to, is a folder although ``folder`` is False, or is
        below ``share/forcecal_ros``.
    """
    mode = 0
    with suppress(FileNotFoundError):
        mode = path.stat().st_mode
    target = Path(os.path.realpath(path))
    if any(('share', 'forcecal_ros') in pairwise(one.parts) for one in (path.absolute(), target)):
        raise ConfigError(f'{path}: a package share directory is replaced at the next install; '
                          'choose another folder')
    stream = stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)
    if stat.S_ISDIR(mode) and not folder:
        raise ConfigError(f'{path} is a folder; choose a file in it')
    if mode and not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)) and (folder or not stream):
        raise ConfigError(f'{path} is neither a file nor a folder; choose another path')
    return target, stream


def descriptor_of(path: Path) -> int | None:
    """Return the number of the open file that a path such as /dev/stdout means, or None."""
    own = Path('/proc/self/fd').resolve()
    for _ in range(40):
        if path.name.isdigit() and path.parent.resolve() == own:
            return int(path.name)
        if not path.is_symlink():
            return None
        path = path.parent / path.readlink()
    return None


def remedy(error: OSError, otherwise: str) -> str:
    """Return what to do about an error of the file system: make room, or something else."""
    full = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    return 'free some space' if error.errno in full else otherwise


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Turn an error of the file system into a ConfigError with the path, the cause and a fix."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        do = remedy(error, 'choose an existing, writable folder')
        raise ConfigError(f'{path}: cannot be written ({error.strerror}); {do}') from error


@contextmanager
def _scratch_beside(target: Path, path: Path | None = None) -> Iterator[Path]:
    """Yield a path in a hidden folder next to the target, which is removed at the end."""
    with naming(path or target):  # 50 letters: at most 200 of the 255 bytes of a name
        holder = Path(tempfile.mkdtemp(dir=target.parent, prefix=f'.{target.name[:50]}.'))
    try:
        yield holder / target.name
    finally:
        shutil.rmtree(holder, ignore_errors=True)


def _take_place(scratch: Path, target: Path) -> None:
    """Put a finished file or folder in its place, and keep the old one as its backup."""
    for one in (*scratch.rglob('*'), scratch):
        _sync(one)
    if target.is_dir():
        target.rename(_free_backup(target, _names_in(scratch)))
    elif target.exists():
        kept = scratch.with_name('kept')
        try:
            os.link(target, kept)
        except OSError:  # a file system without links
            shutil.copy2(target, kept)
            _sync(kept)
        kept.replace(backup_of(target))
    scratch.replace(target)
    _sync(target.parent)


def _free_backup(path: Path, names: set[Path]) -> Path:
    """Return a free NAME~, NAME~2, ...: a backup with other files than ``names`` is kept."""
    number, place = 1, backup_of(path)
    while os.path.lexists(place):
        if place.is_symlink() or not place.is_dir():
            place.unlink()
        elif _names_in(place) <= names:
            shutil.rmtree(place)
        else:
            number += 1
            place = path.with_name(f'{path.name}~{number}')
    return place


def _names_in(folder: Path) -> set[Path]:
    return {file.relative_to(folder) for file in folder.rglob('*')}


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _try_folder(folder: Path) -> None:
    """Make an unnamed file in a folder: permissions alone do not show that this works."""
    if not folder.is_dir():
        raise ConfigError(f'{folder} is not an existing folder; create it first')
    with tempfile.TemporaryFile(dir=folder):
        pass
