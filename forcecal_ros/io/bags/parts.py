"""Parts of recordings: chunks in constant memory, single fields, messages as they were."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from heapq import heappop, heappush
from pathlib import Path
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.topics import find_topics, Topic
from forcecal_ros.io.bags.collect import Collector
from forcecal_ros.io.bags.signals import FIELDS
from forcecal_ros.io.bags.storage import Bag
import numpy as np

ROWS = 50_000
"""About how many messages of a topic make a piece."""


class BagChunk(NamedTuple):
    """Some messages of one topic: its name as asked for, stamps (n,) [s], values (n, k)."""

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
        Fields by topic, as for :func:`~forcecal_ros.io.bags.read_columns`; none given:
        what the topic's type usually has.

    Raises
    ------
    DataError
        A topic is missing, or its type has no usual fields.
    """
    with Bag(path) as bag:
        wanted = {_topic(bag, name): name for name in topics}
        collectors = {topic: Collector(bag, topic, topics[name] or _usual_fields(bag, topic))
                      for topic, name in wanted.items()}
        waiting = dict.fromkeys(wanted, 0)
        start_ns: int | None = None
        last = dict.fromkeys(wanted, -np.inf)

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
                yield BagChunk(wanted[topic], t[later],
                            np.asarray(series.values[later], dtype=float))

        for batch in bag.batches(set(wanted)):
            collectors[batch.topic].add(batch)
            waiting[batch.topic] += len(batch.start)
            if waiting[batch.topic] >= ROWS:
                yield from flush(batch.topic)
        for topic, count in waiting.items():
            if count:
                yield from flush(topic)


def _topic(bag: Bag, name: str) -> Topic:
    same = [one for one in bag.topics if one.name.lstrip('/') == name.lstrip('/')]
    if not same:
        raise DataError(f'{bag.path}: no topic {name}; there are '
                        f'{", ".join(sorted(one.name for one in bag.topics)) or "none"}')
    return same[0]


def _usual_fields(bag: Bag, topic: Topic) -> Sequence[str]:
    if topic.type not in FIELDS:
        raise DataError(f'{bag.path}: {topic.name} is {topic.type}; name the fields to read')
    return FIELDS[topic.type]


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


def read_columns(path: Path | str, topic: str, fields: Sequence[str]) -> Columns:
    """
    Read numbers of any message type.

    Parameters
    ----------
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
        collector = Collector(bag, same[0], fields)
        for batch in bag.batches({same[0]}):
            collector.add(batch)
        series = collector.series(bag.notes)
        if series is None:
            raise DataError(f'{path}: {topic} ({same[0].type}) has no message with '
                            f'{", ".join(fields)}' + ''.join(f'; {note}' for note in bag.notes))
        start_ns = int(series.stamp_ns[0])
        return Columns(series.seconds(start_ns), np.asarray(series.values, dtype=float),
                       series.frame, start_ns, tuple(bag.notes))


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
        topic = found['calibration']
        collector = Collector(bag, topic, ['data'], text=True)
        for batch in bag.batches({topic}):
            collector.add(batch)
        series = collector.series(bag.notes)
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


def read_messages(path: Path | str, wanted: Callable[[Topic], bool] = lambda topic: True
                  ) -> Iterator[Raw]:
    """
    Read the messages of a recording, split, compressed or not, in the order of recording.

    Parameters
    ----------
    path : Path or str
        rosbag2 folder or file.
    wanted : callable
        Says which topics are read.

    Raises
    ------
    DataError
        There is no recording.
    """
    with Bag(path) as bag:
        heap: list[tuple[int, int, Topic, bytes]] = []
        count, newest = 0, 0
        for batch in bag.batches({topic for topic in bag.topics if wanted(topic)}):
            stamps = batch.log_ns.tolist()
            for start, length, log_ns in zip(batch.start.tolist(), batch.length.tolist(), stamps):
                heappush(heap, (log_ns, count, batch.topic, batch.buffer[start:start + length]))
                count += 1
            newest = max(newest, *stamps, 0)
            while heap and heap[0][0] < newest - WINDOW:
                yield _popped(heap)
        while heap:
            yield _popped(heap)


def _popped(heap: list[tuple[int, int, Topic, bytes]]) -> Raw:
    log_ns, _, topic, data = heappop(heap)
    return Raw(log_ns, topic, data)
