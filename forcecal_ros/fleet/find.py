"""What lies in a folder of many robots and nights, and whether it has changed since."""

from collections.abc import Iterable, Iterator
import os
from pathlib import Path
from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.fleet.entries import BAG, CALIBRATION, DIAGNOSIS

BEGINS = b'format: forcecal-calibration'
"""How every calibration.yaml begins."""

BAGS = ('.mcap', '.db3')

DERIVED = 'calibration_patched.yaml'
"""Written by a diagnosis, and no calibration of its own."""


class FleetFile(NamedTuple):
    """
    A file or recording.

    Attributes
    ----------
    kind, path : str
    folder : str
        First folder on the way from what was named, or that itself: the robot's name where
        nothing else says it.
    mark : str
        Names, sizes and times of its files: another one means that it has to be read again.
    """

    kind: str
    path: str
    folder: str
    mark: str


def find(places: Iterable[str], without: str, bags: bool) -> list[FleetFile]:
    """
    Find all calibrations, diagnoses and recordings.

    Parameters
    ----------
    places : iterable of str
        Folders, which are searched, or files and recordings.
    without : str
        Folder that is left out.
    bags : bool
        Whether recordings are wanted.

    Raises
    ------
    DataError
        A place is not there, or holds nothing of this kind.
    """
    found: dict[str, FleetFile] = {}
    for place in places:
        path = Path(os.path.realpath(place))
        if not path.exists():
            raise DataError(f'{place}: is not there; name a folder or file')
        here = [one for one in _in(path, Path(os.path.realpath(without)), path)
                if bags or one.kind != BAG]
        if not here:
            raise DataError(f'{place}: holds neither calibration.yaml nor diagnosis.json'
                            f'{" nor a recording" * bags}; name another folder')
        found.update({one.path: one for one in here})
    return sorted(found.values(), key=lambda one: one.path)


def _in(path: Path, without: Path, top: Path) -> Iterator[FleetFile]:
    if path == without or (path.name.startswith('.') and path != top) or path.name.endswith('~'):
        return
    if path.is_file():
        kind = _kind(path)
        if kind:
            yield _found(kind, path, top, [path])
        return
    try:
        inside = sorted(path.iterdir())
    except OSError as error:
        raise DataError(f'{path}: cannot be searched ({error.strerror})') from error
    parts = [one for one in inside if not {*BAGS}.isdisjoint(one.suffixes) and one.is_file()]
    if (path / 'metadata.yaml').exists():
        yield _found(BAG, path, top, [path / 'metadata.yaml', *parts])
        inside = [one for one in inside if one not in parts]
    for one in inside:
        if not one.is_symlink() or one.is_file():
            yield from _in(one, without, top)


def _kind(path: Path) -> str:
    if path.suffix in BAGS:
        return BAG
    if path.name == 'diagnosis.json':
        return DIAGNOSIS
    if path.suffix not in ('.yaml', '.yml') or path.name == DERIVED:
        return ''
    try:
        with path.open('rb') as file:
            return CALIBRATION if file.read(len(BEGINS)) == BEGINS else ''
    except OSError:
        return ''


def _found(kind: str, path: Path, top: Path, files: Iterable[Path]) -> FleetFile:
    below = path.relative_to(top).parts
    folder = top.name if top.is_dir() and top != path else path.parent.name
    marks = []
    for file in files:
        state = file.stat()
        marks.append(f'{file.name} {state.st_size} {state.st_mtime_ns}')
    return FleetFile(kind, str(path), below[0] if len(below) > 1 else folder, '; '.join(marks))
