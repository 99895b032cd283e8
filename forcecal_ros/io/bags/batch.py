"""Serialised messages by the thousand: one buffer, and where in it each message lies."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from forcecal_ros.core.topics import Topic
import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]


class Notes:
    """Plain sentences on what reading had to leave out or mend, each said once."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Add a sentence, unless a hundred were said before."""
        if len(self._sentences) < 100:
            self._sentences[sentence] = None

    def __iter__(self) -> Iterator[str]:
        return iter(self._sentences)


class Batch(NamedTuple):
    """
    Messages of one topic.

    Attributes
    ----------
    start, length : ndarray of int, shape (n,)
        Where each message lies in the buffer [bytes].
    log_ns : ndarray of int, shape (n,)
        When each was recorded [ns since the epoch].
    """

    topic: Topic
    buffer: bytes
    start: Integers
    length: Integers
    log_ns: Integers


def at_offsets(buffer: bytes, offsets: Integers, dtype: str) -> NDArray[Any]:
    """
    Read one item of a type at each offset, which need not be aligned.

    Parameters
    ----------
    offsets : ndarray of int, shape (n,)
        Each with a whole item behind it [bytes].
    dtype : str
        ``V40`` for 40 raw bytes.

    Returns
    -------
    ndarray, shape (n,)
        A copy.
    """
    kind = np.dtype(dtype)
    if not len(offsets):
        return np.empty(0, kind)
    items = len(buffer) - kind.itemsize + 1
    return np.ndarray((items,), kind, buffer, strides=(1,))[offsets]
