"""Recordings to arrays."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from heapq import heappop, heappush
from pathlib import Path
import shlex
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, matrix_from_quaternion
from forcecal_ros.core.streams import JointStream, phases_of, PoseStream, Recording, Stream
from forcecal_ros.core.topics import (
    candidates,
    find_topics,
    IMU,
    JOINT_STATE,
    MAIN_ROLES,
    naming_words,
    Topic,
    VECTOR3,
)
from forcecal_ros.io.bags.files import Notes
from forcecal_ros.io.bags.messages import FIELDS, joint_names, JOINTS
from forcecal_ros.io.bags.poses import FROM_TF, pose_of_joints, pose_series
from forcecal_ros.io.bags.poses import FROM_URDF as URDF
from forcecal_ros.io.bags.series import Collector, frozen, Series, series_of
from forcecal_ros.io.bags.storage import Bag
from forcecal_ros.io.transforms import TF
import numpy as np

_STREAMS = ('wrench', 'accelerometer', 'imu', 'accel', 'pose', 'target', 'optidrive',
            'contact_truth', 'joint_commands')


def read_recording(
        path: Path | str, topics: Mapping[str, str] | None = None,
        wrench_sign: int | None = None, *, joints: bool = False) -> Recording:
    """
    Read a rosbag2 recording: a folder or one file, SQLite or MCAP, compressed or not.

    Times are header stamps (times of recording where those are zero), increasing; messages
    with repeated or jumping stamps are left out and counted in ``notes``. Numbers are as they
    came, NaN and infinite ones included: :mod:`forcecal_ros.checks` judges them. What is
    not recorded is None, a topic without a message is an empty stream.

    Parameters
    ----------
    topics : mapping of str to str, optional
        Role to topic name where it is not the usual one of
        :data:`forcecal_ros.core.topics.ROLES`. ``tf:BASE:SENSOR`` as ``pose`` takes it from
        /tf and /tf_static, where it is also looked for if there is no other pose, of the wrench's
        frame in the root of its tree. ``urdf:FILE:BASE:LINK`` takes it from joint states and a
        URDF, which may be a topic of the recording.
    wrench_sign : int, optional
        -1 for a driver that reports the wrench of the tool on its environment; it is kept.
    joints : bool
        Whether to read the measured positions of joints, too.

    Raises
    ------
    DataError
        There is no recording, nothing in it can be read, or a topic is missing, of the wrong
        type or one of several that would do.
    ConfigError
        A role does not exist.
    """
    named = dict(topics or {})
    chain = named.pop('pose') if named.get('pose', '').startswith((FROM_TF, URDF)) else ''
    with Bag(path) as bag:
        # two arms' joint states are ambiguous only if they are needed
        chosen = ('joint_states',) if joints or chain.startswith(URDF) else ()
        found, mismatches = find_topics(bag.topics, named, (*_STREAMS, 'phase', *chosen))
        joint_states = found.get('joint_states') if joints else found.pop('joint_states', None)
        for mismatch in mismatches:
            bag.notes.add(mismatch)
        _choose_accelerometer(found, named, bag.notes)
        if chain:
            found.pop('pose', None)
        series = _read_series(bag, found)
        pose_of = ''
        if chain.startswith(URDF):
            found['pose'] = Topic(chain, JOINT_STATE)
            series[found['pose']], pose_of = pose_of_joints(bag, chain, joint_states)
        elif 'pose' not in found:
            pose_of = _pose_of_transforms(bag, chain, found, series)
        return _recording(bag, found, series, wrench_sign, pose_of)


def _pose_of_transforms(bag: Bag, chain: str, found: dict[str, Topic],
                        series: dict[Topic, Series]) -> str:
    """Find a pose in /tf, of frames named or of the wrench's; return the frame that it is of."""
    wrench = series.get(found['wrench']) if 'wrench' in found else None
    if not chain and (wrench is None or not wrench.frame):
        return ''
    answer = pose_series(bag, chain, wrench.frame if wrench else '')
    if answer is None:
        return ''
    found['pose'] = Topic('/tf', TF)
    series[found['pose']], pose_of = answer
    return pose_of


def _choose_accelerometer(found: dict[str, Topic], given: Mapping[str, str], notes: Notes) -> None:
    """Let one topic be the accelerometer; an IMU keeps its gyro."""
    sources = [role for role in ('accelerometer', 'imu', 'accel') if role in found]
    sources.sort(key=lambda role: role not in given)
    if not sources:
        return
    chosen = found[sources[0]]
    if len(sources) > 1:
        ignored = ', '.join(found[role].name for role in sources[1:])
        notes.add(f'accelerometer: {chosen.name} is used, {ignored} is ignored')
    found['accelerometer'] = chosen
    found.pop('accel', None)
    if chosen.type == IMU:
        found['imu'] = chosen


