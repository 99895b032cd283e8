"""Hysteresis of a sensor as Bouc and Wen model it."""

from forcecal_ros.geometry import Array
from forcecal_ros.jit import compiled
import numpy as np

SHARP = 0.02
"""Softness up to which a hysteresis counts as elasto-plastic: exponents of 50 and more."""


class Hysteresis:
    """
    A signal less the part that friction inside the sensor holds back.

    y = x - height / width * z, where z follows x within +-width as Bouc and Wen have it:
    dz = dx (1 - (z / width)^n) on the way to the bound, dz = dx on the way back. At first, z = 0.
    Without softness, n is infinite (an elasto-plastic element): after a reversal by 2 width the
    reading lags by the height again.

    Parameters
    ----------
    height : float
        Largest lag of the reading [unit of the signal].
    width : float
        Travel of the signal after which the lag is full [unit of the signal].
    softness : float
        1 / n: how gradually it gets there, from 0 to 1.
    """

    def __init__(self, height: float, width: float, softness: float = 0.0) -> None:
        self._ratio, self._width = height / width, width
        self._exponent = 1.0 / softness if softness > SHARP else 0.0
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
        _stop(np.ascontiguousarray(signal), self._last, self._held, self._width, self._exponent,
              held)
        return signal - self._ratio * held


@compiled
def _stop(signal: Array, last: Array, held: Array, width: float, exponent: float,
          out: Array) -> None:
    """Write what follows the signal within +-width; ``last`` and ``held`` are its state."""
    for i in range(len(signal)):
        for k in range(len(last)):
            step = signal[i, k] - last[k]
            if exponent > 0.0 and step * held[k] > 0.0:
                step *= 1.0 - (abs(held[k]) / width) ** exponent
            held[k] = min(max(held[k] + step, -width), width)
            last[k] = signal[i, k]
            out[i, k] = held[k]
