"""Streams that arrive in any order, used as if they had arrived in the order of their stamps.

What a wrench of stamp t is worth must not depend on which topic was quicker. So a wrench waits
until each stream that flows has said all it has to say about t, and the rules below look at
stamps only. They hold as long as no message is overtaken by more than ``skew``:

- A sampled channel (accelerometer, displacement) is interpolated between the samples around t.
  A wrench waits for the later one. A gap longer than ``timeout`` is not bridged; the channel
  counts as missing there, and until ``skew`` after it resumes.
- The pose is filtered, never interpolated: a wrench uses all poses up to t. It waits only when
  one is due, that is, when 0.9 of the last interval has passed since the last pose.
- A stream that stops holds the output back once, for ``timeout + skew``, and no longer.
"""

from math import inf
from typing import Any, NamedTuple

SAME = 1e-7
"""Stamps closer than this are one instant; a float holds them better than clocks do [s]."""

_HANDFUL = 6

Entry = tuple[Any, ...]
"""(time, usable from, values...)"""


class Channel(NamedTuple):
    """
    A stream that is interpolated.

    Attributes
    ----------
    samples : tuple of Entry
        Those that may still be needed, in order of time.
    last : float
        The newest stamp, as sent [s].
    wash : tuple of 3 float
        What an AC-coupled accelerometer has forgotten of the specific force [m/s^2].
    """

    samples: tuple[Entry, ...] = ()
    last: float = -inf
    wash: tuple[float, float, float] = (0.0, 0.0, 0.0)


class PoseQueue(NamedTuple):
    """Poses not yet used, each ``(stamp, effective, position, q)``; ``due`` is the next's."""

    pending: tuple[Entry, ...] = ()
    last: float = -inf
    due: float = -inf


def usable_from(
        last: float, t: float, lead: float, first: float, timeout: float, skew: float) -> float:
    """
    Return when a sample at ``t`` may be used, if it begins a run; -inf if it continues one.

    Parameters
    ----------
    last, t : float
        Stamps of the sample before (-inf: none) and of this one [s].
    lead : float
        How much later than its instant the sample is stamped [s].
    first : float
        Stamp of the first wrench, inf before it [s].
    timeout, skew : float
        [s]

    Returns
    -------
    float
        [s]
    """
    before = last if last > -inf else first
    return t + skew - min(lead, 0.0) if t - before > timeout else -inf


def around(samples: tuple[Entry, ...], t: float, timeout: float) -> tuple[Entry, Entry] | None:
    """
    Find the samples before and after ``t``.

    Parameters
    ----------
    samples : tuple of Entry
        In order of time.
    t : float
        [s]
    timeout : float
        Longest gap that is bridged [s].

    Returns
    -------
    tuple of two Entry, or None
        The same one twice where it lies at ``t``; None where ``t`` is in a gap.
    """
    i = len(samples) - 1
    while i >= 0 and samples[i][0] > t:
        i -= 1
    if i < 0:
        return None
    before = samples[i]
    if before[1] > t:
        return None
    if t - before[0] < SAME:
        return before, before
    if i + 1 == len(samples):
        return None
    after = samples[i + 1]
    return (before, after) if after[0] - before[0] <= timeout else None


def pruned(samples: tuple[Entry, ...], t: float) -> tuple[Entry, ...]:
    """
    Drop the samples that no instant from ``t`` on needs.

    Parameters
    ----------
    samples : tuple of Entry
    t : float
        [s]

    Returns
    -------
    tuple of Entry
    """
    i, end = 0, len(samples) - 1
    while i < end and samples[i + 1][0] <= t:
        i += 1
    return samples[i:] if i else samples


def pruned_channel(channel: Channel, t: float) -> Channel:
    """
    Drop the samples that no instant from ``t`` on needs, a handful at a time.

    Parameters
    ----------
    channel : Channel
    t : float
        [s]

    Returns
    -------
    Channel
        The same one where there is little to drop.
    """
    samples = channel.samples
    if len(samples) <= _HANDFUL or samples[_HANDFUL][0] > t:
        return channel
    return Channel(pruned(samples, t), channel.last, channel.wash)


def bounded(samples: tuple[Entry, ...], wait: float) -> tuple[Entry, ...]:
    """
    Drop samples that are too old for any wrench still to come, lest they pile up without one.

    Parameters
    ----------
    samples : tuple of Entry
    wait : float
        Longest that a wrench waits [s].

    Returns
    -------
    tuple of Entry
    """
    oldest = samples[-1][0] - 2 * wait
    return samples if samples[0][0] >= oldest else pruned(samples, oldest)


def channel_ready(
        channel: Channel, t: float, now: float, first: float, wait: float) -> bool:
    """
    Whether a channel has said all about ``t``, or has stopped.

    Parameters
    ----------
    channel : Channel
    t, now, first : float
        Stamps of the wrench in question, of the newest and of the first one [s].
    wait : float
        ``timeout + skew`` [s].

    Returns
    -------
    bool
    """
    samples = channel.samples
    return bool(samples and samples[-1][0] > t - SAME) or now >= max(channel.last, first) + wait


def pose_ready(queue: PoseQueue, t: float, now: float, first: float, timeout: float,
               skew: float) -> bool:
    """
    Whether no pose up to ``t`` is to be expected any more.

    Parameters
    ----------
    queue : PoseQueue
    t, now, first : float
        Stamps of the wrench in question, of the newest and of the first one [s].
    timeout, skew : float
        [s]

    Returns
    -------
    bool
    """
    return (t < queue.due or now >= t + skew
            or t > max(queue.last, first) + timeout + skew)


def queued_pose(queue: PoseQueue, t: float, value: Entry, first: float, timeout: float,
                skew: float) -> PoseQueue:
    """
    Append a pose.

    Parameters
    ----------
    queue : PoseQueue
    t : float
        Its stamp, later than the last [s].
    value : tuple
        Position and quaternion.
    first, timeout, skew : float
        [s]

    Returns
    -------
    PoseQueue
    """
    usable = usable_from(queue.last, t, 0.0, first, timeout, skew)
    interval = t - queue.last
    due = t + 0.9 * interval if interval <= timeout else t
    pending = bounded((*queue.pending, (t, max(t, queue.due, usable), *value)), timeout + skew)
    return PoseQueue(pending, t, due)
