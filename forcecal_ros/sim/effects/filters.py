"""Linear filters of sampled signals, block after block, settled at the first sample."""

from collections.abc import Callable

from forcecal_ros.geometry import Array
import numpy as np
from scipy.signal import cont2discrete, lfilter, lfilter_zi

Operator = Callable[[Array], Array]
"""Takes the next samples of a signal, shape (n, k), and gives what becomes of them."""

TAPS = 6
"""Samples between which a delay interpolates; flat to 5e-4 up to a tenth of their rate."""


class Delay:
    """
    A delay by any fraction of a sample: Lagrange interpolation between the nearest samples.

    Parameters
    ----------
    delay : float
        [s]
    dt : float
        Between samples [s].
    """

    def __init__(self, delay: float, dt: float) -> None:
        back = delay / dt
        first = max(0, int(np.floor(back)) - (TAPS // 2 - 1))
        self._offsets = np.arange(first, first + TAPS)
        others = [np.delete(self._offsets, i) for i in range(TAPS)]
        self._weights = [np.prod((back - other) / (offset - other))
                         for offset, other in zip(self._offsets, others)]
        self._past: Array | None = None

    def __call__(self, signal: Array) -> Array:
        """Delay the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        reach = int(self._offsets[-1])
        if self._past is None:
            self._past = np.repeat(signal[:1], reach, axis=0)
        line = np.concatenate([self._past, signal])
        self._past = line[len(line) - reach:]
        out = np.zeros_like(signal)
        for weight, offset in zip(self._weights, self._offsets):
            if weight:
                out += weight * line[reach - offset:len(line) - offset]
        return out


class Filter:
    """
    A rational filter, b / a.

    Parameters
    ----------
    b, a : ndarray
        Of the discrete filter, as scipy has them.
    """

    def __init__(self, b: Array, a: Array) -> None:
        self._b, self._a = b, a
        self._state: Array | None = None

    def __call__(self, signal: Array) -> Array:
        """Filter the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._state is None:
            self._state = np.outer(lfilter_zi(self._b, self._a), signal[0])
        out, self._state = lfilter(self._b, self._a, signal, axis=0, zi=self._state)
        return np.asarray(out)


def continuous(numerator: list[float], denominator: list[float], dt: float) -> Filter:
    """
    Make a filter from its transfer function, exact for signals that are linear between samples.

    Parameters
    ----------
    numerator, denominator : list of float
        Coefficients of powers of s [rad/s], highest first.
    dt : float
        Between samples [s].

    Returns
    -------
    Filter
    """
    b, a, _ = cont2discrete((numerator, denominator), dt, method='foh')
    return Filter(np.squeeze(b), a)


class Highpass:
    """
    A high-pass, dy/dt = dx/dt - rate y, exact for signals that are linear between samples.

    Parameters
    ----------
    rate : float
        [1/s]
    before : float
        How long the first sample has been there already [s].
    dt : float
        Between samples [s].
    """

    def __init__(self, rate: float, before: float, dt: float) -> None:
        self._decay, self._left = np.exp(-rate * dt), np.exp(-rate * before)
        rise = (1.0 - self._decay) / (rate * dt)
        self._settled = Filter(np.array([rise, -rise]), np.array([1.0, -self._decay]))
        self._first: Array | None = None

    def __call__(self, signal: Array) -> Array:
        """Filter the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._first is None:
            self._first = self._left * signal[0]
        fading = np.outer(self._decay ** np.arange(len(signal)), self._first)
        self._first = self._decay * fading[-1]
        return self._settled(signal) + fading
