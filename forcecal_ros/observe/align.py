"""Streams that arrive in any order, used as if they had arrived in the order of their stamps.

What a wrench of stamp t is worth must not depend on which topic was quicker. So a wrench waits
until each stream that flows has shown all it has about t, and the rules below look at
stamps only. They hold as long as no message is overtaken by more than ``skew``:

- A sampled channel (accelerometer, displacement) is interpolated between the samples around t.
  A wrench waits for the later one. A gap longer than ``timeout`` is not bridged; the channel
  counts as missing there, and until ``skew`` after it resumes.
- The pose is filtered, never interpolated: a wrench uses all poses up to t. It waits only when
  one is due, that is, when 0.9 of the last interval has passed since the last pose.
- A stream that stops holds the output back once, for ``timeout + skew``, and no longer.
"""

from math import inf, nan
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array

SAME_STAMP_S = 1e-7
"""Stamps closer than this are one instant; a float holds them better than clocks do [s]."""


Entry = tuple[Any, ...]
"""(time, usable from, values...)"""

Samples = tuple[Entry, ...] | Array
"""Entries, or an array with one in each row."""


class Channel(NamedTuple):
    """
    A stream that is interpolated.

    Attributes
    ----------
    samples : tuple of Entry
        Those that may still be needed, in order of time.
    last : float
        The newest stamp, as sent [s].
    highpass : tuple of 3 float
        High-pass state: what an AC-coupled accelerometer has lost of the specific force
        [m/s^2].
    """

    samples: tuple[Entry, ...] = ()
    last: float = -inf
    highpass: tuple[float, float, float] = (0.0, 0.0, 0.0)


class PoseQueue(NamedTuple):
    """Poses not yet used, each ``(stamp, effective, position, q)``; ``due`` is the next's."""

    pending: tuple[Entry, ...] = ()
    last: float = -inf
    due: float = -inf


def run_of(usable: float, last: float, t: float, lead: float, first: float, timeout: float,
           skew: float) -> tuple[bool, float]:
    """
    Return whether a sample at ``t`` begins a run, and from which stamp on its run may be used.

    Parameters
    ----------
    usable : float
        Of the sample before [s].
    last, t : float
        Stamps of the sample before (-inf: none) and of this one [s].
    lead : float
        How much later than its instant the sample is stamped [s].
    first : float
        Stamp of the first wrench, inf before it [s].
    """
    if t - last <= timeout:
        return False, usable
    before = last if last > -inf else first
    return True, t + skew - min(lead, 0.0) if t - before > timeout else -inf


def turn_of(last: float, due: float, t: float, first: float, timeout: float, skew: float
            ) -> tuple[float, float]:
    """Return from which stamp on a pose at ``t`` counts, and when the next one is due [s]."""
    _, usable = run_of(-inf, last, t, 0.0, first, timeout, skew)
    interval = t - last
    return max(t, due, usable), t + 0.9 * interval if interval <= timeout else t


def around(samples: Samples, t: float, timeout: float) -> tuple[int, int]:
    """
    Find the samples before and after ``t``, gaps up to ``timeout`` bridged.

    The same one twice where it lies at ``t``; -1 twice where ``t`` is in a longer gap.
    """
    i = len(samples) - 1
    while i >= 0 and samples[i][0] > t:
        i -= 1
    if i < 0 or samples[i][1] > t:
        return -1, -1
    before = samples[i][0]
    if t - before < SAME_STAMP_S:
        return i, i
    if i + 1 == len(samples) or samples[i + 1][0] - before > timeout:
        return -1, -1
    return i, i + 1


class Reading(NamedTuple):
    """
    Reading of the accelerometer at one instant.

    Attributes
    ----------
    known : bool
        Whether there is one.
    full : bool
        Whether it is at the end of its range.
    run : float
        Which uninterrupted run of samples this belongs to.
    f : tuple of 3 float
        Specific force [m/s^2].
    integral : tuple of 3 float
        Of it over time since the run began [m/s]; zero if not requested.
    """

    known: bool
    full: bool
    run: float
    f: tuple[float, float, float]
    integral: tuple[float, float, float]


