"""Single fields of any message, and texts, out of recordings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.bags.collect import Collector
from forcecal_ros.recording.bags.storage import Bag
from forcecal_ros.recording.topics import find_topics
import numpy as np


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
