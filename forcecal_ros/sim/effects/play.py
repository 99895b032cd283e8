"""Hysteresis: what a signal's reversals leave behind."""

from forcecal_ros.compiled import compiled
from forcecal_ros.geometry import Array
import numpy as np


class Hysteresis:
    """
    A signal less what friction inside the sensor holds back.

    y = x - height / width * z, where z follows x but stays within +-width (an elasto-plastic
    element, the piecewise linear form of Bouc and Wen's): after a reversal by 2 width the reading
    lags by the height again. At first, z = 0.

    Parameters
    ----------
    height : float
        By how much the reading lags at most [unit of the signal].
    width : float
        How far the signal goes until it does [unit of the signal].
    """

    def __init__(self, height: float, width: float) -> None:
        self._ratio, self._width = height / width, width
        self._last: Array | None = None
        self(np.zeros((1, 1)))  # compiles, before it is needed in real time
        self._last = None

    def __call__(self, signal: Array) -> Array:
        """Pass on the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._last is None:
            self._last, self._held = signal[0].copy(), np.zeros(signal.shape[1])
        held = np.empty(signal.shape)
        _stop(np.ascontiguousarray(signal), self._last, self._held, self._width, held)
        return signal - self._ratio * held


@compiled
def _stop(signal: Array, last: Array, held: Array, width: float, out: Array) -> None:
    """Write what follows the signal within +-width; ``last`` and ``held`` are its state."""
    for i in range(len(signal)):
        for k in range(len(last)):
            held[k] = min(max(held[k] + (signal[i, k] - last[k]), -width), width)
            last[k] = signal[i, k]
            out[i, k] = held[k]
