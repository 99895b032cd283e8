"""Arrays to serialised messages (CDR), thousands at a time: one blank message, filled n times."""

from collections.abc import Mapping, Sequence
import struct
from typing import Any

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.batch import Integers
from forcecal_ros.recording.bags.cdr import Group, NUMBERS, walk
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
"""Paths of a header's stamp."""


def encode(
        store: Typestore, msgtype: str, stamp_ns: Integers, fields: Sequence[str],
        values: Array, text: Mapping[str, str] | None = None) -> NDArray[np.uint8]:
    """
    Serialise messages that differ in stamp and numbers only.

    Parameters
    ----------
    stamp_ns : ndarray of int, shape (n,)
        For the header, where the type has one [ns since the epoch].
    fields : sequence of str
        Paths of numbers, as ``wrench.force.x`` or ``position[0]``.
    values : ndarray, shape (n, k)
        One column a field.
    text : mapping of str to str, optional
        Strings by path, as ``header.frame_id`` or ``name[0]``.

    Returns
    -------
    ndarray of uint8, shape (n, length)
        One row a message. Sequences are as long as fields and text name elements of them;
        whatever is not named is zero or empty.

    Raises
    ------
    DataError
        A stamp does not fit into a message.
    """
    message = _Blank(store, (*fields, *(text or {})), text or {}).serialise(msgtype)
    layout = walk(store, msgtype, message)
    rows = np.tile(np.frombuffer(message, np.uint8), (len(stamp_ns), 1))
    group = Group(np.arange(len(rows)), layout, rows.view(f'V{len(message)}')[:, 0])
    columns: dict[str, NDArray[Any]] = dict(zip(fields, np.asarray(values).T, strict=True))
    if STAMP[0] in layout.numbers:
        seconds, nanoseconds = np.divmod(stamp_ns, 10**9)
        if len(seconds) and not 0 <= seconds.min() <= seconds.max() < 1 << 31:
            raise DataError(f'stamps from {seconds.min()} to {seconds.max()} s cannot be written; '
                            'they must lie between 1970 and 2038')
        columns.update(zip(STAMP, (seconds, nanoseconds)))
    for path, column in columns.items():
        group.numbers(path)[:, 0] = column
    return rows


class _Blank:
    """Writes a message of zeros and given strings."""

    def __init__(self, store: Typestore, paths: Sequence[str], text: Mapping[str, str]) -> None:
        self._types = store.fielddefs
        self._paths = paths
        self._text = text
        self._data = bytearray()

    def serialise(self, msgtype: str) -> bytes:
        self._message(msgtype, '')
        return b'\0\1\0\0' + bytes(self._data)

    def _message(self, msgtype: str, prefix: str) -> None:
        for name, field in self._types[msgtype][1]:
            self._field(field, prefix + name)

    def _field(self, field: Any, path: str) -> None:
        kind, content = field
        if kind == Nodetype.BASE and content[0] == 'string':
            text = self._text.get(path, '').encode() + b'\0'
            self._align(4)
            self._data += struct.pack('<I', len(text)) + text
        elif kind == Nodetype.BASE:
            size = np.dtype(NUMBERS[content[0]]).itemsize
            self._align(size)
            self._data += bytes(size)
        elif kind == Nodetype.NAME:
            self._message(content, path + '.')
        else:
            inner, count = content
            if kind == Nodetype.SEQUENCE:
                count = self._named(path)
                self._align(4)
                self._data += struct.pack('<I', count)
            for i in range(count):
                self._field(inner, f'{path}[{i}]')

    def _named(self, path: str) -> int:
        """Return how many elements of a sequence the paths speak of."""
        start = path + '['
        return max((int(name[len(start):].partition(']')[0]) + 1
                    for name in self._paths if name.startswith(start)), default=0)

    def _align(self, size: int) -> None:
        self._data += bytes(-len(self._data) % size)
