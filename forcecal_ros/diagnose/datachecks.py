"""What shows in stamps and values before any model: clocks, gaps, lattices, clipping, lines."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.diagnose.channels import CHANNELS, COLUMNS
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Recording
import numpy as np
from numpy.typing import NDArray

SKEW = 1e-5
"""Relative difference of two clocks that is no rounding."""

FARTHEST = 0.02
"""Relative difference of two clocks beyond which the rate is another one."""

PAUSE = 0.5
"""Silence that is no lost samples [s]."""

LOST = 5e-4
"""Fraction of missing samples that counts as dropouts."""

JITTER = 0.15
"""Scatter of the stamps about their line, in periods, that counts."""

COARSE = 0.17
"""Step of a lattice of values, in noise RMS, whose rounding is 5 % of the noise."""

CLIPPED = 5
"""Samples at the very same extreme value, neighbours among them, that count as clipping."""

ROUGH = 2.0
"""Step of a lattice, in noise RMS, from which the highest value is repeated as any other."""

LINE = 35.0
"""Power of a spectral line over the median of its neighbourhood."""


class Clock(NamedTuple):
    """
    What the stamps of one stream say.

    Attributes
    ----------
    stream : str
    rate : float
        [Hz] that the stream should have: the rig's, else the nearest whole number.
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


class Lattice(NamedTuple):
    """Values of one channel that are multiples of a step."""

    channel: str
    step: float


class Clipping(NamedTuple):
    """Values of one channel that stop at a limit."""

    channel: str
    limit: float
    samples: int


class Line(NamedTuple):
    """A spectral line in one channel's residual."""

    channel: str
    frequency: float
    amplitude: float
    power: float


def clocks(recording: Recording, rates: Mapping[str, float] = MappingProxyType({})
           ) -> tuple[Clock, ...]:
    """
    Judge the stamps of every stream.

    Parameters
    ----------
    recording : Recording
    rates : mapping of str to float
        Of each stream, where they are known [Hz].

    Returns
    -------
    tuple of Clock
    """
    found = []
    for name in ('wrench', 'accelerometer', 'optidrive', 'pose', 'target'):
        stream = getattr(recording, name)
        if stream is not None and len(stream) > 100:
            found.append(_clock(name, np.asarray(stream.t), rates.get(name)))
    return tuple(found)


def _clock(name: str, t: Array, nominal: float | None) -> Clock:
    steps = np.diff(t)
    period = float(np.median(steps))
    index = np.concatenate([[0.0], np.cumsum(np.maximum(1.0, np.rint(steps / period)))])
    # after a pause the samples may be on another line of the same slope
    part = np.concatenate([[0], np.cumsum(steps > max(PAUSE, 2.0 * period))])
    slope, offset = _line(index, t, part)
    index = np.rint((t - offset) / slope)
    slope, offset = _line(index, t, part)
    rate = max(1.0, round(1.0 / slope))
    if nominal and abs(nominal * slope - 1.0) < FARTHEST:
        rate = nominal
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
            if c.stream != 'target' and abs(c.skew - reference) < FARTHEST
            and abs(c.skew - reference) > SKEW + 5.0 * c.std
            and c.jitter * c.rate < JITTER}


def dropouts(found: tuple[Clock, ...]) -> dict[str, float]:
    """Return the fraction of lost samples of each sensor, where it counts."""
    return {c.stream: c.lost for c in found if c.lost > LOST}


def lattices(recording: Recording, noise: Array) -> tuple[Lattice, ...]:
    """
    Find channels whose values are multiples of a step that matters.

    Parameters
    ----------
    recording : Recording
    noise : ndarray, shape (16,)
        RMS of one sample.

    Returns
    -------
    tuple of Lattice
    """
    found = []
    for c, values in _channels(recording):
        step = _step(values)
        if step > COARSE * noise[c] and np.ptp(values) > 2.0 * step:
            found.append(Lattice(CHANNELS[c].name, step))
    return tuple(found)


