"""Signals as arrays to the messages a recording holds of them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.geometry import Array, quaternion_from_matrix
from forcecal_ros.recording.bags.batch import Integers
from forcecal_ros.recording.bags.encode import encode
from forcecal_ros.recording.bags.fields import FIELDS
from forcecal_ros.recording.streams import JointStream, Phase, PoseStream, Stream
from forcecal_ros.recording.topics import DIAGNOSTICS, IMU, JOINT_STATE, POSE, ROLES
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import get_typestore, Stores


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
        One of :data:`forcecal_ros.recording.topics.ROLES`; decides topic and type.
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
