"""Recordings of any length, piece by piece: fields of several topics in constant memory."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.collect import Collector
from forcecal_ros.recording.bags.fields import FIELDS
from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.topics import Topic
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
    path : Path or str
    topics : mapping of str to sequence of str
        Fields by topic, as for :func:`~forcecal_ros.recording.bags.read_columns`; none given:
        what the topic's type usually has.

    Yields
    ------
    BagChunk

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
