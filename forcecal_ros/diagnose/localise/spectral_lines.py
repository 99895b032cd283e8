"""Spectral lines in what a model leaves of a signal."""

from typing import NamedTuple

from forcecal_ros.diagnose.inputs.channels import CHANNELS, STREAM_SLICES
from forcecal_ros.geometry import Array
import numpy as np

LINE = 35.0
"""Power of a spectral line, at least, over the median of its neighbourhood."""


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
    """Median of the neighbourhood of every bin."""
    width = 101
    n = len(power) // width * width
    if n < 3 * width:
        return np.full(len(power), float(np.median(power)) + 1e-300)
    middle = np.median(power[:n].reshape(-1, width), axis=1)
    centres = (np.arange(len(middle)) + 0.5) * width
    return np.asarray(np.interp(np.arange(len(power)), centres, middle) + 1e-300)
