"""Autoregressive models of coloured noise, AR(p), whitening by them, and longer memory."""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled
from forcecal_ros.core.noise.steps import without_steps
import numpy as np
from numpy.typing import NDArray

ORDER = 8
"""Coefficients of an autoregression."""

FEWEST = 300
"""Samples that a model of its own takes; a kind of motion with fewer shares the recording's."""

USUAL = 0.95
"""
Share of the distances between samples that are no gap.

Samples every 5 ms are two blocks of 4 ms apart each fourth time; few percent of them get lost.
"""

SETTLED = 1.0
"""
Log-likelihood of one channel in one kind of motion by which a noise has to be better to take
another's place: two of its eight coefficients gain as much by chance.
"""

GROUPS = ('rest', 'motion', 'contact')
"""Kinds of motion whose noise differs."""

AT_ONCE = 8192
"""Samples at once, some thirty seconds: of a hundred signals as many fill a processor's cache."""

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]


class Autoregression(NamedTuple):
    """
    AR models of one recording's channels in each kind of motion.

    Attributes
    ----------
    coefficients : ndarray, shape (groups, channels, ORDER)
    sigma : ndarray, shape (groups, channels)
        Standard deviation of the innovations; 0 where a channel has no data.
    rows : ndarray of bool, shape (n, channels)
        Samples whose whole history was measured, without a gap at the channel's own rate.
    present : ndarray of bool, shape (n, channels)
        Samples that were measured; a model's history goes over these.
    groups : ndarray of int, shape (n,)
        Kind of motion of each sample.
    """

    coefficients: Array
    sigma: Array
    rows: BoolArray
    present: BoolArray
    groups: IntArray

    def whiten(self, columns: Array | NDArray[np.float32], channel: int) -> Array:
        """
        Turn signals of one channel into innovations of unit variance.

        Parameters
        ----------
        columns : ndarray, shape (k, n)

        Returns
        -------
        ndarray, shape (k, n)
            Zero where the history is missing.
        """
        there, scale, rows = self._of(channel)
        own = np.ascontiguousarray(columns[:, there], dtype=float)
        white = np.empty(own.shape)
        _whiten(own, np.ascontiguousarray(self.coefficients[:, channel]), scale,
                self.groups[there], rows, white)
        return self._spread(white, there, columns.shape)

    def weigh(self, signal: Array | NDArray[np.float32], channel: int, blocks: BoolArray) -> Array:
        """
        Multiply a signal of one channel by the inverse of the noise's covariance.

        Parameters
        ----------
        signal : ndarray, shape (n,)
        blocks : ndarray of bool, shape (n,)
            Samples that count, of those whose history is there.

        Returns
        -------
        ndarray, shape (n,)
            Its inner product with another signal is that of what :meth:`whiten` makes of both.
        """
        there, scale, rows = self._of(channel)
        own = np.asarray(signal[there], dtype=float)[np.newaxis]
        out = np.empty(own.shape)
        _weigh(np.ascontiguousarray(own), np.ascontiguousarray(self.coefficients[:, channel]),
               scale, self.groups[there], rows & blocks[there], out)
        return np.asarray(self._spread(out, there, (1, len(signal)))[0])

    def _of(self, channel: int) -> tuple[slice | IntArray, Array, BoolArray]:
        """Return which samples of a channel were measured, 1 / sigma, and which of them count."""
        sigma, present = self.sigma[:, channel], self.present[:, channel]
        there = slice(None) if present.all() else np.flatnonzero(present)
        scale = np.where(sigma > 0.0, 1.0 / np.where(sigma > 0.0, sigma, 1.0), 0.0)
        return there, scale, np.ascontiguousarray(self.rows[there, channel])

    @staticmethod
    def _spread(values: Array, there: slice | IntArray, shape: tuple[int, ...]) -> Array:
        """Put values where samples were measured, zero elsewhere."""
        if isinstance(there, slice):
            return values
        out = np.zeros(shape)
        out[:, there] = values
        return out

    def whiten_in_pieces(self, columns: Callable[[slice], Array | NDArray[np.float32]],
                         channel: int, whole: int = 1) -> Iterator[tuple[slice, Array]]:
        """
        Whiten many long signals as :meth:`whiten` does, without room for all of them.

        Parameters
        ----------
        columns : callable
            Gives the signals of some samples, shape (k, n).
        whole : int
            Samples that are kept together.

        Yields
        ------
        rows : slice
            Of samples, one piece after the other.
        white : ndarray, shape (k, len(rows))
        """
        there = np.flatnonzero(self.present[:, channel])
        for rows in pieces(len(self.groups), whole):
            history = there[:np.searchsorted(there, rows.start)][-ORDER:]
            longer = slice(int(history[0]) if len(history) else rows.start, rows.stop)
            part = self._replace(rows=self.rows[longer], present=self.present[longer],
                                 groups=self.groups[longer])
            white = part.whiten(columns(longer), channel)
            yield rows, white[:, rows.start - longer.start:]

    def or_better(self, other: 'Autoregression', residual: Array) -> 'Autoregression':
        """
        Take another model, fitted to a residual, in the channels that it explains better.

        Parameters
        ----------
        residual : ndarray, shape (n, channels)

        Returns
        -------
        Autoregression
            Itself where the other one explains none better but for chance.
        """
        if not np.array_equal(self.rows, other.rows):
            return other
        better = np.array([self._is_bettered(other, residual[:, c], c)
                           for c in range(residual.shape[1])])
        return self if not better.any() else other._replace(
            coefficients=np.where(better[:, np.newaxis], other.coefficients, self.coefficients),
            sigma=np.where(better, other.sigma, self.sigma))

    def _is_bettered(self, other: 'Autoregression', residual: Array, channel: int) -> bool:
        """Say whether another model explains one channel's residual better in any motion."""
        if not other.sigma[:, channel].any():
            return bool(self.sigma[:, channel].any())
        rows = self.rows[:, channel]
        white = [0.5 * m.whiten(residual[np.newaxis], channel)[0][rows] ** 2
                 + np.log(m.sigma[m.groups[rows], channel]) for m in (self, other)]
        gains = np.bincount(self.groups[rows], white[0] - white[1], len(GROUPS))
        return not bool((gains <= SETTLED).all())

    def same(self, other: 'Autoregression', channel: int) -> bool:
        """Say whether another model whitens a channel as this one does."""
        return self is other or (np.array_equal(self.groups, other.groups) and all(
            np.array_equal(a[:, channel], b[:, channel]) for a, b in zip(self[:-1], other[:-1])))

    def spacing(self, channel: int) -> float:
        """Mean distance of a channel's samples, gaps left out: 1 where it has all of them."""
        steps = np.diff(np.flatnonzero(self.present[:, channel]))
        return float(steps[steps <= _longest(steps)].mean()) if len(steps) else 1.0

    def rms(self, group: int = 0) -> Array:
        """Stationary RMS of each channel's noise in one kind of motion, shape (channels,)."""
        return np.array([_stationary(a, s) for a, s in zip(
            self.coefficients[group], self.sigma[group])])


