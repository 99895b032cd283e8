"""Linear filters of sampled signals, block after block, settled at the first sample."""

from collections.abc import Callable, Sequence

from forcecal_ros.geometry import Array
from forcecal_ros.jit import compiled
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
