"""Signals as arrays to serialised messages (CDR): which numbers of a message are their columns."""

from collections.abc import Iterable, Mapping, Sequence
import struct
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import JointStream, Phase, PoseStream, Stream
from forcecal_ros.core.topics import (
    ACCEL,
    CONTROLLER_STATE,
    DIAGNOSTICS,
    IMU,
    INERTIA,
    JOINT_STATE,
    MULTI_ARRAY,
    POSE,
    ROLES,
    VECTOR3,
    WRENCH,
)
from forcecal_ros.io.bags.batch import Integers
from forcecal_ros.io.bags.cdr import Group, NUMBERS, walk
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_typestore, Stores
from rosbags.typesys.store import Typestore


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
    name, msgtype = topic or usual, types[0]
    if isinstance(signal, str):
        stamps = np.array([start_ns])
        rows = _encode(msgtype, stamps, (), np.empty((1, 0)), {'data': signal})
    elif isinstance(signal, PoseStream):
        stamps = _stamps(signal.t, start_ns)
        quaternion = (quaternion_from_matrix(signal.R_base_sensor) if len(signal)
                      else np.empty((0, 4)))
        rows = _encode(msgtype, stamps, FIELDS[POSE], np.hstack([signal.position, quaternion]),
                       {'header.frame_id': signal.frame})
    elif isinstance(signal, Stream):
        stamps = _stamps(signal.t, start_ns)
        rows = _stream_rows(msgtype, stamps, signal)
    else:
        stamps = _stamps(np.array([one.start for one in signal]), start_ns)
        return Messages(name, msgtype, stamps, _diagnostic_rows(stamps, signal), latched)
    return Messages(name, msgtype, stamps, rows, latched)


def _encode(msgtype: str, stamps: Integers, fields: Sequence[str], values: Array,
            text: Mapping[str, str]) -> NDArray[np.uint8]:
    return encode(get_typestore(Stores.ROS2_JAZZY), msgtype, stamps, fields, values, text)


def _stamps(t: Array, start_ns: int) -> Integers:
    return start_ns + np.rint(t * 1e9).astype(np.int64)


def _stream_rows(msgtype: str, stamps: Integers, signal: Stream) -> NDArray[np.uint8]:
    fields, values, text = FIELDS[msgtype], signal.values, {'header.frame_id': signal.frame}
    if isinstance(signal, JointStream):
        fields = tuple(f'position[{i}]' for i in range(values.shape[1]))
        text |= {f'name[{i}]': name for i, name in enumerate(signal.names)}
    elif msgtype == JOINT_STATE:
        fields, text['name[0]'] = ('position[0]',), 'optidrive'
    elif msgtype == IMU:
        fields, values = _imu_columns(values)
    return _encode(msgtype, stamps, fields, values, text)


def _imu_columns(values: Array) -> tuple[tuple[str, ...], Array]:
    """Mark what an IMU does not measure by -1 in front of its covariance (REP-145)."""
    unknown = ['orientation_covariance[0]']
    if values.shape[1] == 3:
        unknown.append('angular_velocity_covariance[0]')
    return ((*FIELDS[IMU][:values.shape[1]], *unknown),
            np.hstack([values, np.full((len(values), len(unknown)), -1.0)]))


def _diagnostic_rows(stamps: Integers, signal: Sequence[Phase | Diagnostic]
                     ) -> list[NDArray[np.uint8]]:
    return [_phase(stamps[i:i + 1], one) if isinstance(one, Phase)
            else _diagnostic(stamps[i:i + 1], one) for i, one in enumerate(signal)]


def _phase(stamp: Integers, phase: Phase) -> NDArray[np.uint8]:
    row: NDArray[np.uint8] = _encode(DIAGNOSTICS, stamp, (), np.empty((1, 0)), {
        'status[0].name': 'sequencer: phase', 'status[0].message': phase.name})[0]
    return row


def _diagnostic(stamp: Integers, one: Diagnostic) -> NDArray[np.uint8]:
    level = np.array([[float(one.level)]])
    row: NDArray[np.uint8] = _encode(DIAGNOSTICS, stamp, ('status[0].level',), level, {
        'status[0].name': 'observer: status', 'status[0].message': one.message,
        'status[0].values[0].key': 'status', 'status[0].values[0].value': one.value})[0]
    return row


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


FIELDS: Mapping[str, tuple[str, ...]] = {
    WRENCH: tuple(f'wrench.{part}.{axis}' for part in ('force', 'torque') for axis in 'xyz'),
    VECTOR3: tuple(f'vector.{axis}' for axis in 'xyz'),
    IMU: tuple(f'{part}.{axis}' for part in ('linear_acceleration', 'angular_velocity')
               for axis in 'xyz'),
    ACCEL: tuple(f'accel.linear.{axis}' for axis in 'xyz'),
    POSE: (*(f'pose.position.{axis}' for axis in 'xyz'),
           *(f'pose.orientation.{axis}' for axis in 'xyzw')),
    JOINT_STATE: ('position[optidrive]',),
    INERTIA: ('inertia.m', *(f'inertia.com.{axis}' for axis in 'xyz'),
              *(f'inertia.i{pair}' for pair in ('xx', 'xy', 'xz', 'yy', 'yz', 'zz'))),
}

JOINTS: Mapping[str, str] = {
    JOINT_STATE: 'position', CONTROLLER_STATE: 'reference.positions', MULTI_ARRAY: 'data'}
"""Which array of a message holds what joints are told."""

JOINT_NAMES: Mapping[str, str] = {JOINT_STATE: 'name', CONTROLLER_STATE: 'joint_names'}
"""Which array names them; other messages do not."""
