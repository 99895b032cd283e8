"""Recordings to arrays."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, NamedTuple

from forcecal_ros.bags.batch import Batch, Integers, Notes
from forcecal_ros.bags.cdr import CdrError, Decoder
from forcecal_ros.bags.clock import increasing
from forcecal_ros.bags.fields import FIELDS
from forcecal_ros.bags.storage import Bag
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, matrix_from_quaternion
from forcecal_ros.samples import Phase, PoseStream, Recording, Stream
from forcecal_ros.topics import (
    find_topics,
    IMU,
    POSE,
    ROLES,
    Topic,
    VECTOR3,
)
import numpy as np
from numpy.typing import NDArray

_STREAMS = ('wrench', 'accelerometer', 'imu', 'accel', 'pose', 'target', 'optidrive',
            'contact_truth')
_DAY = 86400.0


class Columns(NamedTuple):
    """
    Fields of one topic over time.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Header stamps, or times of recording for types without header [s] since ``start_ns``.
    values : ndarray, shape (n, k)
        One column a number, in the order of the fields asked for.
    frame : str
        frame_id of most messages.
    start_ns : int
        Stamp that t = 0 stands for [ns since the epoch].
    notes : tuple of str
        What had to be left out or mended.
    """

    t: Array
    values: Array
    frame: str
    start_ns: int
    notes: tuple[str, ...]


class _Series(NamedTuple):
    """Increasing stamps [ns since the epoch] and rows of numbers or of text."""

    stamp_ns: Integers
    values: NDArray[Any]
    frame: str


class _Collector:
    """Takes in the batches of one topic and makes one series of them."""

    def __init__(self, bag: Bag, topic: Topic, fields: Sequence[str], *,
                 text: bool = False) -> None:
        self._decoder = Decoder(bag.typestore(), topic.type)
        self._topic = topic
        self._fields = fields
        self._text = text
        self._frames: Counter[str] = Counter()
        self._stamps: list[Integers] = []
        self._log: list[Integers] = []
        self._values: list[NDArray[Any]] = []
        self._without: Counter[str] = Counter()

    def add(self, batch: Batch) -> None:
        for group in self._decoder.groups(batch):
            try:
                if self._text:
                    texts = [group.layout.text.get(field, '') for field in self._fields]
                    values = np.full((len(group.where), len(texts)), texts, dtype=object)
                else:
                    values = group.columns(self._fields)
            except CdrError as error:
                self._without[str(error)] += len(group.where)
                continue
            log = batch.log_ns[group.where]
            stamps = group.stamps()
            self._stamps.append(log if stamps is None else stamps)
            self._log.append(log)
            self._values.append(values)
            self._frames[group.layout.text.get('header.frame_id', '')] += len(group.where)

    def series(self, notes: Notes) -> _Series | None:
        """Return what was taken in, by increasing stamp, and say what was not; then forget it."""
        name = self._topic.name
        if self._decoder.undecodable:
            notes.add(f'{name}: {self._decoder.undecodable} messages made no sense as '
                      f'{self._topic.type} and were left out')
        for what, count in self._without.items():
            notes.add(f'{name}: {count} messages were left out: {what}')
        widths = {part.shape[1] for part in self._values}
        if len(widths) > 1:
            raise DataError(f'{name}: the arrays in {", ".join(self._fields)} change their length '
                            f'({", ".join(map(str, sorted(widths)))}); choose fixed elements, '
                            f'as in {self._fields[0]}[0]')
        if not self._values:
            notes.add(f'{name}: no message in the recording')
            return None
        frame, count = self._frames.most_common(1)[0]
        if len(self._frames) > 1:
            others = ', '.join(sorted(set(self._frames) - {frame})[:4])
            notes.add(f'{name}: frame_id is {frame!r} in {count} messages, but {others!r} in '
                      f'{self._frames.total() - count}')
        stamps, log = _joined(self._stamps), _joined(self._log)
        values = _joined(self._values)
        return self._ordered(stamps, log, values, frame, notes)

    def _ordered(self, stamps: Integers, log: Integers, values: NDArray[Any], frame: str,
                 notes: Notes) -> _Series | None:
        name = self._topic.name
        empty = stamps == 0
        if empty.mean() > 0.5:
            notes.add(f'{name}: header stamps are zero; the times of recording were used')
            stamps, empty = log, np.zeros(len(stamps), bool)
        broken = empty if values.dtype == object else empty | ~np.isfinite(values).all(axis=1)
        if self._topic.type == POSE:
            broken = empty | _unusable_poses(values)
        if broken.any():
            notes.add(f'{name}: {int(broken.sum())} messages with NaN, infinite or no values or '
                      'without stamp were left out')
            stamps, log, values = stamps[~broken], log[~broken], values[~broken]
        if not len(stamps):
            return None
        if (np.diff(log) < 0).any():
            order = np.argsort(log, kind='stable')
            stamps, values = stamps[order], values[order]
        index, jumped, repeated = increasing(stamps)
        if jumped:
            notes.add(f'{name}: {jumped} messages were left out because their stamps jump')
        if repeated:
            notes.add(f'{name}: {repeated} messages with the stamp of another were left out')
        if len(index) < len(stamps) or (np.diff(index) != 1).any():
            stamps, values = stamps[index], values[index]
        return _Series(stamps, values, frame)


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    whole = np.concatenate(parts)
    parts.clear()
    return whole


def _unusable_poses(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell where an orientation is no rotation or a position infinite; NaN is unknown."""
    norm = np.linalg.norm(values[:, 3:], axis=1)
    broken: NDArray[np.bool_] = ~(np.abs(norm - 1.0) < 0.1) | np.isinf(values[:, :3]).any(axis=1)
    return broken


