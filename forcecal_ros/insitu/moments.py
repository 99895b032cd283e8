"""A data set of any length as one small matrix of sums: all that least squares needs of it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.core.errors import ConfigError, DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled_in_any_order
from forcecal_ros.insitu.prepare import Prepared
import numpy as np
from scipy import signal

TRUNCATE = 1e-10
"""Directions of the regressors with less than this share of the largest moment are not used."""

SUMMED = 64
"""Samples that are summed at a time: twenty columns of so many fit a first-level cache."""


@dataclass(frozen=True)
class Moments:
    """
    Sums over the samples of a data set, noise of the accelerometer taken off.

    Attributes
    ----------
    count : int
        Samples.
    singular_values : ndarray, shape (n,)
        Of the centred raw measurements, over sqrt(count), [Traversaro2014] Eq. 10.
    mean : ndarray, shape (n,)
        Of the raw measurements, Eq. 9.
    scatter : ndarray, shape (n, n)
        Covariance of the raw measurements, their white noise taken off.
    directions : ndarray, shape (q, m)
        As many pseudo-samples of the regressors as they have excited directions; their outer
        products add up to the sum over all samples.
    raw : ndarray, shape (q, n)
        Raw measurements projected on the same pseudo-samples.
    ones : ndarray, shape (q,)
        The constant 1 projected on the same pseudo-samples.
    combine : ndarray, shape (m, q)
        Regressors of a sample times this are its weights in the pseudo-samples.
    spread : ndarray, shape (3, 3)
        Covariance of measured gravity, noise taken off [(m/s^2)^2].
    """

    count: int
    singular_values: Array
    mean: Array
    scatter: Array
    directions: Array
    raw: Array
    ones: Array
    combine: Array
    spread: Array

    def without(self, part: Array, raw: Array, regressors: Array) -> 'Moments':
        """
        Take a known part off the raw measurements.

        Parameters
        ----------
        part, raw : ndarray, shape (b, n)
            The part, and raw measurements with it, as means of equally long blocks.
        regressors : ndarray, shape (b, m)
            Of the same blocks.
        """
        without = raw - part
        change = np.cov(without.T, bias=True) - np.cov(raw.T, bias=True)
        each = self.count / len(part)
        return replace(self, mean=self.mean - part.mean(axis=0), scatter=self.scatter + change,
                       raw=self.raw - each * (regressors @ self.combine).T @ part)

    @property
    def constant_weight(self) -> float:
        """Samples' worth of information on a constant beside the regressors."""
        return float(self.count - self.ones @ self.ones)


def accumulate(chunks: Iterable[Prepared], kept: tuple[tuple[float, float], ...], window: int,
               order: int, raw_noise: Array, gravity_noise: Array, magnitude: float | None
               ) -> Moments:
    """
    Filter the kept stretches and fold all samples into their moments, in constant memory.

    At rest the accelerometer tells a direction only: its readings are scaled to the magnitude of
    gravity, before the filter, which is linear and so keeps what holds for a sample. The rest
    of its noise is an error in the regressor: its share of the second moments, scaled by the
    filter's gain, is taken off before anything is regressed on them.

    Parameters
    ----------
    kept : tuple of (float, float)
        Stretches to use [s].
    window, order : int
        Of the filter.
    raw_noise : ndarray, shape (n, n)
        Covariance of a raw sample's white noise.
    gravity_noise : ndarray, shape (3, 3)
        The same of the accelerometer [(m/s^2)^2].
    magnitude : float or None
        Of gravity [m/s^2]; None in motion.

    Raises
    ------
    DataError
        No sample lies in the stretches, or gravity has no scatter beyond its noise.
    """
    size = None if magnitude is None else magnitude + np.trace(gravity_noise) / (3 * magnitude)
    reference: Array | None = None
    gain = 0.0
    for run in _runs(chunks, kept, size):
        for part in smooth(run, window, order):
            if reference is None:
                reference = part.values[0].copy()
                reference[:-len(raw_noise)] = 0.0
                gram = np.zeros((1 + len(reference), 1 + len(reference)))
            _add_products(part.values, reference, gram)
            gain += part.noise_gain
    if reference is None:
        raise DataError('no sample lies in the stretches that are used')
    gram = np.tril(gram) + np.tril(gram, -1).T
    if magnitude is not None:
        gravity_noise = _tangential(gram, gravity_noise, magnitude)
    return _moments(gram, reference[-len(raw_noise):], gain, raw_noise, gravity_noise)


