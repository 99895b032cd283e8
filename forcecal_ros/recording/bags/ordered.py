"""Every message of a recording as it was on the wire, in the order of recording."""

from collections.abc import Callable, Iterator
from heapq import heappop, heappush
from pathlib import Path
from typing import NamedTuple

from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.topics import Topic

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