def read_recording(
        path: Path | str, topics: Mapping[str, str] | None = None, wrench_sign: int = 1,
        roles: Collection[str] | None = None) -> Recording:
    """
    Read a rosbag2 recording: a folder or one file, SQLite or MCAP, compressed or not.

    Times are header stamps (times of recording where those are zero), increasing; messages
    with NaN or infinite numbers, repeated or jumping stamps are left out and counted in
    ``notes``. What is not recorded is None.

    Parameters
    ----------
    path : Path or str
    topics : mapping of str to str, optional
        Role to topic name where it is not the usual one of :data:`forcecal_ros.topics.ROLES`.
    wrench_sign : int
        -1 for a driver that reports the wrench of the tool on its environment.
    roles : collection of str, optional
        What to read; everything a :class:`Recording` can hold if not given.

    Returns
    -------
    Recording

    Raises
    ------
    DataError
        There is no recording, nothing in it can be read, or a topic is missing, of the wrong
        type or one of several that would do.
    ConfigError
        A role does not exist.
    """
    wanted = [role for role in (*_STREAMS, 'phase') if roles is None or role in roles]
    with Bag(path) as bag:
        found, mismatches = find_topics(bag.topics, topics or {}, wanted)
        for mismatch in mismatches:
            bag.notes.add(mismatch)
        _choose_accelerometer(found, topics or {}, bag.notes)
        series = _read_series(bag, found)
        return _recording(bag, found, series, wrench_sign)


def _choose_accelerometer(
        found: dict[str, Topic], given: Mapping[str, str], notes: Notes) -> None:
    """Let one topic be the accelerometer; an IMU keeps its gyro besides."""
    sources = [role for role in ('accelerometer', 'imu', 'accel') if role in found]
    sources.sort(key=lambda role: role not in given)
    if not sources:
        return
    chosen = found[sources[0]]
    if len(sources) > 1:
        ignored = ', '.join(found[role].name for role in sources[1:])
        notes.add(f'the accelerometer is {chosen.name}, not {ignored}')
    found['accelerometer'] = chosen
    found.pop('accel', None)
    if chosen.type == IMU:
        found['imu'] = chosen


def _read_series(bag: Bag, found: Mapping[str, Topic]) -> dict[Topic, _Series]:
    collectors = {
        topic: _Collector(bag, topic, ['status[0].message'], text=True) if role == 'phase'
        else _Collector(bag, topic, FIELDS[topic.type]) for role, topic in found.items()}
    for batch in bag.batches(set(collectors)):
        collectors[batch.topic].add(batch)
    series = {topic: one for topic, collector in collectors.items()
              if (one := collector.series(bag.notes)) is not None}
    return _of_one_clock(series, bag.notes)


def _of_one_clock(series: dict[Topic, _Series], notes: Notes) -> dict[Topic, _Series]:
    """Leave out topics stamped by another clock than most messages."""
    if not series:
        return series
    longest = max(series.values(), key=lambda one: len(one.stamp_ns)).stamp_ns
    kept = {}
    for topic, one in series.items():
        apart = max(one.stamp_ns[0] - longest[-1], longest[0] - one.stamp_ns[-1]) / 1e9
        if apart < _DAY:
            kept[topic] = one
        else:
            notes.add(f'{topic.name} is stamped {apart / _DAY:.0f} days from the other topics, '
                      'by another clock: left out')
    return kept


