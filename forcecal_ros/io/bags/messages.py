"""Serialised messages (CDR) to arrays, thousands at a time.

Where the strings and the lengths in two messages agree, every number lies at the same place in
both. So one message is walked field by field, and all that are laid out like it are read at once.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
import struct
from typing import Any, NamedTuple

from forcecal_ros.core import topics
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import JointStream, Phase, PoseStream, Stream
from forcecal_ros.core.topics import IMU, JOINT_STATE, ROLES
from forcecal_ros.io.bags.files import at_offsets, Batch, Integers
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.store import Typestore

NUMBERS = {
    'bool': 'u1', 'byte': 'u1', 'octet': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1',
    'int16': 'i2', 'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8',
    'float32': 'f4', 'float64': 'f8',
}
"""Primitive types of messages as numpy writes them."""


class CdrError(Exception):
    """A message is shorter than its type requires, or laid out in a way that is not understood."""


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
            self._known = [*self._known[-32:], layout]
            unread, group = _match(batch, unread, layout)
            if group is not None:
                yield group


def joint_names(store: Typestore, msgtype: str, batches: Iterable[Batch]
                ) -> Iterator[tuple[str, ...]]:
    """Yield the names that messages give to their joints, of one layout after the other."""
    decoder = Decoder(store, msgtype)
    for batch in batches:
        for group in decoder.groups(batch):
            yield tuple(text for path, text in group.layout.text.items()
                        if path.startswith(('name[', 'joint_names[')))


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
    walker.fields(msgtype, '')
    fixed = np.concatenate([np.arange(start, end) for start, end in walker.fixed])
    content = np.frombuffer(message, np.uint8)
    return Layout(len(message), walker.numbers, walker.text, fixed, content[fixed])


class _Walker:
    """Walks through the fields of a message, and notes where everything lies."""

    def __init__(self, store: Typestore, message: bytes | bytearray) -> None:
        if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
            raise CdrError('not plain CDR')
        self._types = store.fielddefs
        self._data = message
        self._order = '<' if message[1] else '>'
        self._position = 4
        self.fixed = [(0, 2)]
        self.numbers: dict[str, Numbers] = {}
        self.text: dict[str, str] = {}

    def fields(self, msgtype: str, prefix: str) -> None:
        """Walk through all fields of a type."""
        if msgtype not in self._types:
            raise CdrError(f'unknown type {msgtype}')
        for name, field in self._types[msgtype][1]:
            self._field(field, prefix + name)

    def _field(self, field: Any, path: str) -> None:
        kind, content = field
        if kind == Nodetype.BASE:
            self._base(content[0], path, 1)
        elif kind == Nodetype.NAME:
            self.fields(content, path + '.')
        else:
            inner, count = content
            if kind == Nodetype.SEQUENCE:
                count = self._length(path)
            if inner[0] == Nodetype.BASE and inner[1][0] != 'string':
                self._base(inner[1][0], path, count)
            else:
                for i in range(count):
                    self._field(inner, f'{path}[{i}]')

    def _base(self, name: str, path: str, count: int) -> None:
        """Step over a string, or over numbers of one type."""
        if name == 'string':
            start = self._take(1, self._length(path, of_text=True))
            self.fixed.append((start, self._position))
            text = self._data[start:self._position].rstrip(b'\0')
            self.text[path] = text.decode(errors='replace')
        elif name in NUMBERS:
            dtype = NUMBERS[name]
            if count:
                start = self._take(int(dtype[1]), count)
                self.numbers[path] = Numbers(start, self._order + dtype, count)
        else:
            raise CdrError(f'fields of type {name} are not supported')

    def _length(self, path: str, of_text: bool = False) -> int:
        """Step over the length of a sequence or string, and return it."""
        start = self._take(4, 1)
        self.fixed.append((start, start + 4))
        count = int.from_bytes(self._data[start:start + 4],
                               'little' if self._order == '<' else 'big')
        if count > len(self._data):
            raise CdrError('a length exceeds the end of the message')
        return count

    def _take(self, size: int, count: int) -> int:
        """Step over some items, aligned to their size; return where they begin."""
        start = self._position + (4 - self._position) % size
        self._position = start + size * count
        self._reach(self._position)
        return start

    def _reach(self, end: int) -> None:
        if end > len(self._data):
            raise CdrError('the message ends early')


class _Writer(_Walker):
    """Makes a message of zeros and given strings on its way."""

    def __init__(self, store: Typestore, paths: Iterable[str], text: Mapping[str, str]) -> None:
        self.message = bytearray(b'\0\1\0\0')
        super().__init__(store, self.message)
        self._paths, self._given = paths, text

    def _length(self, path: str, of_text: bool = False) -> int:
        if of_text:
            content = self._given.get(path, '').encode() + b'\0'
            count = len(content)
        else:
            content, start = b'', path + '['
            count = max((int(name[len(start):].partition(']')[0]) + 1 for name in (
                *self._paths, *self._given) if name.startswith(start)), default=0)
        self.message[self._take(4, 1):] = struct.pack('<I', count) + content
        return count

    def _reach(self, end: int) -> None:
        self.message += bytes(max(0, end - len(self.message)))


class Diagnostic(NamedTuple):
    """One status: when it begins [s], DiagnosticStatus level, message, and the value behind it."""

    start: float
    level: int
    message: str
    value: str


Signal = Stream | PoseStream | Sequence[Phase | Diagnostic] | str
"""What messages can be made of: numbers, poses, phases, diagnostics, or one text."""


class Messages(NamedTuple):
    """
    Serialised messages of one topic.

    Attributes
    ----------
    stamp_ns : ndarray of int, shape (n,)
        [ns since the epoch]
    rows : iterable of ndarray of uint8
        One a message.
    """

    topic: str
    msgtype: str
    stamp_ns: Integers
    rows: Iterable[NDArray[np.uint8]]
    latched: bool = False


def messages_of(role: str, signal: Signal, start_ns: int, topic: str | None = None) -> Messages:
    """
    Serialise a signal.

    Parameters
    ----------
    role : str
        One of :data:`forcecal_ros.core.topics.ROLES`; decides topic and type.
    signal : Stream, PoseStream, sequence of Phase, or str
        Times count from ``start_ns``. An IMU has three columns, specific force, or six, with
        the angular velocity; a text is stamped ``start_ns``.
    start_ns : int
        [ns since the epoch]
    topic : str, optional
        Where it is not the usual one.
    """
    usual, types, latched = ROLES[role]
    msgtype = types[0]
    if isinstance(signal, str):
        t = np.zeros(1)
    else:
        t = (signal.t if isinstance(signal, Stream | PoseStream)
             else np.array([one.start for one in signal]))
    stamps = start_ns + np.rint(t * 1e9).astype(np.int64)
    rows: Iterable[NDArray[np.uint8]]
    if isinstance(signal, str | Stream | PoseStream):
        rows = encode(msgtype, stamps, *_columns(msgtype, signal))
    else:
        rows = [encode(msgtype, stamps[i:i + 1], ('status[0].level',), *_status(one))[0]
                for i, one in enumerate(signal)]
    return Messages(topic or usual, msgtype, stamps, rows, latched)


def _columns(msgtype: str, signal: Stream | PoseStream | str
             ) -> tuple[Sequence[str], Array, dict[str, str]]:
    """Return fields, a column of numbers for each, and texts."""
    if isinstance(signal, str):
        return (), np.empty((1, 0)), {'data': signal}
    fields, text = FIELDS.get(msgtype, ()), {'header.frame_id': signal.frame}
    if isinstance(signal, PoseStream):
        quaternion = (quaternion_from_matrix(signal.R_base_sensor) if len(signal)
                      else np.empty((0, 4)))
        return fields, np.hstack([signal.position, quaternion]), text
    if isinstance(signal, JointStream):
        fields = tuple(f'position[{i}]' for i in range(signal.values.shape[1]))
        text |= {f'name[{i}]': name for i, name in enumerate(signal.names)}
    elif msgtype == JOINT_STATE:
        fields, text['name[0]'] = ('position[0]',), 'optidrive'
    elif msgtype == IMU:
        return (*_imu_columns(signal.values), text)
    return fields, signal.values, text


def _imu_columns(values: Array) -> tuple[tuple[str, ...], Array]:
    """Mark what an IMU does not measure by -1 in front of its covariance (REP-145)."""
    unknown = ['orientation_covariance[0]']
    if values.shape[1] == 3:
        unknown.append('angular_velocity_covariance[0]')
    return ((*FIELDS[IMU][:values.shape[1]], *unknown),
            np.hstack([values, np.full((len(values), len(unknown)), -1.0)]))


def _status(one: Phase | Diagnostic) -> tuple[Array, dict[str, str]]:
    if isinstance(one, Phase):
        return np.zeros((1, 1)), {
            'status[0].name': 'sequencer: phase', 'status[0].message': one.name}
    return np.array([[float(one.level)]]), {
        'status[0].name': 'observer: status', 'status[0].message': one.message,
        'status[0].values[0].key': 'status', 'status[0].values[0].value': one.value}


STAMP = ('header.stamp.sec', 'header.stamp.nanosec')
"""Paths of a header's stamp."""