def _read_series(bag: Bag, found: Mapping[str, Topic]) -> dict[Topic, Series]:
    measured = _measured_joints(bag, found)
    collectors = {
        topic: Collector(bag, topic, [f'position[{name}]' for name in measured])
        if role == 'joint_states'
        else Collector(bag, topic, ['status[0].message'], text=True) if role == 'phase'
        else Collector(bag, topic, (JOINTS[topic.type],)) if role == 'joint_commands'
        else Collector(bag, topic, FIELDS[topic.type]) for role, topic in found.items()}
    for batch in bag.batches(set(collectors)):
        collectors[batch.topic].add(batch)
    series = {topic: collector.series(bag.notes, unreadable=True) or Series(
        np.empty(0, np.int64), np.empty((0, len(FIELDS.get(topic.type, ('text',))))), '')
              for topic, collector in collectors.items()}
    longest = max((one.stamp_ns for one in series.values()), key=len, default=np.empty(0))
    for topic, one in list(series.items()):
        if len(one.stamp_ns):
            days = max(one.stamp_ns[0] - longest[-1], longest[0] - one.stamp_ns[-1]) / 86400e9
            if days >= 1.0:
                del series[topic]
                bag.notes.add(f'{topic.name} is stamped {days:.0f} days from the other topics, by '
                              'another clock, and was left out')
    return series


def _recording(bag: Bag, found: Mapping[str, Topic], series: Mapping[Topic, Series],
               wrench_sign: int | None, pose_of: str) -> Recording:
    received = [one.stamp_ns for one in series.values() if len(one.stamp_ns)]
    if not received:
        what = _how_to_name(bag, found)
        if any(topic.type == JOINT_STATE for topic in bag.topics):
            what += '; joint states give the pose, but the wrench must be recorded'
        raise DataError(f'{bag.path}: nothing to read; {what}'
                        + ''.join(f'; {note}' for note in bag.notes))
    start_ns = int(min(stamps[0] for stamps in received))
    end = float(max(stamps[-1] for stamps in received) - start_ns) / 1e9
    if bag.notes.ends_early:
        bag.notes.add(f'the recording ends early, at {end:.1f} s: its file is damaged or cut off')

    by_role = {role: series[topic] for role, topic in found.items() if topic in series}

    def stream(role: str, columns: slice = slice(None), scale: int = 1) -> Stream | None:
        one = by_role.get(role)
        return one and Stream(one.seconds(start_ns), frozen(one.values[:, columns] * scale),
                              one.frame)

    def poses(role: str, of: str = '') -> PoseStream | None:
        one = by_role.get(role)
        return one and PoseStream(one.seconds(start_ns), one.values[:, :3],
                                  frozen(_rotations(one.values[:, 3:])), one.frame, of)

    def joints(role: str, names: tuple[str, ...]) -> JointStream | None:
        one = stream(role)
        return None if one is None else JointStream(one.t, one.values, one.frame, names)

    words = by_role.get('phase')
    in_volts = 'accelerometer' not in found or found['accelerometer'].type == VECTOR3
    return Recording(
        wrench=stream('wrench', scale=wrench_sign or 1),
        accelerometer=stream('accelerometer', slice(3)),
        accelerometer_unit='V' if in_volts else 'm/s^2',
        pose=poses('pose', pose_of), target=poses('target'), optidrive=stream('optidrive'),
        contact_truth=stream('contact_truth'), angular_velocity=stream('imu', slice(3, 6)),
        joint_commands=joints('joint_commands', _joint_names(bag, found.get('joint_commands'))),
        joints=joints('joint_states', _measured_joints(bag, found)),
        phases=() if words is None else phases_of(
            zip(words.seconds(start_ns).tolist(), words.values[:, 0].tolist()), end),
        start_ns=start_ns, source=str(bag.path), notes=tuple(bag.notes),
        topics={role: (topic.name, topic.type) for role, topic in found.items()},
        candidates=candidates(bag.topics, found, _STREAMS), wrench_sign=wrench_sign)


def _how_to_name(bag: Bag, found: Mapping[str, Topic]) -> str:
    """Say what a recording holds of which nothing was read, and how to name it by role."""
    names = ', '.join(sorted(topic.name for topic in bag.topics))
    if not names:
        return 'it has no topics; record again'
    roles = f'{", ".join(MAIN_ROLES)}, target, joint_commands, ...'
    words = naming_words(candidates(bag.topics, found, MAIN_ROLES))
    command = shlex.join(('forcecal', 'check', str(bag.path), *words))
    topics = dict(word.split('=') for word in words[1::2])
    return f'it has {names}; assign topics to roles ({roles})' + (
        f': {command}; in Python topics={topics}' if topics else '')


def _rotations(quaternions: Array) -> Array:
    """Return the rotation matrices of xyzw quaternions, NaN where there are none."""
    known = np.isfinite(quaternions).all(axis=1)
    R = np.full((len(quaternions), 3, 3), np.nan)
    R[known] = matrix_from_quaternion(quaternions[known])
    return R


def _joint_names(bag: Bag, topic: Topic | None) -> tuple[str, ...]:
    """Return the names that the first message gives to its joints."""
    return () if topic is None else next(
        joint_names(bag.typestore(), topic.type, bag.batches({topic})), ())


