"""Stamps as they come, to stamps that increase: which messages to keep, and why not the others."""

from bisect import bisect_left
from typing import NamedTuple

from forcecal_ros.recording.checks import limits
import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

_BACK = round(limits.BACK * 1e9)
_DAY = 86400 * 10**9


class Order(NamedTuple):
    """
    Messages to keep, by increasing stamp.

    Attributes
    ----------
    kept : ndarray of int
        Into the stamps given.
    jumped : int
        Messages left out because the clock jumped.
    repeated : int
        Messages left out because an earlier one has the same stamp.
    """

    kept: Integers
    jumped: int
    repeated: int


def increasing(stamps: Integers) -> Order:
    """
    Choose the messages whose stamps make one increasing series.

    Messages that are out of order by less than a second are sorted. Where the clock jumps
    further back, the stretches that hold most messages and still increase are kept; so are not
    stretches more than a day away from the longest one.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        In the order of recording [ns].
    """
    if not len(stamps) or ((np.diff(stamps) > 0).all() and stamps[-1] - stamps[0] < _DAY):
        return Order(np.arange(len(stamps)), 0, 0)
    cuts = np.flatnonzero(np.abs(np.diff(stamps.astype(float))) > _BACK) + 1
    bounds = np.concatenate([[0], cuts, [len(stamps)]])
    kept = np.zeros(len(stamps), bool)
    for stretch in _largest_chain(
            np.minimum.reduceat(stamps, bounds[:-1]), np.maximum.reduceat(stamps, bounds[:-1]),
            np.diff(bounds)):
        kept[bounds[stretch]:bounds[stretch + 1]] = True
    index = np.flatnonzero(kept)
    index = index[np.argsort(stamps[index], kind='stable')]
    index = _same_day(stamps, index)
    jumped = len(stamps) - len(index)
    fresh = np.concatenate([[True], np.diff(stamps[index]) > 0])
    return Order(index[fresh], jumped, int((~fresh).sum()))


def _largest_chain(first: Integers, last: Integers, weight: Integers) -> list[int]:
    """Return the stretches, in order, that follow each other in time and weigh most together."""
    ends: list[int] = []
    totals: list[int] = []
    tips: list[int] = []
    previous: list[int] = []
    for i, (start, end, own) in enumerate(zip(first.tolist(), last.tolist(), weight.tolist())):
        place = bisect_left(ends, start + 1)
        total = own + (totals[place - 1] if place else 0)
        previous.append(tips[place - 1] if place else -1)
        place = bisect_left(ends, end)
        if place and totals[place - 1] >= total:
            continue
        worse = place
        while worse < len(ends) and totals[worse] <= total:
            worse += 1
        ends[place:worse], totals[place:worse], tips[place:worse] = [end], [total], [i]
    chain = []
    i = tips[-1]
    while i >= 0:
        chain.append(i)
        i = previous[i]
    return chain[::-1]


def _same_day(stamps: Integers, index: Integers) -> Integers:
    """Keep the largest group of stamps that no gap of a day or more splits."""
    cuts = np.flatnonzero(np.diff(stamps[index].astype(float)) > _DAY) + 1
    groups = np.split(index, cuts)
    return max(groups, key=len)
