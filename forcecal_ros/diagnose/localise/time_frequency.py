"""Which channels, phases and octaves hold more than noise at standstill; impulses and lines."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import Autoregression
from forcecal_ros.diagnose.inputs.channels import Blocks, CHANNELS, STREAM_SLICES
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

STRONG = 9.0
"""Sigmas of a bin's energy from which it is more than noise."""

IMPULSE = 7.0
"""Innovation, in its sigma, that noise does not make: an impulse."""

NEARLY = 5.0
"""Innovation, in its sigma, from which the tail of a noise shows."""

TAIL = 0.57
"""
Part of the innovations between NEARLY and IMPULSE that noise with a heavy tail has beyond: that of
Student's t with three degrees of freedom, about the heaviest that a sensor's was.
"""

IMPULSES = 4
"""So many impulses in a channel count; fewer may be by chance."""

BURST, LOUD = 25, 2.5
"""
Blocks (0.1 s) over which the level of noise is taken, and the mean square in that of the noise
from which it is a burst: by chance one of 20,000 such stretches has as much.
"""

IMPULSE_LASTS = 3
"""Blocks that one impulse may take, cut by two of them, or filtered."""

STEEPEST = 2.2
"""By how much the power of coloured noise may grow from one octave to the next lower one."""

LOWEST = 2.5
"""Factor by which coloured noise may grow further in the lowest band, which is many octaves."""

BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, 32.0),
         (32.0, 62.5), (62.5, 125.0))
"""Octaves [Hz] of the block means."""

RATE = 250.0
"""Block means a second [Hz]."""

SHORTEST, FEWEST = 50.0, 8
"""Stretch whose spectrum is taken, in blocks: 0.2 s tell octaves from 5 Hz on; its samples."""




class TimeFrequencyBin(NamedTuple):
    """Energy of one channel, phase and octave against the noise at standstill."""

    channel: int
    phase: str
    band: tuple[float, float]
    excess: float
    z: float

    @property
    def p(self) -> float:
        """One-sided probability by chance."""
        return float(ndtr(-self.z))


def time_frequency_bins(dataset: Blocks, noise: Autoregression,
                        residual: Array) -> list[TimeFrequencyBin]:
    """
    Compare the energy of every channel, phase and octave with the noise at standstill.

    Noise that is stronger in a phase, or for a moment, at all frequencies is still noise: the
    highest octave's ratio divides the others', and bursts are brought to the usual level.

    Parameters
    ----------
    residual : ndarray, shape (n, channels)
    """
    resting = max(1, int((dataset.groups == 0).sum()))
    scatter = 2.0 / max(20.0, resting / 10.0)
    rest = noise._replace(coefficients=np.repeat(noise.coefficients[:1], 3, axis=0),
                          sigma=np.repeat(noise.sigma[:1], 3, axis=0))
    phases, found = dataset.phase_rows(), []
    for c in range(len(CHANNELS)):
        if not noise.sigma[:, c].any():
            continue
        white = rest.whiten(residual[:, c][np.newaxis], c)[0]
        there, spacing = noise.present[:, c], noise.spacing(c)
        even = _without_bursts(white[there])
        octaves = {word: _octaves(even, (rows & noise.rows[:, c])[there], spacing)
                   for word, rows in phases.items()}
        expected = _colour(list(octaves.values()))
        for word, (energy, dof) in octaves.items():
            ratio = energy / np.maximum(dof, 1.0) / expected
            common = max(1.0, float(ratio[-1])) if dof[-1] > 20 else 1.0
            for b, band in enumerate(BANDS[:-1]):
                if dof[b] >= 4:
                    over = ratio[b] / common - 1.0
                    z = over / np.sqrt(2.0 / dof[b] + scatter)
                    z = min(z, _cube_root(ratio[b] / common, dof[b]))
                    found.append(TimeFrequencyBin(c, word, band, float(np.sqrt(max(0.0, over))),
                                                  float(z)))
    return sorted(found, key=lambda one: -one.z)


def _without_bursts(white: Array) -> Array:
    """Bring innovations to unit variance wherever they are larger at the highest frequencies."""
    if len(white) < BURST:
        return white
    quick = np.diff(white, 2, prepend=white[:1], append=white[-1:]) / np.sqrt(6.0)
    level = np.convolve(quick ** 2, np.full(BURST, 1.0 / BURST), mode='same')
    return np.asarray(white / np.sqrt(np.where(level > LOUD, level, 1.0)))