SILENT = Reading(False, False, inf, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def force_at(samples: Samples, t: float, timeout: float, integrated: bool) -> Reading:
    """
    Interpolate the accelerometer.

    Parameters
    ----------
    samples : tuple of Entry, or ndarray
        ``(time, usable from, specific force (3), its integral (3), full)``
    t, timeout
        As for :func:`around`.
    integrated : bool
        Whether the integral is needed.
    """
    i, j = around(samples, t, timeout)
    if i < 0:
        return SILENT
    a, b = samples[i], samples[j]
    x, y, z = a[2], a[3], a[4]
    if i < j:
        k = (t - a[0]) / (b[0] - a[0])
        x, y, z = x + k * (b[2] - x), y + k * (b[3] - y), z + k * (b[4] - z)
    integral = (0.0, 0.0, 0.0)
    if integrated:
        h = (t - a[0]) / 2
        integral = (a[5] + h * (a[2] + x), a[6] + h * (a[3] + y), a[7] + h * (a[4] + z))
    return Reading(True, a[8] > 0 or b[8] > 0, a[1], (x, y, z), integral)


def displacement_at(samples: Samples, t: float, timeout: float) -> float:
    """
    Interpolate the displacement [m]; NaN without a sensor.

    Samples are ``(time, usable from, displacement)``; t and timeout as for :func:`around`.
    """
    i, j = around(samples, t, timeout)
    if i < 0:
        return nan
    a, b = samples[i], samples[j]
    if i == j:
        return a[2]  # type: ignore[no-any-return]
    return a[2] + (t - a[0]) / (b[0] - a[0]) * (b[2] - a[2])  # type: ignore[no-any-return]


def pruned(samples: tuple[Entry, ...], t: float) -> tuple[Entry, ...]:
    """Drop the samples that no instant from ``t`` on needs."""
    i, end = 0, len(samples) - 1
    while i < end and samples[i + 1][0] <= t:
        i += 1
    return samples[i:] if i else samples


def pruned_channel(channel: Channel, t: float) -> Channel:
    """Drop the samples that no instant from ``t`` on needs, a handful at a time."""
    samples, last, highpass = channel
    if len(samples) <= 6 or samples[6][0] > t:
        return channel
    return Channel(pruned(samples, t), last, highpass)


def bounded(samples: tuple[Entry, ...], memory: float) -> tuple[Entry, ...]:
    """Drop samples older than ``memory`` [s], lest they pile up where no wrench comes."""
    oldest = samples[-1][0] - memory
    return samples if samples[0][0] >= oldest else pruned(samples, oldest)


def channel_ready(
        channel: Channel, t: float, now: float, first: float, wait: float) -> bool:
    """
    Whether a channel is complete up to ``t``, or has stopped.

    ``t``, ``now``, ``first`` are the stamps of the wrench in question, of the newest and of the
    first one; ``wait`` is ``timeout + skew`` [s].
    """
    samples, last, _ = channel
    if samples and samples[-1][0] > t - SAME_STAMP_S:
        return True
    return now >= (last if last > first else first) + wait


def pose_ready(queue: PoseQueue, t: float, now: float, first: float, timeout: float,
               skew: float) -> bool:
    """Whether no pose up to ``t`` is to be expected any more; stamps as in channel_ready."""
    return (t < queue.due or now >= t + skew
            or t > max(queue.last, first) + timeout + skew)


def queued_pose(queue: PoseQueue, t: float, value: Entry, first: float, timeout: float,
                skew: float, memory: float) -> PoseQueue:
    """Append a pose, ``value`` its position and quaternion, stamped later than the last."""
    effective, due = turn_of(queue.last, queue.due, t, first, timeout, skew)
    return PoseQueue(bounded((*queue.pending, (t, effective, *value)), memory), t, due)
