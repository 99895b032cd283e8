"""Stamps that jitter: set on arrival by a busy computer, around instants that were regular."""

from dataclasses import replace
from typing import NamedTuple, TypeVar

from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import PoseStream, Stream
import numpy as np
from scipy.ndimage import uniform_filter1d

SPAN = 50
"""Intervals that a period is averaged over: bursts of arrival are shorter, pauses rarer."""

NOTICED = 0.25
"""
Jitter below this part of the period stays as it is.

It moves a reading by less than half-way to its neighbour, so that their order and the gaps
between them mean what they say; drivers that stamp in the sensor stay far below it.
"""

WINDOW = 0.2
"""Offsets of arrival are averaged over that long: clocks do not drift within it [s]."""

PAUSE = 6.0
"""An interval longer than the period by so many standard deviations of the jitter is a pause."""

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
    """

    period: float
    std: float


def jitter_of(t: Array) -> Jitter:
    """
    Measure how far stamps lie from regular ones, pauses left out.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Increasing [s].
    """
    if len(t) <= 2 * SPAN:
        period = float(np.median(np.diff(t))) if len(t) > 1 else np.nan
        return Jitter(period, 0.0)
    period = float(np.median(t[SPAN:] - t[:-SPAN]) / SPAN)
    line = t - period * np.arange(len(t))
    off = np.abs(line - uniform_filter1d(line, SPAN, mode='nearest'))
    return Jitter(period, 1.4826 * float(np.median(off)))


def evened(t: Array) -> tuple[Array, Jitter]:
    """
    Replace stamps that jitter by the regular instants they lie around.

    Each stretch between two pauses is evened by itself. What all stamps are late by stays: that
    is a delay, which is identified like any other.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Increasing [s].

    Returns
    -------
    t : ndarray, shape (n,)
        As they were where they do not jitter.
    jitter : Jitter
    """
    jitter = jitter_of(t)
    if not jitter.std > NOTICED * jitter.period:
        return t, jitter
    pauses = np.flatnonzero(np.diff(t) > 2 * jitter.period + PAUSE * jitter.std) + 1
    width = max(3, round(WINDOW / jitter.period))
    parts = []
    for part in np.split(t, pauses):
        line = jitter.period * np.arange(len(part))
        parts.append(line + uniform_filter1d(part - line, min(width, len(part)), mode='nearest'))
    even = np.concatenate(parts)
    return (even, jitter) if (np.diff(even) > 0).all() else (t, jitter)


def with_even_stamps(stream: _TimedStream) -> tuple[_TimedStream, Jitter]:
    """Return a stream with its stamps evened, and how they jittered."""
    t, jitter = evened(stream.t)
    return (stream if t is stream.t else replace(stream, t=t)), jitter