def _step(values: Array) -> float:
    different = np.unique(values)
    if len(different) > 0.5 * len(values) or len(different) < 3:
        return 0.0
    gaps = np.diff(different)
    gaps = gaps[gaps > 1e-9 * np.abs(different).max()]
    step = float(np.percentile(gaps, 10))
    if step <= 0.0:
        return 0.0
    turns = (different - different[0]) / step
    step *= float(turns[-1] / np.rint(turns[-1])) if turns[-1] > 0.5 else 1.0
    off = (different - different[0]) / step
    return step if np.sqrt(np.mean((off - np.rint(off)) ** 2)) < 0.1 else 0.0


def clipping(recording: Recording, steps: tuple[Lattice, ...], noise: Array
             ) -> tuple[Clipping, ...]:
    """
    Find channels that stop at a limit.

    Parameters
    ----------
    recording : Recording
    steps : tuple of Lattice
        Channels on a lattice repeat values of themselves; rough ones say nothing.
    noise : ndarray, shape (16,)
        RMS of one sample.

    Returns
    -------
    tuple of Clipping
    """
    coarse, found = {s.channel: s.step for s in steps}, []
    for c, values in _channels(recording):
        if coarse.get(CHANNELS[c].name, 0.0) > ROUGH * noise[c]:
            continue
        for extreme in (values.max(), values.min()):
            at = values == extreme
            runs = int(np.sum(at[1:] & at[:-1]))
            least = 40 if CHANNELS[c].name in coarse else CLIPPED
            if at.sum() >= least and runs >= 0.5 * at.sum() and np.ptp(values) > 0.0:
                found.append(Clipping(CHANNELS[c].name, float(extreme), int(at.sum())))
    return tuple(found)


def _channels(recording: Recording) -> list[tuple[int, Array]]:
    out = []
    for name in ('wrench', 'accelerometer', 'optidrive'):
        stream = getattr(recording, name)
        if stream is not None and len(stream):
            first = COLUMNS[name].start
            out += [(first + i, stream.values[:, i]) for i in range(stream.values.shape[1])]
    return out


def lines(rows: Array, rate: float, name: str) -> tuple[Line, ...]:
    """
    Find spectral lines in the residual of one stream.

    Parameters
    ----------
    rows : ndarray, shape (n, columns)
        Measured less simulated, equally spaced.
    rate : float
        [Hz]
    name : str
        Of the stream.

    Returns
    -------
    tuple of Line
        Above 8 Hz, the strongest of each channel.
    """
    n, found = len(rows), []
    window = np.hanning(n)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    for i in range(rows.shape[1]):
        spectrum = np.fft.rfft((rows[:, i] - rows[:, i].mean()) * window)
        power = np.abs(spectrum) ** 2
        floor = _floor(power)
        ratio = np.where(frequency > 8.0, power / floor, 0.0)
        ratio[-3:] = 0.0
        k = int(ratio.argmax())
        wide = ratio[max(0, k - 60):k + 61]
        narrow = np.sum(wide > 0.25 * ratio[k]) <= 8
        if ratio[k] > LINE and narrow:
            amplitude = float(np.sqrt(power[k]) * 2.0 / window.sum())
            found.append(Line(CHANNELS[COLUMNS[name].start + i].name,
                              _peak(rows[:, i] * window, float(frequency[k]), rate),
                              amplitude, float(ratio[k])))
    return tuple(found)


def _peak(rows: Array, near: float, rate: float) -> float:
    """Frequency of the strongest line within a bin of one [Hz]."""
    t, width = np.arange(len(rows)) / rate, rate / len(rows)
    for fineness in (0.25, 0.05, 0.01):
        tried = near + fineness * width * np.arange(-5, 6)
        power = [abs(np.exp(-2j * np.pi * f * t) @ rows) for f in tried]
        near = float(tried[int(np.argmax(power))])
    return near


def _floor(power: Array) -> Array:
    """Median of the neighbourhood of every bin."""
    width = 101
    n = len(power) // width * width
    if n < 3 * width:
        return np.full(len(power), float(np.median(power)) + 1e-300)
    middle = np.median(power[:n].reshape(-1, width), axis=1)
    centres = (np.arange(len(middle)) + 0.5) * width
    return np.asarray(np.interp(np.arange(len(power)), centres, middle) + 1e-300)