def _tangential(gram: Array, gravity_noise: Array, magnitude: float) -> Array:
    """Mean covariance of noise across gravity, which is what scaling leaves of it."""
    along = gram[1:4, 1:4] / (gram[0, 0] * magnitude ** 2)
    return np.asarray(np.trace(gravity_noise) / 3 * (np.eye(3) - along))


def _runs(chunks: Iterable[Prepared], kept: tuple[tuple[float, float], ...],
          magnitude: float | None) -> Iterator[Iterator[Array]]:
    """
    Yield each kept stretch as an iterator over chunks of [regressors, raw]; read in order.

    Measured gravity is scaled to ``magnitude`` [m/s^2]; noise across it makes its mean shorter.
    """
    source = iter(chunks)
    held: list[Prepared] = []

    def stretch(start: float, end: float) -> Iterator[Array]:
        while True:
            chunk = held.pop() if held else next(source, None)
            if chunk is None:
                return
            i, j = np.searchsorted(chunk.t, [start, end])
            if j > i:
                yield _rows(chunk.regressors[i:j], chunk.raw[i:j], magnitude or np.nan)
            if j < len(chunk.t):
                held.append(chunk.take(slice(j, None)))
                return

    for start, end in kept:
        yield stretch(start, end)


@compiled_in_any_order
def _rows(regressors: Array, raw: Array, magnitude: float) -> Array:
    """Put raw channels beside regressors, gravity of a magnitude unless that is NaN."""
    m, n = regressors.shape[1], raw.shape[1]
    rows = np.empty((len(raw), m + n))
    for i in range(len(raw)):
        x, y, z = regressors[i, 0], regressors[i, 1], regressors[i, 2]
        scale = magnitude / np.sqrt(x * x + y * y + z * z)
        for k in range(m):
            rows[i, k] = regressors[i, k]
        if not np.isnan(magnitude):
            for k in range(3):
                rows[i, k] *= scale
        for k in range(n):
            rows[i, m + k] = raw[i, k]
    return rows


@compiled_in_any_order
def _add_products(rows: Array, reference: Array, gram: Array) -> None:
    """Add to the lower half of X^T X, X = [1, rows - reference], piece by piece."""
    n = len(reference)
    x = np.ones((1 + n, SUMMED))
    for start in range(0, len(rows), SUMMED):
        size = min(SUMMED, len(rows) - start)
        for i in range(size):
            for k in range(n):
                x[1 + k, i] = rows[start + i, k] - reference[k]
        for k in range(1 + n):
            for j in range(k + 1):
                total = 0.0
                for i in range(size):
                    total += x[k, i] * x[j, i]
                gram[k, j] += total


def _moments(gram: Array, reference: Array, gain: float, raw_noise: Array,
             gravity_noise: Array) -> Moments:
    n = len(reference)
    m = len(gram) - 1 - n
    count = gram[0, 0]
    covariance = (gram[1:, 1:] - np.outer(gram[0, 1:], gram[0, 1:]) / count) / count
    spread = covariance[:3, :3] - gain / count * gravity_noise
    scatter = covariance[m:, m:]
    second = gram[1:m + 1, 1:m + 1].copy()
    second[:3, :3] -= gain * gravity_noise
    values, vectors = np.linalg.eigh(second)
    strong = values > TRUNCATE * values[-1]
    root, vectors = np.sqrt(values[strong]), vectors[:, strong]
    combine = vectors / root
    return Moments(
        count=round(count),
        singular_values=np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[::-1], 0.0)),
        mean=reference + gram[0, m + 1:] / count,
        scatter=scatter - gain / count * raw_noise,
        directions=(vectors * root).T,
        raw=combine.T @ (gram[1:m + 1, m + 1:] + np.outer(gram[1:m + 1, 0], reference)),
        ones=combine.T @ gram[1:m + 1, 0],
        combine=combine,
        spread=spread)


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