def pieces(n: int, whole: int = 1) -> Iterator[slice]:
    """
    Give one piece of n samples after the other.

    Parameters
    ----------
    whole : int
        Samples that are kept together.
    """
    length = max(1, AT_ONCE // whole) * whole
    return (slice(i, min(n, i + length)) for i in range(0, n, length))


def _longest(steps: IntArray) -> float:
    """Longest distance of neighbours: 3 of 2, 3, 2, 3, as rates make that are no whole part."""
    return float(np.quantile(steps, USUAL, method='lower')) if len(steps) else 1.0


@compiled
def _end_of_stretch(begin: int, groups: IntArray, rows: BoolArray) -> int:
    # of samples that all count, or all do not, in one kind of motion: short enough for the
    # processor's cache, and many at a time
    end = begin + 1
    while (end < len(rows) and end - begin < 512 and rows[end] == rows[begin]
           and groups[end] == groups[begin]):
        end += 1
    return end


@compiled
def _whiten(columns: Array, coefficients: Array, scale: Array, groups: IntArray,
            rows: BoolArray, out: Array) -> None:
    order, n, end = coefficients.shape[1], columns.shape[1], 0
    out[:] = 0.0
    while end < n:
        begin, end = end, _end_of_stretch(end, groups, rows)
        g = groups[begin]
        for i in range(len(columns) if rows[begin] else 0):
            white = out[i, begin:end]
            white[:] = columns[i, begin:end]
            for j in range(order):
                # white noise has no history, and rows from the first sample on; pieces lack some
                first = max(begin, j + 1)
                before, after = columns[i, first - 1 - j:end - 1 - j], out[i, first:end]
                for t in range(len(after)):
                    after[t] -= coefficients[g, j] * before[t]
            for t in range(len(white)):
                white[t] *= scale[g]


@compiled
def _weigh(signal: Array, coefficients: Array, scale: Array, groups: IntArray,
           rows: BoolArray, out: Array) -> None:
    order, n, end = coefficients.shape[1], signal.shape[1], 0
    white = np.empty(signal.shape)
    _whiten(signal, coefficients, scale * scale, groups, rows, white)
    out[:] = white
    while end < n:
        begin, end = end, _end_of_stretch(end, groups, rows)
        for j in range(order if rows[begin] else 0):
            first, a = max(begin, j + 1), coefficients[groups[begin], j]
            now, past = white[0, first:end], out[0, first - 1 - j:end - 1 - j]
            for t in range(len(past)):
                past[t] -= a * now[t]


def _stationary(a: Array, sigma: float) -> float:
    """RMS of an AR process: root of the integral of its power spectral density."""
    return float(sigma * np.sqrt(np.mean(1.0 / np.abs(1.0 - _delays(len(a)) @ a) ** 2)))


@lru_cache
def _delays(order: int) -> NDArray[np.complex128]:
    """Return exp(-i w k) for k = 1 to ``order``, over half the circle, shape (2048, order)."""
    frequency = (np.arange(2048) + 0.5) / 4096.0
    return np.asarray(np.exp(-2j * np.pi * np.outer(frequency, np.arange(1, order + 1))))


def fit_autoregression(residual: Array, present: BoolArray, groups: IntArray) -> Autoregression:
    """
    Fit the noise of one recording, each channel's mean in each kind of motion taken out.

    To a residual that is mostly a constant, or steps from one to another, an autoregression finds
    a root near 1, and whitens the constant away; hence neither mean nor steps.

    Parameters
    ----------
    residual : ndarray, shape (n, channels)
    present : ndarray of bool, shape (n, channels)
    groups : ndarray of int, shape (n,)
        Kind of motion of each sample, index into GROUPS.
    """
    n, channels = residual.shape
    residual = without_steps(residual, present)
    rows = np.zeros((n, channels), dtype=bool)
    coefficients = np.zeros((len(GROUPS), channels, ORDER))
    sigma = np.zeros((len(GROUPS), channels))
    for c in range(channels):
        there = np.flatnonzero(present[:, c])
        whole = _without_gap(there)
        if whole.sum() < FEWEST:
            continue
        rows[there[ORDER:][whole], c] = True
        lagged = _lagged(residual[there, c])
        pooled = _least_squares(lagged[whole])
        for g in range(len(GROUPS)):
            chosen = whole & (groups[there[ORDER:]] == g)
            a, s = pooled
            if chosen.sum() >= FEWEST:
                a, s = _least_squares(lagged[chosen])
            coefficients[g, c], sigma[g, c] = a, s
    return Autoregression(coefficients, sigma, rows, np.asarray(present), groups)


def white(residual: Array, present: BoolArray, groups: IntArray) -> Autoregression:
    """
    Take noise for white, and as strong as neighbouring samples differ by.

    The rest of a residual changes slowly: a noise that was fitted to it would whiten a
    drift away. Parameters and return as of :func:`fit_autoregression`.
    """
    fitted = fit_autoregression(residual, present, groups)
    sigma = np.zeros_like(fitted.sigma)
    for c in np.flatnonzero(fitted.sigma.any(axis=0)):
        step = np.diff(residual[present[:, c], c])
        sigma[:, c] = 1.4826 * np.median(np.abs(step)) / np.sqrt(2.0)
    return fitted._replace(coefficients=np.zeros_like(fitted.coefficients),
                           sigma=np.where(sigma > 0.0, sigma, fitted.sigma))


def _without_gap(there: IntArray) -> BoolArray:
    """Say which samples follow ORDER others without a gap, from the first that may."""
    if len(there) <= ORDER:
        return np.zeros(0, dtype=bool)
    steps = np.diff(there)
    even = steps <= _longest(steps)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(even, ORDER).all(axis=1))


