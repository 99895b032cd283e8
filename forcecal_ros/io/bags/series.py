"""Messages of one topic, batch by batch, to one series of increasing stamps."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.topics import POSE, Topic
from forcecal_ros.io.bags.files import Batch, Integers, Notes
from forcecal_ros.io.bags.header_stamps import increasing, usable_stamps
from forcecal_ros.io.bags.messages import CdrError, Decoder, Group
from forcecal_ros.io.bags.storage import Bag
import numpy as np
from numpy.typing import NDArray

STARTS = 2.0
"""One message of stamp zero begins a recording where the next comes within so many seconds, or so
many periods of a slower topic: clocks that were set count from 1970 or from when they started."""


class Series(NamedTuple):
    """Increasing stamps [ns since the epoch] and rows of numbers or of text, read-only."""

    stamp_ns: Integers
    values: NDArray[Any]
    frame: str

    def seconds(self, start_ns: int) -> Array:
        """Return the stamps [s] since ``start_ns``."""
        return frozen(np.asarray((self.stamp_ns - start_ns) / 1e9))


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, so that a stream may keep it without a copy."""
    array.setflags(write=False)
    return array


class Collector:
    """
    Takes in the batches of one topic.

    Parameters
    ----------
    fields : sequence of str
        Paths of the columns.
    text : bool
        Whether the columns are strings.
    """

    def __init__(self, bag: Bag, topic: Topic, fields: Sequence[str], *,
                 text: bool = False) -> None:
        self._decoder = Decoder(bag.typestore(), topic.type)
        self._topic = topic
        self._fields = fields
        self._text = text
        self._width = 0
        self._frames: Counter[str] = Counter()
        self._without: Counter[str] = Counter()
        self._parts: list[tuple[Integers, Integers, NDArray[Any]]] = []

    def add(self, batch: Batch) -> None:
        """Take in a batch."""
        for group in self._decoder.groups(batch):
            try:
                values = self._columns(group)
            except CdrError as error:
                self._without[str(error)] += len(group.where)
                continue
            log = batch.log_ns[group.where]
            stamps = group.stamps()
            self._parts.append((log if stamps is None else stamps, log, values))
            self._frames[group.layout.text.get('header.frame_id', '')] += len(group.where)

    def _columns(self, group: Group) -> NDArray[Any]:
        if self._text:
            texts = [group.layout.text.get(field, '') for field in self._fields]
            return np.full((len(group.where), len(texts)), texts, dtype=object)
        values = group.columns(self._fields)
        if self._frames and values.shape[1] != self._width:
            raise DataError(
                f'{self._topic.name}: the arrays in {", ".join(self._fields)} vary in length '
                f'({self._width} and {values.shape[1]} numbers); choose fixed elements, as in '
                f'{self._fields[0]}[0]')
        self._width = values.shape[1]
        return values

    def series(self, notes: Notes, *, unreadable: bool = False) -> Series | None:
        """
        Return what was taken in, by increasing stamp, and say what was not; then forget it.

        Parameters
        ----------
        unreadable : bool
            Keep messages with NaN and infinite numbers, for checks to count; what is no rotation
            is NaN then.
        """
        name = self._topic.name
        if self._decoder.undecodable:
            notes.add(f'{name}: {self._decoder.undecodable} messages could not be decoded as '
                      f'{self._topic.type} and were left out')
        for what, count in self._without.items():
            notes.add(f'{name}: {count} messages were left out: {what}')
        if not self._frames:
            notes.add(f'{name}: no message in the recording')
        if not self._parts:
            return None
        frame, count = self._frames.most_common(1)[0]
        if len(self._frames) > 1:
            others = ', '.join(sorted(set(self._frames) - {frame})[:4])
            notes.add(f'{name}: frame_id is {frame!r} in {count} messages, but {others!r} in '
                      f'{self._frames.total() - count}')
        whole = self._without_broken(notes, unreadable)
        return self._in_order(*whole, frame, notes) if len(whole[0]) else None

    def _without_broken(self, notes: Notes, unreadable: bool
                        ) -> tuple[Integers, Integers, NDArray[Any]]:
        """Return stamps, times of recording and values of the messages that can be used."""
        stamps, log, values = map(np.concatenate, zip(*self._parts))
        self._parts = []
        broken = _unstamped(stamps)
        if broken.mean() > 0.5:
            notes.add(f'{self._topic.name}: header stamps are zero; the recording times were used '
                      'instead')
            stamps, broken = log, np.zeros(len(stamps), bool)
        if self._topic.type == POSE:
            astray = _unusable_poses(values)
            if unreadable and astray.any():
                values = np.where(astray[:, np.newaxis], np.nan, values)
            broken |= astray & (not unreadable)
        elif not (self._text or unreadable):
            broken |= ~np.isfinite(values).all(axis=1)
        if broken.any():
            notes.add(f'{self._topic.name}: {int(broken.sum())} messages without stamp or with '
                      'missing, NaN or infinite values were left out')
            stamps, log, values = stamps[~broken], log[~broken], values[~broken]
        return self._stamped(stamps, log, values, notes), log, values

    def _stamped(self, stamps: Integers, log: Integers, values: NDArray[Any], notes: Notes
                 ) -> Integers:
        """Return the stamps, or the times of recording where those are of no clock."""
        if self._text:
            return stamps
        measured = values[:, :3] if self._topic.type == POSE else values
        found = usable_stamps(self._topic.name, stamps, log, measured)
        if found.note:
            notes.add(found.note)
        return found.stamps

    def _in_order(self, stamps: Integers, log: Integers, values: NDArray[Any], frame: str,
                  notes: Notes) -> Series:
        name = self._topic.name
        if (np.diff(log) < 0).any():
            order = np.argsort(log, kind='stable')
            stamps, values = stamps[order], values[order]
        kept, jumped, repeated = increasing(stamps)
        if jumped:
            notes.add(f'{name}: {jumped} messages were left out because their stamps jump')
        if repeated:
            notes.add(f'{name}: {repeated} messages with a duplicate stamp were left out')
        if len(kept) < len(stamps) or (np.diff(kept) != 1).any():
            stamps, values = stamps[kept], values[kept]
        return Series(frozen(stamps), frozen(values), frame)


def series_of(bag: Bag, topic: Topic, fields: Sequence[str], *, text: bool = False
              ) -> Series | None:
    """Read fields of one topic, as a :class:`Collector`; None where no message has them."""
    collector = Collector(bag, topic, fields, text=text)
    for batch in bag.batches({topic}):
        collector.add(batch)
    return collector.series(bag.notes)


def _unstamped(stamps: Integers) -> NDArray[np.bool_]:
    """Tell whose stamp is zero because none was set; simulated time may begin at zero."""
    unset: NDArray[np.bool_] = stamps == 0
    later = stamps[~unset]
    if unset.sum() == 1 and len(later) > 1 and later.min() < STARTS * max(
            10**9, float(np.median(np.abs(np.diff(later))))):
        return np.zeros_like(unset)
    return unset


def _unusable_poses(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell where an orientation is no rotation or a position infinite; NaN is unknown."""
    with np.errstate(over='ignore'):
        norm = np.linalg.norm(values[:, 3:], axis=1)
    broken: NDArray[np.bool_] = ~(np.abs(norm - 1.0) < 0.1) | np.isinf(values[:, :3]).any(axis=1)
    return broken
