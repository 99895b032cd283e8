"""Filters of sampled signals, block by block: linear ones, and hysteresis after Bouc and Wen."""

from collections.abc import Callable, Sequence

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled
import numpy as np
from scipy.linalg import expm

Operator = Callable[[Array], Array]
"""Changes the next samples of a signal, shape (n, k), and keeps what it needs for those after."""

TAPS = 6
"""Samples a delay interpolates between; accurate to 1.3e-3 up to a tenth of the sample rate."""


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
    A proper rational transfer function, exact for signals that are linear between samples.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients of powers of s [rad/s], highest first; the numerator has at most as many.
    dt : float
        Between samples [s].
    settled : float
        Share of the first sample that the filter had settled to before.
    """

    def __init__(self, numerator: Sequence[float], denominator: Sequence[float], dt: float,
                 settled: float = 1.0) -> None:
        order = len(denominator) - 1
        a = np.array(denominator[1:]) / denominator[0]
        b = np.zeros(order + 1)
        b[order + 1 - len(numerator):] = np.array(numerator) / denominator[0]
        A, B = np.eye(order, k=-1), np.eye(order)[0]
        A[0] = -a
        self._output, self._through = b[1:] - b[0] * a, b[0]
        augmented = np.zeros((order + 2, order + 2))  # states, signal, its slope times dt
        augmented[:order, :order], augmented[:order, order] = A * dt, B * dt
        augmented[order, order + 1] = 1.0
        step = expm(augmented)
        self._A = np.ascontiguousarray(step[:order, :order])
        self._before = step[:order, order] - step[:order, order + 1]
        self._after = np.ascontiguousarray(step[:order, order + 1])
        self._rest = -settled * np.linalg.solve(A, B)
        self._last: Array | None = None
        self(np.zeros((1, 1)))  # compiles, before it is needed in real time
        self._last = None

    def __call__(self, signal: Array) -> Array:
        """Filter the next samples, shape (n, k)."""
        if not len(signal):
            return signal
        if self._last is None:
            self._state, self._last = np.outer(self._rest, signal[0]), signal[0].copy()
        out = np.empty(signal.shape)
        _filter(self._A, self._before, self._after, self._output, self._through,
                np.ascontiguousarray(signal), self._state, self._last, out)
        return out


@compiled
def _filter(A: Array, before: Array, after: Array, output: Array, through: float, signal: Array,
            state: Array, last: Array, out: Array) -> None:
    """Step x1 = A x0 + before u0 + after u1, y = output x + through u, column by column."""
    order, x = len(A), np.empty(len(A))
    for k in range(signal.shape[1]):
        for i in range(len(signal)):
            u = signal[i, k]
            y = through * u
            for r in range(order):
                x[r] = before[r] * last[k] + after[r] * u
                for c in range(order):
                    x[r] += A[r, c] * state[c, k]
            for r in range(order):
                state[r, k] = x[r]
                y += output[r] * x[r]
            last[k] = u
            out[i, k] = y


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