def at_standstill(residual: Array, noise: Autoregression) -> Autoregression:
    """
    Fit the noise at standstill alone, each stretch's mean taken out, for all kinds of motion.

    It is not the noise of a recording, but knows nothing of a misfit that shows in motion.

    Parameters
    ----------
    residual : ndarray, shape (n, channels)
    noise : Autoregression
        Fitted to all of it; taken where the standstill is too short.
    """
    residual = without_steps(residual, noise.present)
    edges = np.flatnonzero(np.diff(noise.groups)) + 1
    flat = np.concatenate([part - part.mean(axis=0) for part in np.split(residual, edges)])
    coefficients, sigma = noise.coefficients.copy(), noise.sigma.copy()
    stretch = np.searchsorted(edges, np.arange(len(residual)), side='right')
    for c in np.flatnonzero(noise.sigma.any(axis=0)):
        there = np.flatnonzero(noise.present[:, c])
        now, last = there[ORDER:], there[:-ORDER]
        chosen = noise.rows[now, c] & (noise.groups[now] == 0) & (stretch[now] == stretch[last])
        if chosen.sum() >= FEWEST:
            coefficients[:, c], sigma[:, c] = _least_squares(_lagged(flat[there, c])[chosen])
    return noise._replace(coefficients=coefficients, sigma=sigma)


