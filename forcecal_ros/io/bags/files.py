"""
The files of a recording, MCAP and SQLite: whole ones, and what can be read of damaged ones.

Both hand out serialised messages by the thousand: one buffer, and where in it each message lies.
rosbags reads the same files message by message, which takes nine times as long.
"""

from collections.abc import Iterator
from itertools import compress
from pathlib import Path
import sqlite3
import struct
import sys
from typing import Any, BinaryIO, NamedTuple
import zlib

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.topics import Topic
import lz4.frame
import numpy as np
from numpy.typing import NDArray

if sys.version_info >= (3, 14):
    from compression import zstd as zstd  # noqa: PLC0414
else:
    from backports import zstd as zstd  # noqa: PLC0414

Integers = NDArray[np.int64]


class Notes:
    """
    Plain sentences on what reading had to leave out or correct, each once.

    Attributes
    ----------
    ends_early : bool
        Whether the rest of the last file could not be read.
    """

    def __init__(self) -> None:
        self.ends_early = False
        self._sentences: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Add a sentence, unless there are a hundred."""
        if len(self._sentences) < 100:
            self._sentences[sentence] = None

    def __iter__(self) -> Iterator[str]:
        return iter(self._sentences)


def in_a_line(error: BaseException) -> str:
    """Return the words of an error without breaks, at most 120 characters of them."""
    return ' '.join(str(error).split())[:120] or type(error).__name__


def printable(name: str) -> str:
    """Return the name of a topic or type without what would break a line of text."""
    return name if name.isprintable() else repr(name)[1:-1]


class Batch(NamedTuple):
    """
    Messages of one topic.

    Attributes
    ----------
    start, length : ndarray of int, shape (n,)
        Where each message lies in the buffer [bytes].
    log_ns : ndarray of int, shape (n,)
        When each was recorded [ns since the epoch].
    """

    topic: Topic
    buffer: bytes
    start: Integers
    length: Integers
    log_ns: Integers

    @classmethod
    def of(cls, topic: Topic, messages: list[bytes], log_ns: Integers) -> 'Batch':
        """Join messages to one buffer."""
        length = np.array([len(message) for message in messages], dtype=np.int64)
        return cls(topic, b''.join(messages), np.cumsum(length) - length, length, log_ns)


def at_offsets(buffer: bytes, offsets: Integers, dtype: str) -> NDArray[Any]:
    """
    Read one item of a type at each offset, which need not be aligned.

    Parameters
    ----------
    offsets : ndarray of int, shape (n,)
        Each with a whole item behind it [bytes].
    dtype : str
        ``V40`` for 40 raw bytes.

    Returns
    -------
    ndarray, shape (n,)
        A copy.
    """
    kind = np.dtype(dtype)
    if not len(offsets):
        return np.empty(0, kind)
    items = len(buffer) - kind.itemsize + 1
    return np.ndarray((items,), kind, buffer, strides=(1,))[offsets]


DAMAGE = (ArithmeticError, EOFError, LookupError, MemoryError, RecursionError, RuntimeError,
          SyntaxError, TypeError, ValueError, sqlite3.Error, struct.error, zstd.ZstdError)
"""All that decoders raise over bytes that are not what they should be; lz4 raises RuntimeError,
and rosbags SyntaxError, since it makes Python classes of the definitions in a recording."""

MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _DATA_END, _LAST = 3, 4, 5, 6, 8, 15, 15
"""Opcodes of the records that are read, and the highest there is."""

_FOOTER_SIZE = 9 + 20 + 8
"""Bytes of the footer record: opcode and length, content, magic."""

UNPACKED = 1 << 28
"""Bytes that a record, an unpacked chunk or batch may have: a length beyond it is damage, or a
decompression bomb."""


class McapFile:
    """
    The messages of one file.

    Attributes
    ----------
    topics : dict of int to Topic
        By channel id.
    """

    def __init__(self, path: Path, notes: Notes) -> None:
        self._path = path
        self._notes = notes
        self._size = path.stat().st_size
        self._schemas: dict[int, tuple[str, str]] = {}
        self._chunks: list[int] = []
        self.topics: dict[int, Topic] = {}
        with path.open('rb') as file:
            self._read_summary(file)
        if not self.topics:
            for _ in self._scan(set()):
                pass

    def batches(self, topics: set[Topic]) -> Iterator[Batch]:
        """Yield the messages of some topics, some thousands at a time, in the file's order."""
        return self._scan({channel for channel, topic in self.topics.items() if topic in topics})

    def _read_summary(self, file: BinaryIO) -> None:
        """Learn channels and chunks from the end of the file, where it is intact."""
        if self._size < len(MAGIC) + _FOOTER_SIZE:
            return
        file.seek(-_FOOTER_SIZE, 2)
        footer = file.read()
        start = int.from_bytes(footer[9:17], 'little')
        if not footer.endswith(MAGIC) or not len(MAGIC) <= start < self._size:
            self._notes.add(f'{self._path.name} has no index because it was not closed properly; '
                            'its records were read one by one')
            return
        file.seek(start)
        summary = file.read(UNPACKED)
        for opcode, position, size in _records(summary)[1]:
            content = summary[position:position + size]
            self._learn(opcode, content)
            if opcode == _CHUNK_INDEX and size >= 24:
                self._chunks.append(int.from_bytes(content[16:24], 'little'))
        self._chunks.sort()

    def _learn(self, opcode: int, content: bytes) -> None:
        """Take in a schema or a channel; a damaged one is as good as none."""
        try:
            if opcode == _SCHEMA:
                (number,) = struct.unpack_from('<H', content)
                name, position = _string(content, 2)
                encoding, position = _string(content, position)
                definition = _string(content, position)[0] if encoding == 'ros2msg' else ''
                self._schemas[number] = printable(name), definition
            elif opcode == _CHANNEL:
                number, schema = struct.unpack_from('<HH', content)
                name, position = _string(content, 4)
                if _string(content, position)[0] == 'cdr' and number not in self.topics:
                    self.topics[number] = Topic(
                        printable(name), *self._schemas.get(schema, ('unknown', '')))
        except DAMAGE:
            return

    def _scan(self, channels: set[int]) -> Iterator[Batch]:
        with self._path.open('rb') as file:
            position = len(MAGIC)
            loose: list[bytes] = []
            while position < self._size:
                file.seek(position)
                head = file.read(9)
                opcode = head[0]
                size = int.from_bytes(head[1:], 'little')
                end = position + 9 + size
                if len(head) < 9 or not 0 < opcode <= _LAST or end > self._size:
                    if opcode == _CHUNK and len(head) == 9:
                        yield from self._chunk(file.read(UNPACKED), position, channels)
                    position = self._resume(position)
                elif opcode == _CHUNK:
                    yield from self._chunk(file.read(min(size, UNPACKED)), position, channels)
                    position = end
                elif opcode == _DATA_END:
                    break
                else:
                    if opcode == _MESSAGE:
                        loose.append(head + file.read(min(size, UNPACKED)))
                    elif opcode in (_SCHEMA, _CHANNEL):
                        self._learn(opcode, file.read(min(size, UNPACKED)))
                    position = end
                if len(loose) * 128 > 1 << 22:
                    yield from self._messages(b''.join(loose), channels)
                    loose = []
            yield from self._messages(b''.join(loose), channels)

    def _resume(self, position: int) -> int:
        """Return where to go on after a record that makes no sense."""
        later = [chunk for chunk in self._chunks if position < chunk < self._size]
        goal = later[0] if later else self._size
        self._notes.ends_early = not later
        self._notes.add(f'{self._path.name} is damaged or cut off at byte {position}: '
                        f'{goal - position} bytes were skipped')
        return goal

    def _chunk(self, content: bytes, position: int, channels: set[int]) -> Iterator[Batch]:
        try:
            buffer = _unpack(content)
        except DAMAGE as error:
            self._notes.add(f'{self._path.name}: the chunk at byte {position} is damaged '
                            f'({error}) and was left out')
            return
        yield from self._messages(buffer, channels)

    def _messages(self, buffer: bytes, channels: set[int]) -> Iterator[Batch]:
        starts, others, end = _records(buffer)
        for opcode, position, size in others:
            if opcode in (_SCHEMA, _CHANNEL):
                self._learn(opcode, buffer[position:position + size])
        if end < len(buffer):
            self._notes.add(f'{self._path.name}: a chunk ends in the middle of a message')
        for channel in channels & starts.keys():
            start = np.array(starts[channel])
            yield Batch(
                self.topics[channel], buffer, start + 31,
                at_offsets(buffer, start + 1, '<i8') - 22, at_offsets(buffer, start + 15, '<i8'))


