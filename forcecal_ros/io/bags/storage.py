"""Find the files of a recording, in any storage, and hand out their messages."""

from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
import tempfile
from types import TracebackType

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.safe_yaml import LARGEST, load_yaml
from forcecal_ros.core.topics import Topic
from forcecal_ros.io.bags import files
from forcecal_ros.io.bags.files import Batch, DAMAGE, McapFile, Notes, SqliteFile, zstd
from rosbags.typesys import get_types_from_msg, get_typestore, Stores, TypesysError
from rosbags.typesys.store import Typestore

_SQLITE_MAGIC = b'SQLite format 3\0'
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


class Bag:
    """
    A recording opened for reading; use it as a context.

    Any error that a decoder raises over damaged bytes within that context becomes a DataError, so
    that no reader has to know what rosbags, NumPy, SQLite, zstd or lz4 raise.

    Attributes
    ----------
    notes : Notes
        What had to be left out or corrected so far.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.notes = Notes()
        self.topics: tuple[Topic, ...] = ()
        self._files: list[McapFile | SqliteFile] = []
        self._stack = ExitStack()

    def __enter__(self) -> 'Bag':
        problems = []
        for file in self._find_files():
            try:
                self._files.append(self._open(file))
            except DataError as error:
                problems.append(str(error))
            except DAMAGE as error:
                problems.append(_damaged(file, error))
        if not self._files:
            self._stack.close()
            raise DataError(problems[0] if problems else f'{self.path}: no recording found '
                            '(*.mcap, *.db3); pass the folder of a rosbag2 recording')
        for problem in problems:
            self.notes.add(problem)
        self.topics = tuple(dict.fromkeys(
            topic for file in self._files for topic in file.topics.values()))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stack.close()
        if isinstance(error, DAMAGE):
            raise DataError(_damaged(self.path, error)) from error

    def batches(self, topics: set[Topic]) -> Iterator[Batch]:
        """Yield the messages of some topics, some thousands at a time, file after file."""
        for file in self._files:
            self.notes.ends_early = False
            try:
                for batch in file.batches(topics):
                    yield self._decompressed(batch)
            except DAMAGE as error:
                self.notes.ends_early = True
                self.notes.add(f'{self.path}: a file is damaged ({files.in_a_line(error)}); '
                               'everything before the damage was read')

    def typestore(self) -> Typestore:
        """Return the types of ROS 2 Jazzy, and those only this recording defines."""
        store = get_typestore(Stores.ROS2_JAZZY)
        for topic in self.topics:
            if topic.type in store.fielddefs or not topic.definition:
                continue
            try:
                found = get_types_from_msg(topic.definition, topic.type)
                store.register({name: fields for name, fields in found.items()
                                if name not in store.fielddefs})
            except (TypesysError, *DAMAGE):
                self.notes.add(f'{topic.name}: the definition of {topic.type} is damaged')
        return store

    def _find_files(self) -> list[Path]:
        if not self.path.exists():
            raise DataError(f'{self.path} does not exist; pass a rosbag2 folder or file')
        if self.path.is_file():
            return [self.path]
        found = sorted(file for file in self.path.iterdir() if file.is_file() and (
            {'.mcap', '.db3'} & set(file.suffixes[-2:])))
        if missing := sorted(self._metadata() - {file.name for file in found}):
            self.notes.add(f'files are missing: {", ".join(missing)}')
        return found

    def _metadata(self) -> set[str]:
        """Return the names of the files that metadata.yaml lists."""
        path = self.path / 'metadata.yaml'
        try:
            with path.open('rb') as file:
                document = load_yaml(file.read(LARGEST + 1), str(path))
            listed = document['rosbag2_bagfile_information']['relative_file_paths']
            return {Path(name).name for name in listed}
        except FileNotFoundError:
            self.notes.add('metadata.yaml is missing; all files in the folder were read')
        except (ConfigError, *DAMAGE):
            self.notes.add('metadata.yaml is damaged; all files in the folder were read')
        return set()

    def _open(self, path: Path) -> McapFile | SqliteFile:
        magic = _beginning(path)
        if magic.startswith(_ZSTD_MAGIC):
            path = self._unpacked(path)
            magic = _beginning(path)
        if magic.startswith(files.MAGIC):
            return McapFile(path, self.notes)
        if magic == _SQLITE_MAGIC:
            file = SqliteFile(path, self.notes)
            self._stack.callback(file.close)
            return file
        raise DataError(
            f'{path} is empty: nothing was recorded' if not magic else
            f'{path} is a ROS 1 bag; convert it to a ROS 2 bag with `rosbags-convert`'
            if magic.startswith(b'#ROSBAG') else
            f'{path} is not a recording (neither MCAP nor SQLite), or its beginning is damaged; '
            'pass a rosbag2 folder or file')

    def _unpacked(self, path: Path) -> Path:
        """Unpack a compressed file into a folder that goes when the bag is closed."""
        folder = self._stack.enter_context(tempfile.TemporaryDirectory())
        target = Path(folder) / path.stem
        try:
            with zstd.open(path, 'rb') as source, target.open('wb') as out:
                while block := source.read(1 << 20):
                    out.write(block)
        except (zstd.ZstdError, EOFError) as error:
            self.notes.add(f'{path.name} is damaged or cut off ({error}): everything before the '
                           'damage was read')
        return target

    def _decompressed(self, batch: Batch) -> Batch:
        """Unpack messages that were compressed one by one."""
        if not len(batch.start) or batch.buffer[batch.start[0]:batch.start[0] + 4] != _ZSTD_MAGIC:
            return batch
        messages = []
        room = files.UNPACKED
        for start, length in zip(batch.start, batch.length):
            message = b''
            with suppress(zstd.ZstdError):
                if room:
                    message = zstd.ZstdDecompressor().decompress(
                        batch.buffer[start:start + length], room)
            messages.append(message)
            room -= len(message)
        return Batch.of(batch.topic, messages, batch.log_ns)


def _damaged(path: Path, error: BaseException) -> str:
    return f'{path} is damaged ({files.in_a_line(error)}); copy it again, or record again'


def _beginning(path: Path) -> bytes:
    with path.open('rb') as file:
        return file.read(16)