def _recording(bag: Bag, found: Mapping[str, Topic], series: Mapping[Topic, _Series],
               wrench_sign: int) -> Recording:
    if not series:
        raise DataError(
            f'{bag.path}: nothing to read; it holds '
            f'{", ".join(sorted(topic.name for topic in bag.topics)) or "no topics"}; name the '
            'topics with --topic role=NAME' + ''.join(f'; {note}' for note in bag.notes))
    start_ns = int(min(one.stamp_ns[0] for one in series.values()))
    end = float(max(one.stamp_ns[-1] for one in series.values()) - start_ns) / 1e9

    def stream(role: str, columns: slice = slice(None), scale: int = 1) -> Stream | None:
        one = series.get(found[role]) if role in found else None
        if one is None:
            return None
        values = one.values[:, columns] if scale == 1 else one.values[:, columns] * scale
        return Stream(_seconds(one, start_ns), values, one.frame)

    def poses(role: str) -> PoseStream | None:
        one = series.get(found[role]) if role in found else None
        if one is None:
            return None
        return PoseStream(_seconds(one, start_ns), one.values[:, :3],
                          matrix_from_quaternion(one.values[:, 3:]), one.frame)

    in_volts = 'accelerometer' not in found or found['accelerometer'].type == VECTOR3
    return Recording(
        wrench=stream('wrench', scale=wrench_sign),
        accelerometer=stream('accelerometer', slice(3)),
        accelerometer_unit='V' if in_volts else 'm/s^2',
        pose=poses('pose'), target=poses('target'), optidrive=stream('optidrive'),
        contact_truth=stream('contact_truth'), angular_velocity=stream('imu', slice(3, 6)),
        phases=_phases(series.get(found['phase']) if 'phase' in found else None, start_ns, end),
        start_ns=start_ns, source=str(bag.path), notes=tuple(bag.notes))


def _seconds(series: _Series, start_ns: int) -> Array:
    return np.asarray((series.stamp_ns - start_ns) / 1e9)


def _phases(series: _Series | None, start_ns: int, end: float) -> tuple[Phase, ...]:
    """Turn changes, with or without repeats, into spans up to the next change or the end."""
    if series is None:
        return ()
    said = zip(_seconds(series, start_ns).tolist(), series.values[:, 0].tolist())
    changes = [next(same) for _, same in groupby(said, key=lambda one: one[1])]
    return tuple(Phase(name, start, stop)
                 for (start, name), (stop, _) in pairwise([*changes, (end, '')]))


def require(recording: Recording, roles: Collection[str]) -> None:
    """
    Refuse a recording that lacks something.

    Parameters
    ----------
    recording : Recording
    roles : collection of str
        ``wrench``, ``accelerometer``, ``pose``, ``target``, ``optidrive``, ``phase``, ...

    Raises
    ------
    DataError
        Names the topics that are missing and what reading had to say about them.
    """
    names = {'phase': 'phases', 'imu': 'angular_velocity', 'accel': 'accelerometer'}
    missing = [role for role in roles if not getattr(recording, names.get(role, role))]
    if not missing:
        return
    said = [note for note in recording.notes
            if any(ROLES[role].topic in note for role in missing)]
    raise DataError(
        f'{recording.source}: no messages of '
        f'{", ".join(f"{ROLES[role].topic} ({role})" for role in missing)}; name the topic with '
        f'--topic {missing[0]}=NAME' + ''.join(f'; {note}' for note in said))


def read_columns(path: Path | str, topic: str, fields: Sequence[str]) -> Columns:
    """
    Read numbers of any message type.

    Parameters
    ----------
    path : Path or str
    topic : str
        Name as recorded, with or without the leading slash.
    fields : sequence of str
        As ``wrench.force.x``, ``data`` (a whole array), ``data[3]``, ``position[joint_1]``.

    Raises
    ------
    DataError
        The topic or a field is missing, or no message can be read.
    """
    with Bag(path) as bag:
        same = [one for one in bag.topics if one.name.lstrip('/') == topic.lstrip('/')]
        if not same:
            raise DataError(f'{path}: no topic {topic}; there are '
                            f'{", ".join(sorted(one.name for one in bag.topics)) or "none"}')
        if len(same) > 1:
            bag.notes.add(f'{topic} has messages of several types; only {same[0].type} was read')
        collector = _Collector(bag, same[0], fields)
        for batch in bag.batches({same[0]}):
            collector.add(batch)
        series = collector.series(bag.notes)
        if series is None:
            raise DataError(f'{path}: {topic} ({same[0].type}) has no message with '
                            f'{", ".join(fields)}' + ''.join(f'; {note}' for note in bag.notes))
        start_ns = int(series.stamp_ns[0])
        return Columns(_seconds(series, start_ns), np.asarray(series.values, dtype=float),
                       series.frame, start_ns, tuple(bag.notes))


def read_texts(path: Path | str, role: str, topics: Mapping[str, str] | None = None) -> list[str]:
    """
    Read the strings said on a topic, as the calibration in force while recording.

    Parameters
    ----------
    path : Path or str
    role : str
        One of the roles of type std_msgs/String.
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
        found = find_topics(bag.topics, topics or {}, [role])[0]
        if role not in found:
            return []
        collector = _Collector(bag, found[role], ['data'], text=True)
        for batch in bag.batches({found[role]}):
            collector.add(batch)
        series = collector.series(bag.notes)
        return [] if series is None else [str(text) for text in series.values[:, 0]]
