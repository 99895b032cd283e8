"""Stamps that jitter: set on arrival by a busy computer, around instants that were regular."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream, Recording, Stream
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

SPAN = 50
"""Intervals that a period is averaged over: bursts of arrival are shorter, pauses rarer."""

NOTICED = 0.01
"""
Jitter below this part of the period stays as it is.

At 1.5 rad/s and 250 Hz it turns a pose by 60 urad, three times what such a pose resolves.
"""

SMOOTHER = 0.9
"""Signals are that much smoother over even stamps, in squares, where it is the stamps that jitter.

The ratio of two sums over some thousand windows of pure noise stays within 0.97 and 1.03.
"""

FIT, WINDOWS = 9, 4000
"""Samples in each window that a parabola is fitted to, and how many windows at most."""

HALF_WAY = 0.25
"""Jitter above this part of the period brings readings out of their order."""

WINDOW = 1.0
"""Lateness is averaged over that long: clocks drift apart by microseconds within it [s]."""

MOST_LOST = 2
"""Of so many samples one at least has arrived; bursts look as if far more had been lost."""

BY_LOSS = 0.25
"""
Samples count as lost where stamps are that much more regular with them counted.

Rounding to whole periods takes no more than two thirds off a jitter of three periods; where one
sample in five is lost and nothing jitters, it takes all.
"""

PAUSE = 6.0
"""An interval longer than the period by so many standard deviations of the jitter is a pause."""

LEAST_LATE = 0.02
"""Share of the messages of bursts that are less late than is taken for none: the last of each
burst, of which fifty messages at most make one."""

_TimedStream = TypeVar('_TimedStream', Stream, PoseStream)


class Jitter(NamedTuple):
    """
    How irregular stamps are.

    Attributes
    ----------
    period : float
        Between samples [s].
    std : float
        Of the stamps around regular instants [s].
    number : ndarray of int, shape (n,)
        Of each sample in the order in which the sensor took them, lost ones counted.
    """

    period: float
    std: float
    number: NDArray[np.intp]


def jitter_of(t: Array) -> Jitter:
    """
    Measure how far stamps lie from regular ones, pauses left out.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Increasing [s].
    """
    every = np.arange(len(t))
    if len(t) <= 2 * SPAN:
        return Jitter(float(np.median(np.diff(t))) if len(t) > 1 else np.nan, 0.0, every)
    steps = np.diff(t)
    lost = np.rint(steps / np.median(steps)).clip(min=1).astype(int)
    with_lost = np.concatenate([[0], np.cumsum(lost)])
    jitter = _around(t, every)
    if with_lost[-1] < MOST_LOST * len(t):
        counted = _around(t, with_lost)
        if counted.std < BY_LOSS * jitter.std:
            return counted
    return _with_short_pauses(t, _with_clear_pauses(t, jitter))


def _with_clear_pauses(t: Array, jitter: Jitter) -> Jitter:
    """
    Count the samples lost in pauses that single intervals show.

    How many they are follows from the mean lateness of the samples on either side: one interval
    is off by the jitter of its two ends.
    """
    longer = np.diff(t) - jitter.period
    pauses = np.flatnonzero(longer > 0.5 * jitter.period + PAUSE * jitter.std) + 1
    if not len(pauses):
        return jitter
    late = t - jitter.period * jitter.number
    parts = np.split(late, pauses)
    steps = [after[:SPAN].mean() - before[-SPAN:].mean() for before, after in pairwise(parts)]
    lost = np.zeros(len(t), dtype=int)
    lost[pauses] = np.rint(np.array(steps) / jitter.period).clip(min=1)
    return _around(t, jitter.number + np.cumsum(lost))


def _with_short_pauses(t: Array, jitter: Jitter) -> Jitter:
    """Count the samples lost in pauses that are too short to be seen among jittering intervals."""
    late = t - jitter.period * jitter.number
    sums = np.concatenate([[0.0], np.cumsum(late)])
    means = (sums[SPAN:] - sums[:-SPAN]) / SPAN
    step = np.zeros(len(t))
    step[SPAN:len(t) - SPAN + 1] = means[SPAN:] - means[:-SPAN]
    least = max(1.5 * jitter.period, PAUSE * 1.4826 * float(np.median(np.abs(step))))
    number = jitter.number.copy()
    while step.max() > least:
        i = int(np.argmax(step))
        first = max(1, i - SPAN // 2)
        longest = first + int(np.argmax(np.diff(t[first - 1:i + SPAN // 2])))
        number[longest:] += round(step[i] / jitter.period)
        step[max(0, i - SPAN):i + SPAN] = 0.0
    return _around(t, number) if number[-1] != jitter.number[-1] else jitter


def _around(t: Array, number: NDArray[np.intp]) -> Jitter:
    """Measure stamps against samples that are numbered so."""
    periods = (t[SPAN:] - t[:-SPAN]) / (number[SPAN:] - number[:-SPAN])
    # of long bursts a span has one gap more or less; one with a pause counts for nothing
    gap = np.quantile(np.diff(t), 1.0 - LEAST_LATE) / SPAN
    period = float(np.mean(periods[np.abs(periods - np.median(periods)) < 1.5 * gap]))
    line = t - period * number
    off = np.abs(line - uniform_filter1d(line, SPAN, mode='reflect'))
    return Jitter(period, 1.4826 * float(np.median(off)), number)


def even_instants(t: Array, jitter: Jitter) -> Array:
    """
    Return the regular instants around which stamps lie.

    Each stretch between two pauses is evened by itself. What all stamps are late by stays: that
    is a delay, which is identified like any other.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Increasing [s].
    jitter : Jitter
        Of these stamps.

    Returns
    -------
    ndarray, shape (n,)
        Increasing [s].
    """
    late = t - jitter.period * jitter.number
    pauses = np.flatnonzero(np.diff(late) > jitter.period + PAUSE * jitter.std) + 1
    width = max(3, round(WINDOW / jitter.period))
    even = np.concatenate([_even(part, number, width, jitter.period) for part, number in
                           zip(np.split(t, pauses), np.split(jitter.number, pauses))])
    return even if (np.diff(even) > 0).all() else t


def _even(t: Array, number: NDArray[np.intp], width: int, period: float) -> Array:
    """Even one stretch: a line, and what its samples are off it on average around each."""
    if len(t) < SPAN:
        line = period * (number - number[0])
        return np.asarray(line + np.mean(t - line))
    slope, start = np.polyfit(number - number[0], t, 1)
    line = start + slope * (number - number[0])
    return np.asarray(line + uniform_filter1d(t - line, min(width, len(t)), mode='reflect'))


def roughness(t: Array, values: Array) -> float:
    """Sum of squares by which values depart from parabolas over the samples around each."""
    begin = np.unique(np.linspace(0, len(t) - FIT, WINDOWS).astype(int))
    rows = begin[:, None] + np.arange(FIT)
    s = (t[rows] - t[rows].mean(axis=1, keepdims=True)) / np.ptp(t[rows], axis=1)[:, None]
    q, _ = np.linalg.qr(s[:, :, None] ** np.arange(3))
    y = values[rows]
    return float(((y - q @ (np.swapaxes(q, 1, 2) @ y))**2).sum())


def with_even_stamps(stream: _TimedStream, least: float = NOTICED
                     ) -> tuple[_TimedStream, Jitter]:
    """
    Even the stamps of a stream where it is they that jitter.

    A sensor that is read at irregular instants and stamped rightly moves smoothly over its own
    stamps, one that is stamped late does over even ones. Where the signal does not tell, stamps
    that jitter by more than half-way to their neighbours are evened.

    Parameters
    ----------
    least : float
        Jitter below this part of the period stays as it is.

    Returns
    -------
    stream : Stream or PoseStream
        The same where the stamps stay.
    jitter : Jitter
    """
    jitter = jitter_of(stream.t)
    if not jitter.std > least * jitter.period:
        return stream, jitter
    even = even_instants(stream.t, jitter)
    values = _columns(stream)
    ratio = roughness(even, values) / max(roughness(stream.t, values), np.finfo(float).tiny)
    if ratio > SMOOTHER and not (ratio < 1 / SMOOTHER and jitter.std > HALF_WAY * jitter.period):
        return stream, jitter
    if jitter.std > jitter.period:  # what arrives together was measured before
        even = even + np.quantile(stream.t - even, LEAST_LATE)
    return replace(stream, t=even), jitter


def _columns(stream: Stream | PoseStream) -> Array:
    if isinstance(stream, Stream):
        return stream.values
    rotation = stream.R_base_sensor.reshape(len(stream), 9)
    return np.hstack([rotation, stream.position]) if stream.has_position else rotation


def with_even_streams(recording: Recording, names: Sequence[str], least: float = NOTICED
                      ) -> Recording:
    """
    Even the stamps that jitter, and note whose.

    Parameters
    ----------
    names : sequence of str
        Of streams.
    least : float
        Jitter below this part of the period stays as it is.
    """
    changes: dict[str, Any] = {}
    notes = []
    for name in names:
        if (stream := getattr(recording, name)) is None:
            continue
        even, jitter = with_even_stamps(stream, least)
        if even is not stream:
            changes[name] = even
            notes.append(f'stamps of {name} jitter by {1e3 * jitter.std:.2g} ms around '
                         f'{1e3 * jitter.period:.3g} ms; evened out')
    return replace(recording, **changes, notes=(*recording.notes, *notes)) if notes else recording