def _lagged(values: Array) -> Array:
    """Each value, then its past, newest first, shape (n - ORDER, 1 + ORDER)."""
    return np.lib.stride_tricks.sliding_window_view(values, ORDER + 1)[:, ::-1]


def _least_squares(lagged: Array) -> tuple[Array, float]:
    """Fit the first column by the others; give coefficients and sigma of the innovations."""
    lagged = lagged - lagged.mean()
    gram = lagged.T @ lagged
    inner = gram[1:, 1:] + np.eye(ORDER) * (1e-9 * gram[0, 0] + 1e-300)
    a = np.linalg.solve(inner, gram[1:, 0])
    variance = (gram[0, 0] - a @ gram[1:, 0]) / max(1, len(lagged) - ORDER)
    return a, float(np.sqrt(max(variance, 1e-30 * gram[0, 0] / len(lagged))))


SPANS = ((1, 16), (16, 64), (64, 256), (256, 1024))
"""Past blocks whose means predict slow noise, from and up to."""


def unpredicted(values: Array, rows: NDArray[np.bool_]) -> float:
    """
    Sum of squares that the means of the past do not predict.

    A heterogeneous autoregression (Corsi, J. Financial Econometrics 7, 2009): four means over
    ever longer spans represent the thousand coefficients of a long memory.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rows : ndarray of bool, shape (n,)
        Which of them are predicted; their past may be any.
    """
    sums = np.concatenate([[0.0], np.cumsum(values)])
    now = np.arange(len(values))
    past = np.stack([(sums[np.maximum(now - first + 1, 0)] - sums[np.maximum(now - last + 1, 0)])
                     / (last - first) for first, last in SPANS], axis=1)[rows]
    w = values[rows]
    gram = past.T @ past + 1e-9 * np.eye(len(SPANS))
    vector = past.T @ w
    return float(w @ w - vector @ np.linalg.solve(gram, vector))