def _colour(octaves: list[tuple[Array, Array]]) -> Array:
    """
    Follow a channel's noise to low frequencies, where a short rest says nothing about it.

    Noise grows steadily from octave to octave and is there in most phases; shape (bands,).
    """
    ratios = np.array([np.where(dof >= 4, energy / np.maximum(dof, 1.0), np.nan)
                       for energy, dof in octaves])
    expected = np.ones(len(BANDS))
    for b in range(len(BANDS) - 2, -1, -1):
        there = ratios[np.isfinite(ratios[:, b]), b]
        steepest = expected[b + 1] * STEEPEST * (LOWEST if b == 0 else 1.0)
        if len(there):
            expected[b] = min(max(1.0, float(np.median(there))), steepest)
    return expected


def _cube_root(ratio: float, dof: float) -> float:
    """Give the normal score of a chi-square ratio (Wilson and Hilferty)."""
    q = 2.0 / (9.0 * dof)
    return float((np.cbrt(ratio) - (1.0 - q)) / np.sqrt(q))


def _octaves(white: Array, rows: NDArray[np.bool_], spacing: float) -> tuple[Array, Array]:
    energy, dof = np.zeros(len(BANDS)), np.zeros(len(BANDS))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    for i, j in zip(edges[::2], edges[1::2]):
        n = j - i
        if n < max(FEWEST, SHORTEST / spacing):
            continue
        power = np.abs(np.fft.rfft(white[i:j])) ** 2 / n
        weight = np.full(len(power), 2.0)
        weight[0] = 1.0
        frequency = np.arange(len(power)) * RATE / spacing / n
        for b, (low, high) in enumerate(BANDS):
            chosen = (frequency >= low) & (frequency < high)
            energy[b] += float(np.sum((power * weight)[chosen]))
            dof[b] += float(np.sum(weight[chosen]))
    return energy, dof


def count_impulses(noise: Autoregression, residual: Array) -> Array:
    """Count innovations of each channel that noise does not make, shape (channels,)."""
    return np.array([
        _beyond_its_tail(noise.whiten(residual[:, c][np.newaxis], c)[0])
        if noise.sigma[:, c].any() else 0 for c in range(len(CHANNELS))])


def _beyond_its_tail(white: Array) -> int:
    """Count the impulses, not of a burst, that a heavy tail does not make by two deviations."""
    size = np.abs(white)
    single = size > IMPULSE
    if len(white) >= BURST:
        around = np.full(BURST, 1.0 / (BURST - IMPULSE_LASTS))
        middle = (BURST - IMPULSE_LASTS) // 2
        around[middle:middle + IMPULSE_LASTS] = 0.0
        single &= np.convolve(white ** 2, around, mode='same') <= LOUD
    expected = TAIL * float(np.sum((size > NEARLY) & (size <= IMPULSE)))
    return max(0, int(single.sum() - expected - 2.0 * np.sqrt(expected)))


LINE = 30.0
"""
Power of a spectral line, at least, over the median of its neighbourhood: 3000 channels of white
noise of 23 s had 27 at most.
"""

FLOOR, FLOORS = 101, 5
"""Bins whose median is the floor of a spectrum; neighbours below whose median it is by chance."""


class Line(NamedTuple):
    """A spectral line in one channel's residual."""

    channel: str
    frequency: float
    amplitude: float
    power: float


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
            found.append(Line(CHANNELS[STREAM_SLICES[name].start + i].name,
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
    """Median of the neighbourhood of every bin, and no less than those around it have."""
    n = len(power) // FLOOR * FLOOR
    if n < FLOORS * FLOOR:
        return np.full(len(power), float(np.median(power)) + 1e-300)
    middle = np.median(power[:n].reshape(-1, FLOOR), axis=1)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(middle, FLOORS // 2, mode='edge'),
                                                      FLOORS)
    middle = np.maximum(middle, np.median(around, axis=1))
    centres = (np.arange(len(middle)) + 0.5) * FLOOR
    return np.asarray(np.interp(np.arange(len(power)), centres, middle) + 1e-300)
