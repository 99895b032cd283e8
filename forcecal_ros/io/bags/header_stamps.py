"""Stamps as messages bear them: of no clock, of two senders, and those that do not increase."""

from bisect import bisect_left
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.streams import CLOCK_JUMP_S, MANY_MESSAGES, SLOWEST_HZ
import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

FEWEST = 50
"""Fewer messages tell nothing of how a topic is stamped."""

COARSE = 0.05
"""From this share of messages on that bear the stamp of the one before and say something else,
stamps do not resolve the messages: drivers that are read twice in a period repeat the values."""

ALIKE = 0.05
"""The clocks of stamps and of recording are alike where they pass at the same rate to this share;
one that is a thousand times as fast is so to the same share."""

SHORT_STEP, LONG_STEP = 1_500_000, 20_000_000
"""Stamps in steps between these are rounded [ns]: below, a turn is off by little, beyond, nothing
shows whether they are rounded or cut off, and by half of so much."""

EVENLY = 0.5
"""Messages come more evenly than their stamps say where their intervals scatter by less than this
share: the same messages lost from both leave them alike."""


ALTERNATES = 5.0
"""Messages of two senders differ from the next by so many times what they differ from the one
after that by, at rest too: motion makes that half, noise one. A simulator whose commands hold for
two samples alternates while it moves; a ripple of half the sampling rate is in few channels, not
in half of them."""


class Stamped(NamedTuple):
    """Stamps to use [ns], and a note on it; empty: they are those of the headers."""

    stamps: Integers
    note: str


def usable_stamps(name: str, stamps: Integers, log: Integers, values: NDArray[Any]) -> Stamped:
    """
    Take the times of recording where header stamps are cut off or hold another unit.

    Parameters
    ----------
    name : str
        Of the topic, for messages.
    stamps, log : ndarray of int, shape (n,)
        In the header and when recorded [ns].
    values : ndarray, shape (n, k)

    Raises
    ------
    DataError
        Stamps make no sense and the times of recording cannot take their place; or two senders
        publish on the topic.
    """
    if len(stamps) < FEWEST:
        return Stamped(stamps, '')
    order = np.argsort(log, kind='stable')
    refuse_two_senders(name, values[order])
    if (step := _steps_of(stamps[order], log[order])):
        return Stamped(log - round(float(np.median(log - stamps))), (
            f'{name}: stamps have a resolution of {step / 1e6:.3g} ms, like single-precision '
            'floats; the recording times were used instead'))
    why = _cut_off(stamps[order], values[order])
    passed, took = (float(x[order[-1]] - x[order[0]]) for x in (stamps, log))
    if not why:
        if MANY_MESSAGES <= len(stamps) < SLOWEST_HZ * passed / 1e9 and took > 0.0 and (
                abs(passed / took / 1000.0 - 1.0) < ALIKE):
            raise DataError(
                f'{name}: its stamps run 1000 times as fast as its messages arrive: the seconds '
                'are in milliseconds; fix the driver, and record again')
        return Stamped(stamps, '')
    apart = abs(float(np.median(log - stamps))) / 1e9
    # whole seconds are off by up to one
    if abs(passed - took) < ALIKE * took + 1e9 and apart < CLOCK_JUMP_S + 1.0 and (
            len(np.unique(log)) == len(log)):
        return Stamped(log, f'{name}: {why}; the recording times were used instead')
    if len(np.unique(stamps)) > len(stamps) / 2:  # the others can be left out
        return Stamped(stamps, '')
    raise DataError(f'{name}: {why}; stamp in integer nanoseconds in the driver, and record again')


def _steps_of(stamps: Integers, log: Integers) -> int:
    """Return the steps that stamps come in where messages come more evenly [ns]; 0: in none."""
    steps, came = np.diff(stamps), np.diff(log)
    step = int(np.gcd.reduce(steps))
    passed, took = float(stamps[-1] - stamps[0]), float(log[-1] - log[0])
    rounded = SHORT_STEP < step < LONG_STEP and came.min() > 0 and (
        abs(passed - took) < ALIKE * took and float(came.std()) < EVENLY * float(steps.std()))
    return step if rounded else 0


def _cut_off(stamps: Integers, values: NDArray[Any]) -> str:
    """Say why stamps do not tell messages apart; empty: they do."""
    same = np.flatnonzero(np.diff(stamps) == 0)
    one, next_one = values[same], values[same + 1]
    other = (one != next_one) & ~(np.isnan(one) & np.isnan(next_one))
    share = float(other.any(axis=1).sum()) / (len(stamps) - 1)
    if share > COARSE:
        return (f'{share:.0%} of the messages have the stamp of the previous message but other '
                'values: stamps are truncated to seconds or to single precision')
    nanoseconds, seconds = stamps % 10**9, len(np.unique(stamps // 10**9))
    if 2 < seconds < len(stamps) / 2 and 0 < nanoseconds.max() < 10**6:
        unit = 'micro' if nanoseconds.max() > 1000 else 'milli'
        return f'the field nanosec of its stamps contains {unit}seconds'
    return ''


def refuse_two_senders(name: str, values: NDArray[Any]) -> None:
    """
    Refuse messages that come from two sensors in turn.

    Raises
    ------
    DataError
        Names the topic and how far the senders are apart.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=0))  # poses may say no place
    steps = np.stack([np.abs(values[k:, known][:len(values) - 2] - values[:-2, known])
                      for k in (1, 2)])
    parts = np.array_split(steps, steps.shape[1] // FEWEST + 1, axis=1)
    at_rest = min((np.median(one, axis=1) for one in parts), key=lambda one: one[1].sum())
    next_one, one_after = np.median(steps, axis=1)
    moving = one_after > 0.0
    apart = moving & (next_one > ALTERNATES * one_after) & (at_rest[0] > ALTERNATES * at_rest[1])
    if moving.any() and apart.sum() >= max(2, moving.sum() / 2):
        j = int(np.argmax(next_one))
        raise DataError(
            f'{name}: messages alternate between two sensors (column {known[j] + 1} changes by '
            f'{next_one[j]:.3g} per message, by {one_after[j]:.3g} over two): two drivers publish '
            'on one topic; use one topic for each, and record again')


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
    further back, the stretches that hold most messages and still increase are kept, but for those
    more than a day away from the longest one.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        In the order of recording [ns].
    """
    if not len(stamps) or ((np.diff(stamps) > 0).all() and stamps[-1] - stamps[0] < 86400 * 10**9):
        return Order(np.arange(len(stamps)), 0, 0)
    cuts = np.flatnonzero(np.abs(np.diff(stamps.astype(float))) > 1e9 * CLOCK_JUMP_S) + 1
    bounds = np.concatenate([[0], cuts, [len(stamps)]])
    kept = np.zeros(len(stamps), bool)
    for stretch in _largest_chain(
            np.minimum.reduceat(stamps, bounds[:-1]), np.maximum.reduceat(stamps, bounds[:-1]),
            np.diff(bounds)):
        kept[bounds[stretch]:bounds[stretch + 1]] = True
    index = np.flatnonzero(kept)
    index = index[np.argsort(stamps[index], kind='stable')]
    days = np.flatnonzero(np.diff(stamps[index].astype(float)) > 86400 * 10**9) + 1
    index = max(np.split(index, days), key=len)  # the largest part without a gap of a day
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

