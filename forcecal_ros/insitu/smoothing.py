"""The Savitzky-Golay filter of [Traversaro2014] IV over a stream of any length."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled_in_any_order
import numpy as np
from scipy import signal

PAPER_WINDOW = 3.01
"""Length of the paper's window [s]: 301 samples at 100 Hz."""

PAPER_ORDER = 3
"""Order of the paper's polynomial."""


SLOW = 5.0
"""Lower rates are doubted [Hz]: 5 kHz come out so where ms are taken for s."""

QUARTIC = 4
"""Order of the polynomial from which on its weights are no parabola."""

PIECE = 8192
"""Samples that are filtered at a time: ten columns of so many fit a second-level cache."""

AGAIN = 32
"""Windows after which the filter's sums begin anew: they have rounding of 1e-12 by then."""


class Smoothed(NamedTuple):
    """Filtered samples, shape (n, k), and the sum of their noise gains (1 each, unfiltered)."""

    values: Array
    noise_gain: float


def window_samples(window: float, order: int, rate: float) -> int:
    """
    Scale the paper's window to a rate: an odd number of samples, [Traversaro2014] IV.

    Parameters
    ----------
    window : float
        [s]; 0 for no filter.
    order : int
        Of the polynomial.
    rate : float
        [Hz]

    Returns
    -------
    int
        1 for no filter.

    Raises
    ------
    ConfigError
        The window holds too few samples for the polynomial.
    """
    if not window:
        return 1
    samples = 2 * round((window * rate - 1) / 2) + 1
    if samples <= order:
        raise ConfigError(
            f'filter: a window of {window:g} s holds {samples} samples at {rate:g} Hz, order '
            f'{order} needs more than {order}; widen it'
            + (', if time is in s; else state its unit (ms, us)' if rate < SLOW else ''))
    return samples


def projection(window: int, order: int) -> Array:
    """
    Least-squares polynomial over a window: row i maps the samples to the fit at sample i.

    The middle row holds the filter's coefficients, the others serve the first and last half
    window of a stream; the diagonal holds the gain on white noise power.

    Returns
    -------
    ndarray, shape (window, window)
    """
    x = np.linspace(-1.0, 1.0, window) if window > 1 else np.zeros(1)
    q, _ = np.linalg.qr(np.polynomial.legendre.legvander(x, min(order, window - 1)))
    return np.asarray(q @ q.T)


def smooth(chunks: Iterable[Array], window: int, order: int) -> Iterator[Smoothed]:
    """
    Filter one gapless run of samples chunk by chunk; as many come out as go in.

    Parameters
    ----------
    chunks : iterable of ndarray, shape (n_i, k)
    window : int
        Odd number of samples; 1 passes everything as it is.
    """
    if window == 1:
        yield from (Smoothed(chunk, float(len(chunk))) for chunk in chunks)
        return
    hat, half = projection(window, order), window // 2
    edge_gain = float(np.trace(hat[:half, :half]))
    held: Array | None = None
    begun = False
    for chunk in chunks:
        held = chunk if held is None else np.concatenate([held, chunk])
        if len(held) < window + begun:
            continue
        if not begun:
            yield Smoothed(hat[:half] @ held[:window], edge_gain)
        for start in range(begun, len(held) - 2 * half, PIECE):
            middle = _middle(held[start:start + PIECE + 2 * half], hat[half], order)
            yield Smoothed(middle, len(middle) * float(hat[half, half]))
        held, begun = held[-window:], True
    if held is None:
        return
    if begun:
        yield Smoothed(hat[half + 1:] @ held, edge_gain)
    else:
        short = projection(len(held), order)
        yield Smoothed(short @ held, float(np.trace(short)))


def _middle(x: Array, taps: Array, order: int) -> Array:
    """Filter samples that have half a window of others on either side."""
    if order >= QUARTIC:
        return np.asarray(signal.oaconvolve(x, taps[:, None], mode='valid', axes=0))
    half = len(taps) // 2
    curve = (taps[-1] - taps[half]) / half ** 2
    return _slid(x, half, float(taps[half]), float(curve), AGAIN * len(taps))


@compiled_in_any_order
def _slid(x: Array, half: int, top: float, curve: float, again: int) -> Array:
    """
    Weigh samples by ``top + curve j^2``, j from the middle of a window that slides over them.

    The sums of x, j x and j^2 x in the window follow from those one sample before, whatever its
    length; rounding grows with the square of the way, and they begin anew after so many samples.
    """
    n, k = len(x) - 2 * half, x.shape[1]
    out = np.empty((n, k))
    first, sums, slopes, squares = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    whole = top * (2 * half + 1) + curve * half * (half + 1) * (2 * half + 1) / 3.0
    left, right = half + 1.0, float(half)
    for start in range(0, n, again):
        for c in range(k):
            first[c] = x[start, c]
            sums[c] = slopes[c] = squares[c] = 0.0
        for j in range(2 * half + 1):
            for c in range(k):
                value = x[start + j, c] - first[c]
                sums[c] += value
                slopes[c] += (j - half) * value
                squares[c] += (j - half) * (j - half) * value
        for i in range(start, min(start + again, n)):
            for c in range(k):
                if i > start:
                    old, new = x[i - 1, c] - first[c], x[i + 2 * half, c] - first[c]
                    squares[c] += (sums[c] - 2.0 * slopes[c] - left * left * old
                                   + right * right * new)
                    slopes[c] += left * old + right * new - sums[c]
                    sums[c] += new - old
                out[i, c] = whole * first[c] + top * sums[c] + curve * squares[c]
    return out


def gathered(run: Array, window: int, order: int) -> Array:
    """
    Apply the transpose of the filter to one gapless run: sum x smooth(y) is sum gathered(x) y.

    Parameters
    ----------
    run : ndarray, shape (n, k)
    window : int
        Odd number of samples, more than one.
    """
    n = len(run)
    if n < window + 1:
        return np.asarray(projection(n, order) @ run)
    hat, half = projection(window, order), window // 2
    out = signal.oaconvolve(run[half:n - half], hat[half][:, None], mode='full', axes=0)
    out[:window] += hat[:half].T @ run[:half]
    out[-window:] += hat[half + 1:].T @ run[-half:]
    return np.asarray(out)
