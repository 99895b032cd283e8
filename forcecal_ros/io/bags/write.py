"""Arrays to recordings."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from pathlib import Path
import sqlite3
from types import TracebackType

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.files import new_directory
from forcecal_ros.core.streams import Recording, Stream
from forcecal_ros.io.bags.messages import JAZZY, Messages, messages_of, Signal
import numpy as np
from rosbags import interfaces as qos
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError

_FOREVER = qos.QosTime(9223372036, 854775807)
"""How rosbag2 writes an unlimited duration: 2^63 - 1 ns."""


def _quality(latched: bool) -> qos.Qos:
    durability = qos.QosDurability.TRANSIENT_LOCAL if latched else qos.QosDurability.VOLATILE
    return qos.Qos(
        qos.QosHistory.KEEP_LAST, 1 if latched else 10, qos.QosReliability.RELIABLE, durability,
        _FOREVER, _FOREVER, qos.QosLiveliness.AUTOMATIC, _FOREVER, False)


class BagWriter:
    """
    A recording being written; use it as a context.

    It takes its place once the context ends without error, and what was there before is kept as
    ``path~``; after an error no part of it remains.

    Parameters
    ----------
    path : Path or str
        Folder of the recording.
    compressed : bool
        By Zstandard, inside the file.
    """

    def __init__(self, path: Path | str, compressed: bool = False) -> None:
        self.path = Path(path)
        self._compressed = compressed
        self._connections: dict[str, Connection] = {}
        self._stack = ExitStack()
        self._writer: Writer

    def __enter__(self) -> 'BagWriter':
        with ExitStack() as stack, self._blamed():
            folder = stack.enter_context(new_directory(self.path))
            self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            if self._compressed:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            stack.enter_context(self._writer)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        with self._blamed():
            self._stack.__exit__(kind, error, trace)

    def write_raw(self, topic: str, msgtype: str, log_ns: int, data: bytes, *,
                  latched: bool = False) -> None:
        """
        Write one serialised message.

        Parameters
        ----------
        topic : str
            A missing leading slash is added.
        msgtype : str
            As ``geometry_msgs/msg/WrenchStamped``.
        log_ns : int
            When it was received [ns since the epoch].
        data : bytes
            CDR with its encapsulation, as rclpy hands out with ``raw=True``.
        latched : bool
            Recorded as TRANSIENT_LOCAL; the first message of a topic decides.
        """
        with self._blamed():
            self._writer.write(self._connection(topic, msgtype, latched), log_ns, data)

    def _connection(self, topic: str, msgtype: str, latched: bool) -> Connection:
        name = '/' + topic.lstrip('/')
        connection = self._connections.get(name)
        if connection is None:
            if msgtype not in JAZZY.fielddefs:
                raise ConfigError(f'{name}: type {msgtype} is not part of ROS 2 Jazzy')
            connection = self._writer.add_connection(
                name, msgtype, typestore=JAZZY, offered_qos_profiles=[_quality(latched)])
            self._connections[name] = connection
        elif connection.msgtype != msgtype:
            raise ConfigError(f'{name}: has two types, {connection.msgtype} and {msgtype}')
        return connection

    def write(self, messages: Sequence[Messages]) -> None:
        """Write messages of several topics, merged by stamp."""
        with self._blamed():
            connections = [self._connection(one.topic, one.msgtype, one.latched)
                           for one in messages]
            stamps = [one.stamp_ns for one in messages]
            source = np.repeat(np.arange(len(messages)), [len(one) for one in stamps])
            merged = np.concatenate(stamps) if stamps else np.empty(0, int)
            order = np.argsort(merged, kind='stable')
            rows = [iter(one.rows) for one in messages]
            for i, stamp in zip(source[order].tolist(), merged[order].tolist()):
                self._writer.write(connections[i], stamp, next(rows[i]).data)

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """Say in one line which recording could not be written, and why."""
        try:
            yield
        except (OSError, sqlite3.Error, WriterError) as error:
            raise ConfigError(f'{self.path}: cannot be written ({error}); choose a writable '
                              'folder with enough space') from error


def write_signals(
        path: Path | str, signals: Mapping[str, Signal | None], start_ns: int,
        topics: Mapping[str, str] | None = None) -> None:
    """
    Write signals as a recording; what was there before is kept as ``path~``.

    Parameters
    ----------
    path : Path or str
        Folder of the recording.
    signals : mapping of str to Stream, PoseStream, phases, text or None
        By role, see :data:`forcecal_ros.core.topics.ROLES`; None is passed over. Times
        count from ``start_ns``.
    start_ns : int
        [ns since the epoch]
    topics : mapping of str to str, optional
        Role to topic name where it is not the usual one.

    Raises
    ------
    ConfigError
        The place cannot be written to.
    """
    names = topics or {}
    with BagWriter(path) as bag:
        bag.write([messages_of(role, signal, start_ns, names.get(role))
                   for role, signal in signals.items() if signal is not None])


def write_recording(path: Path | str, recording: Recording) -> None:
    """
    Write all that a recording holds, so that reading it again gives the same.

    Parameters
    ----------
    path : Path or str
        Folder of the recording.

    Raises
    ------
    ConfigError
        The place cannot be written to.
    """
    force, rates = recording.accelerometer, recording.angular_velocity
    signals: dict[str, Signal | None] = {
        role: getattr(recording, role)
        for role in ('wrench', 'pose', 'target', 'optidrive', 'contact_truth', 'joint_commands')}
    if force is not None and recording.accelerometer_unit == 'V':
        signals['accelerometer'] = force
    elif force is not None and rates is not None and np.array_equal(force.t, rates.t):
        signals['imu'] = Stream(force.t, np.hstack([force.values, rates.values]), force.frame)
    elif force is not None:
        signals['accel'] = force
    signals['joint_states'] = recording.joints
    signals['phase'] = recording.phases or None
    write_signals(path, signals, recording.start_ns)
