"""Serialised messages (CDR) to arrays, thousands at a time.

Where the strings and the lengths in two messages agree, every number lies at the same place in
both. So one message is walked field by field, and all that are laid out like it are read at once.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.io.bags.batch import at_offsets, Batch, Integers
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

NUMBERS = {
    'bool': 'u1', 'byte': 'u1', 'octet': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1',
    'int16': 'i2', 'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8',
    'float32': 'f4', 'float64': 'f8',
}
"""Primitive types of messages as numpy writes them."""

_REMEMBERED = 32
"""Layouts of one topic that are kept to be matched; strings of changing length make new ones."""


class CdrError(Exception):
    """A message is shorter than its type says, or laid out in a way that is not understood."""


class Numbers(NamedTuple):
    """Numbers in a row: byte offset of the first, type of each, how many."""

    offset: int
    dtype: str
    size: int


class Layout(NamedTuple):
    """
    Where everything lies in messages of one kind.

    Attributes
    ----------
    length : int
        Of the whole message [bytes].
    numbers : dict of str to Numbers
        By path, as ``wrench.force.x`` or ``position``.
    text : dict of str to str
        The strings, by path, as ``header.frame_id`` or ``name[0]``.
    fixed : ndarray of int
        Offsets of the bytes that make this layout what it is: kind of CDR, lengths, strings.
    pattern : ndarray of uint8
        What stands there.
    """

    length: int
    numbers: dict[str, Numbers]
    text: dict[str, str]
    fixed: Integers
    pattern: NDArray[np.uint8]


class Group(NamedTuple):
    """Messages of one layout, and where in the batch they are."""

    where: Integers
    layout: Layout
    rows: NDArray[np.void]

    def numbers(self, path: str) -> NDArray[Any]:
        """
        Return the numbers at a path: (n, k), k the length of an array, else 1.

        ``position[2]`` picks one of an array, ``position[wrist]`` the one that ``name`` calls so.

        Raises
        ------
        CdrError
            The messages have nothing there.
        """
        name, bracket, item = path.partition('[')
        whole = self.layout.numbers.get(path) or self.layout.numbers.get(name)
        if whole is None:
            raise CdrError(f'no {path}')
        offset, dtype, count = whole
        if bracket and path not in self.layout.numbers:
            position = self._position(item.rstrip(']'))
            if not 0 <= position < count:
                raise CdrError(f'no {path}')
            offset, count = offset + position * np.dtype(dtype).itemsize, 1
        kind = np.dtype({'names': ['x'], 'formats': [(dtype, (count,))], 'offsets': [offset],
                         'itemsize': self.layout.length})
        return np.asarray(self.rows.view(kind)['x'])

    def _position(self, item: str) -> int:
        if item.isdigit():
            return int(item)
        names = self.layout.text
        return next((i for i in range(len(names)) if names.get(f'name[{i}]') == item), -1)

    def columns(self, paths: Sequence[str]) -> Array:
        """Return the numbers at several paths side by side, (n, k)."""
        return np.concatenate([self.numbers(path) for path in paths], axis=1, dtype=float)

    def stamps(self) -> Integers | None:
        """Return the header stamps [ns since the epoch], None for a type without header."""
        if 'header.stamp.sec' not in self.layout.numbers:
            return None
        seconds = self.numbers('header.stamp.sec')[:, 0].astype(np.int64)
        return seconds * 10**9 + self.numbers('header.stamp.nanosec')[:, 0].astype(np.int64)


class Decoder:
    """
    Reads messages of one type.

    Attributes
    ----------
    undecodable : int
        How many messages made no sense so far.
    """

    def __init__(self, store: Typestore, msgtype: str) -> None:
        self._store = store
        self._msgtype = msgtype
        self._known: list[Layout] = []
        self.undecodable = 0

    def groups(self, batch: Batch) -> Iterator[Group]:
        """Yield the messages of a batch, those of one layout together."""
        unread = np.arange(len(batch.start))
        for layout in tuple(self._known):
            unread, group = _match(batch, unread, layout)
            if group is not None:
                yield group
        while len(unread):
            first = unread[0]
            start, end = batch.start[first], batch.start[first] + batch.length[first]
            try:
                layout = walk(self._store, self._msgtype, batch.buffer[start:end])
            except (CdrError, RecursionError):
                self.undecodable += 1
                unread = unread[1:]
                continue
            self._known = [*self._known[-_REMEMBERED:], layout]
            unread, group = _match(batch, unread, layout)
            if group is not None:
                yield group


def _match(batch: Batch, unread: Integers, layout: Layout) -> tuple[Integers, Group | None]:
    """Split unread messages into those of one layout and the others."""
    like = batch.length[unread] == layout.length
    index = unread[like]
    rows = at_offsets(batch.buffer, batch.start[index], f'V{layout.length}')
    if not len(index):
        return unread, None
    table = rows.view(np.uint8).reshape(len(index), layout.length)
    same = (table[:, layout.fixed] == layout.pattern).all(axis=1)
    if not same.all():
        like[like] = same
        index, rows = index[same], rows[same]
    return unread[~like], Group(index, layout, rows) if len(index) else None


def walk(store: Typestore, msgtype: str, message: bytes) -> Layout:
    """
    Find out where everything lies in a message.

    Parameters
    ----------
    msgtype : str
        As ``geometry_msgs/msg/WrenchStamped``.
    message : bytes
        With the four bytes of encapsulation in front.

    Raises
    ------
    CdrError
        The message is too short for its type, or of an unknown encoding.
    """
    walker = _Walker(store, message)
    walker.message(msgtype, '')
    fixed = np.concatenate([np.arange(start, end) for start, end in walker.fixed])
    content = np.frombuffer(message, np.uint8)
    return Layout(len(message), walker.numbers, walker.text, fixed, content[fixed])


class _Walker:
    """One pass over one message."""

    def __init__(self, store: Typestore, message: bytes) -> None:
        if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
            raise CdrError('not plain CDR')
        self._types = store.fielddefs
        self._data = message
        self._order = '<' if message[1] else '>'
        self._position = 4
        self.fixed = [(0, 2)]
        self.numbers: dict[str, Numbers] = {}
        self.text: dict[str, str] = {}

    def message(self, msgtype: str, prefix: str) -> None:
        if msgtype not in self._types:
            raise CdrError(f'unknown type {msgtype}')
        for name, field in self._types[msgtype][1]:
            self._field(field, prefix + name)

    def _field(self, field: Any, path: str) -> None:
        kind, content = field
        if kind == Nodetype.BASE:
            self._base(content[0], path, 1)
        elif kind == Nodetype.NAME:
            self.message(content, path + '.')
        else:
            inner, count = content
            if kind == Nodetype.SEQUENCE:
                count = self._count()
            if inner[0] == Nodetype.BASE and inner[1][0] != 'string':
                self._base(inner[1][0], path, count)
            else:
                for i in range(count):
                    self._field(inner, f'{path}[{i}]')

    def _base(self, name: str, path: str, count: int) -> None:
        if name == 'string':
            start = self._take(1, self._count())
            self.fixed.append((start, self._position))
            text = self._data[start:self._position].rstrip(b'\0')
            self.text[path] = text.decode(errors='replace')
        elif name in NUMBERS:
            dtype = NUMBERS[name]
            if count:
                start = self._take(int(dtype[1]), count)
                self.numbers[path] = Numbers(start, self._order + dtype, count)
        else:
            raise CdrError(f'fields of type {name} are not read')

    def _count(self) -> int:
        start = self._take(4, 1)
        self.fixed.append((start, start + 4))
        count = int.from_bytes(self._data[start:start + 4],
                               'little' if self._order == '<' else 'big')
        if count > len(self._data):
            raise CdrError('a length beyond the end of the message')
        return count

    def _take(self, size: int, count: int) -> int:
        """Step over some items, aligned to their size; return where they begin."""
        start = self._position + (4 - self._position) % size
        self._position = start + size * count
        if self._position > len(self._data):
            raise CdrError('the message ends early')
        return start