def _measured_joints(bag: Bag, found: Mapping[str, Topic]) -> tuple[str, ...]:
    """Return the joints to be read of joint_states: as commanded, else as first listed."""
    states = found.get('joint_states')
    if states is None:
        return ()
    return _joint_names(bag, found.get('joint_commands')) or _joint_names(bag, states)


class BagChunk(NamedTuple):
    """Some messages of one topic: its name as requested, stamps (n,) [s], values (n, k)."""

    topic: str
    t: Array
    values: Array


def read_chunks(path: Path | str, topics: Mapping[str, Sequence[str]]) -> Iterator[BagChunk]:
    """
    Read fields of some topics in the order of recording.

    Stamps increase within a topic, across its pieces too; what does not is left out. Numbers are
    as they came, NaN and infinite ones included.

    Parameters
    ----------
    topics : mapping of str to sequence of str
        Fields by topic, as ``wrench.force.x``, ``data`` (a whole array), ``data[3]`` or
        ``position[joint_1]``; none given: what the topic's type usually has.

    Raises
    ------
    DataError
        A topic is missing, or its type has no usual fields.
    """
    with Bag(path) as bag:
        chosen = {_topic(bag, name): name for name in topics}
        for topic, name in chosen.items():
            if not topics[name] and topic.type not in FIELDS:
                raise DataError(f'{bag.path}: {topic.name} is {topic.type}; pass the fields to '
                                'read')
        collectors = {topic: Collector(bag, topic, topics[name] or FIELDS[topic.type])
                      for topic, name in chosen.items()}
        waiting = dict.fromkeys(chosen, 0)
        start_ns: int | None = None
        last = dict.fromkeys(chosen, -np.inf)

        def flush(topic: Topic) -> Iterator[BagChunk]:
            nonlocal start_ns
            series = collectors[topic].series(bag.notes, unreadable=True)
            waiting[topic] = 0
            if series is None:
                return
            start_ns = int(series.stamp_ns[0]) if start_ns is None else start_ns
            t = series.seconds(start_ns)
            later = t > last[topic]
            if later.any():
                last[topic] = float(t[-1])
                yield BagChunk(chosen[topic], t[later],
                            np.asarray(series.values[later], dtype=float))

        for batch in bag.batches(set(chosen)):
            collectors[batch.topic].add(batch)
            waiting[batch.topic] += len(batch.start)
            if waiting[batch.topic] >= 50_000:
                yield from flush(batch.topic)
        for topic, count in waiting.items():
            if count:
                yield from flush(topic)


def _topic(bag: Bag, name: str) -> Topic:
    same = [one for one in bag.topics if one.name.lstrip('/') == name.lstrip('/')]
    if not same:
        raise DataError(f'{bag.path}: no topic {name}; topics are '
                        f'{", ".join(sorted(one.name for one in bag.topics)) or "none"}')
    if len(same) > 1:
        bag.notes.add(f'{name} has messages of several types; only {same[0].type} was read')
    return same[0]


def read_calibrations(path: Path | str, topics: Mapping[str, str] | None = None) -> list[str]:
    """
    Read the calibrations that were published while recording, as texts.

    Parameters
    ----------
    topics : mapping of str to str, optional
        As for :func:`read_recording`.

    Returns
    -------
    list of str
        In the order of recording; empty where there is no such topic.

    Raises
    ------
    DataError
        See :func:`read_recording`.
    """
    with Bag(path) as bag:
        found = find_topics(bag.topics, topics or {}, ['calibration'])[0]
        if 'calibration' not in found:
            return []
        series = series_of(bag, found['calibration'], ['data'], text=True)
        return [] if series is None else [str(text) for text in series.values[:, 0]]


WINDOW = 2_000_000_000
"""Messages are put in order among those recorded within so long of each other [ns]."""


class Raw(NamedTuple):
    """One message: when it was recorded [ns since the epoch], topic, CDR with encapsulation."""

    log_ns: int
    topic: Topic
    data: bytes


def read_topics(path: Path | str) -> tuple[Topic, ...]:
    """
    Return the topics of a recording.

    Raises
    ------
    DataError
        There is no recording.
    """
    with Bag(path) as bag:
        return bag.topics


def read_messages(path: Path | str, chosen: Callable[[Topic], bool] = lambda topic: True
                  ) -> Iterator[Raw]:
    """
    Read the messages of a recording, split, compressed or not, in the order of recording.

    Parameters
    ----------
    path : Path or str
        rosbag2 folder or file.
    chosen : callable
        Whether a topic is read.

    Raises
    ------
    DataError
        There is no recording.
    """
    with Bag(path) as bag:
        heap: list[tuple[int, int, Raw]] = []
        count, newest = 0, 0
        for batch in bag.batches({topic for topic in bag.topics if chosen(topic)}):
            stamps = batch.log_ns.tolist()
            for start, length, log_ns in zip(batch.start.tolist(), batch.length.tolist(), stamps):
                heappush(heap, (log_ns, count, Raw(
                    log_ns, batch.topic, batch.buffer[start:start + length])))
                count += 1
            newest = max(newest, *stamps, 0)
            while heap and heap[0][0] < newest - WINDOW:
                yield heappop(heap)[2]
        while heap:
            yield heappop(heap)[2]