JAZZY = get_typestore(Stores.ROS2_JAZZY)
"""The types of ROS 2 Jazzy."""


def encode(msgtype: str, stamp_ns: Integers, fields: Sequence[str], values: Array,
           text: Mapping[str, str] | None = None) -> NDArray[np.uint8]:
    """
    Serialise messages of a type of ROS 2 Jazzy that differ in stamp and numbers only.

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
        the rest is zero or empty.

    Raises
    ------
    DataError
        A stamp does not fit into a message.
    """
    writer = _Writer(JAZZY, fields, text or {})
    writer.fields(msgtype, '')
    message = bytes(writer.message)
    layout = walk(JAZZY, msgtype, message)
    rows = np.tile(np.frombuffer(message, np.uint8), (len(stamp_ns), 1))
    group = Group(np.arange(len(rows)), layout, rows.view(f'V{len(message)}')[:, 0])
    columns: dict[str, NDArray[Any]] = dict(zip(fields, np.asarray(values).T, strict=True))
    if STAMP[0] in layout.numbers:
        seconds, nanoseconds = np.divmod(stamp_ns, 10**9)
        if len(seconds) and not 0 <= seconds.min() <= seconds.max() < 1 << 31:
            raise DataError(f'stamps from {seconds.min()} to {seconds.max()} s cannot be written; '
                            'they must be between 1970 and 2038')
        columns.update(zip(STAMP, (seconds, nanoseconds)))
    for path, column in columns.items():
        group.numbers(path)[:, 0] = column
    return rows


FIELDS: Mapping[str, tuple[str, ...]] = {
    topics.WRENCH: tuple(f'wrench.{part}.{axis}' for part in ('force', 'torque')
                         for axis in 'xyz'),
    topics.VECTOR3: tuple(f'vector.{axis}' for axis in 'xyz'),
    IMU: tuple(f'{part}.{axis}' for part in ('linear_acceleration', 'angular_velocity')
               for axis in 'xyz'),
    topics.ACCEL: tuple(f'accel.linear.{axis}' for axis in 'xyz'),
    topics.POSE: (*(f'pose.position.{axis}' for axis in 'xyz'),
           *(f'pose.orientation.{axis}' for axis in 'xyzw')),
    JOINT_STATE: ('position[optidrive]',),
    topics.INERTIA: ('inertia.m', *(f'inertia.com.{axis}' for axis in 'xyz'),
              *(f'inertia.i{pair}' for pair in ('xx', 'xy', 'xz', 'yy', 'yz', 'zz'))),
}

JOINTS: Mapping[str, str] = {
    JOINT_STATE: 'position', topics.CONTROLLER_STATE: 'reference.positions',
    topics.MULTI_ARRAY: 'data'}
"""Which array of a message holds the commands of joints."""