def _records(buffer: bytes) -> tuple[dict[int, list[int]], list[tuple[int, int, int]], int]:
    """Find the records: starts of messages by channel, (opcode, content, size) of others, end."""
    messages: dict[int, list[int]] = {}
    others = []
    position, size = 0, len(buffer)
    unpack = struct.Struct('<BQH').unpack_from
    while position + 11 <= size:
        opcode, length, channel = unpack(buffer, position)
        end = position + 9 + length
        if end > size:
            break
        if opcode != _MESSAGE:
            others.append((opcode, position + 9, length))
        elif length < 22:
            break
        elif channel in messages:
            messages[channel].append(position)
        else:
            messages[channel] = [position]
        position = end
    return messages, others, position


def _string(content: bytes, position: int) -> tuple[str, int]:
    (size,) = struct.unpack_from('<I', content, position)
    end = position + 4 + size
    if end > len(content):
        raise struct.error('a string is longer than its record')
    return content[position + 4:end].decode(), end


def _unpack(content: bytes) -> bytes:
    """Decompress a chunk and check it; of one that was cut off, return what is there."""
    _, _, size, checksum = struct.unpack_from('<QQQI', content)
    compression, position = _string(content, 28)
    (packed,) = struct.unpack_from('<Q', content, position)
    data = content[position + 8:position + 8 + packed]
    if size > UNPACKED:
        raise ValueError(f'{size} bytes are stated')
    if compression:
        data = _decompressor(compression).decompress(data, size)
    if len(content) >= position + 8 + packed:
        if len(data) != size:
            raise ValueError(f'{len(data)} bytes instead of {size}')
        if checksum and zlib.crc32(data) != checksum:
            raise ValueError('checksum does not match')
    return data


