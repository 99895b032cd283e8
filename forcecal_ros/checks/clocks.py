"""What the stamps of a stream show of its clock: rate, skew, losses and jitter."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.checks.signals import PAUSE_S, present, STREAMS
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
import numpy as np
from numpy.typing import NDArray

SKEW, MAX_SKEW = 1e-5, 0.02
"""Relative difference of two clocks that is no rounding; beyond the second the rate is another."""

JITTER = 0.15
"""Scatter of the stamps about their line that counts [periods]."""


class Clock(NamedTuple):
    """
    What the stamps of one stream say.

    Attributes
    ----------
    stream : str
    rate : float
        [Hz] that the stream should have: the one known or a whole part of it, else the nearest
        whole number.
    skew : float
        Relative excess of the stamped period.
    lost : float
        Fraction of samples missing.
    jitter : float
        RMS about a straight line [s].
    std : float
        Of the skew.
    """

    stream: str
    rate: float
    skew: float
    lost: float
    jitter: float
    std: float


def clocks(recording: Recording, rates: Mapping[str, float] = MappingProxyType({})
           ) -> tuple[Clock, ...]:
    """
    Judge the stamps of every stream.

    Parameters
    ----------
    rates : mapping of str to float
        Of each stream, where they are known [Hz].
    """
    return tuple(_clock(name, stream.t, rates.get(name)) for name, stream in present(
        recording, STREAMS).items() if len(stream) > 100)


def _clock(name: str, t: Array, nominal: float | None) -> Clock:
    steps = np.diff(t)
    period = float(np.median(steps))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.rint(steps / period)))])
    # after a pause the samples may be on another line of the same slope
    part = np.concatenate([[0], np.cumsum(steps > max(PAUSE_S, 2.0 * period))])
    slope, offset = _line(index, t, part)
    index = np.rint((t - offset) / slope)
    slope, offset = _line(index, t, part)
    rate = max(1.0, round(1.0 / slope))
    if nominal:
        part_of = nominal / max(1, round(nominal * slope))  # every k-th sample, as drivers thin
        near, whole = abs(part_of * slope - 1.0), abs(rate * slope - 1.0)
        if near < (MAX_SKEW if part_of == nominal else whole):
            rate = part_of
    missing = float(np.sum((np.diff(index) - 1.0)[np.diff(part) == 0]))
    scatter = float(np.std(t - offset - slope * index))
    std = scatter * rate / float(np.std(index) * np.sqrt(len(index)))
    return Clock(name, rate, float(slope * rate - 1.0),
                 float(max(0.0, missing / (missing + len(t)))), scatter, std)


def _line(x: Array, y: Array, part: NDArray[np.intp]) -> tuple[float, Array]:
    """Fit lines of one slope; return it, and the offset of every sample's part."""
    count = np.bincount(part)
    x0, y0 = (np.bincount(part, v) / count for v in (x, y))
    dx = x - x0[part]
    slope = float(dx @ (y - y0[part]) / (dx @ dx))
    return slope, np.asarray((y0 - slope * x0)[part])


def skew_between(found: tuple[Clock, ...]) -> dict[str, float]:
    """Return the skew of each sensor's clock against that of the commands, where it counts."""
    reference = next((c.skew for c in found if c.stream == 'target'), 0.0)
    return {c.stream: c.skew - reference for c in found
            if c.stream != 'target' and abs(c.skew - reference) < MAX_SKEW
            and abs(c.skew - reference) > SKEW + 5.0 * c.std
            and c.jitter * c.rate < JITTER}


def dropouts(found: tuple[Clock, ...]) -> dict[str, float]:
    """Return the fraction of lost samples of each sensor, where it counts."""
    # fraction of missing samples that counts as dropouts
    lost_share = 5e-4
    return {c.stream: c.lost for c in found if c.lost > lost_share}