def _decompressor(compression: str) -> Any:
    if compression == 'zstd':
        return zstd.ZstdDecompressor()
    if compression == 'lz4':
        return lz4.frame.LZ4FrameDecompressor()
    raise ValueError(f'unknown compression {compression!r}')


class SqliteFile:
    """
    The messages of one file.

    Attributes
    ----------
    topics : dict of int to Topic
        By topic id.
    """

    def __init__(self, path: Path, notes: Notes) -> None:
        self._path = path
        self._notes = notes
        try:
            self._database = self._open()
            self.topics = self._read_topics()
        except DAMAGE as error:
            raise DataError(f'{path}: not a readable SQLite recording ({in_a_line(error)}); try '
                            f'`sqlite3 {path.name} .recover`') from error

    def _open(self) -> sqlite3.Connection:
        """Open read-only; ``immutable`` where a lock or journal cannot be made beside it."""
        address = self._path.absolute().as_uri()
        for mode in ('mode=ro', 'mode=ro&immutable=1'):
            database = sqlite3.connect(f'{address}?{mode}', uri=True)
            database.text_factory = lambda text: text.decode(errors='replace')
            try:
                database.execute('SELECT count(*) FROM sqlite_master')
                return database
            except sqlite3.OperationalError as error:
                database.close()
                problem = error
        raise problem

    def _read_topics(self) -> dict[int, Topic]:
        try:
            definitions = dict(self._database.execute(
                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                "WHERE encoding = 'ros2msg'"))
        except sqlite3.DatabaseError:
            definitions = {}
        rows = self._database.execute(
            "SELECT id, name, type FROM topics WHERE serialization_format = 'cdr'")
        return {number: Topic(printable(name), printable(kind), str(definitions.get(kind, '')))
                for number, name, kind in rows if type(name) is type(kind) is str}

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def batches(self, topics: set[Topic]) -> Iterator[Batch]:
        """Yield the messages of some topics, some thousands at a time, in the file's order."""
        chosen = [number for number, topic in self.topics.items() if topic in topics]
        query = ('SELECT id, topic_id, timestamp, data FROM messages '  # noqa: S608 - of ?
                 f'WHERE topic_id IN ({", ".join("?" * len(chosen))}) AND id > ? ORDER BY id')
        last = -1
        for order in ('', ' DESC'):  # what lies behind damage is read from the end
            begin = last
            try:
                for rows in self._rows(query + order, (*chosen, begin)):
                    last = rows[-1][0]
                    yield from self._group(rows)
                return
            except sqlite3.DatabaseError as error:
                self._notes.add(f'{self._path.name} is damaged or cut off ({error}): some '
                                'messages were left out')

    def _rows(self, query: str, values: tuple[int, ...]) -> Iterator[list[tuple[Any, ...]]]:
        cursor = self._database.execute(query, values)
        rows: list[tuple[Any, ...]] = []
        try:
            for row in cursor:
                rows.append(row)
                if len(rows) == 8192:
                    yield rows
                    rows = []
        except sqlite3.DatabaseError:
            if rows:
                yield rows
            raise
        if rows:
            yield rows

    def _group(self, rows: list[tuple[Any, ...]]) -> Iterator[Batch]:
        rows = [row for row in rows if type(row[2]) is int and type(row[3]) is bytes]
        if not rows:
            return
        _, numbers, log_ns, blobs = zip(*rows)
        source, logs = np.array(numbers), np.array(log_ns)
        for number in set(numbers):
            chosen = source == number
            yield Batch.of(self.topics[number], list(compress(blobs, chosen)), logs[chosen])
