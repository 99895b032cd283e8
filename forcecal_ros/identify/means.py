"""Means over time and what they are worth: noise that is coloured, correlated between axes."""

from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import Stream
import numpy as np

SHORTEST = 10
"""Blocks of a pose that its noise can be measured on."""

MOST_LAGS = 24
"""Blocks over which noise may remember itself."""

_LEAST = 0.2
_FINEST = 1e-7


def window_mean(stream: Stream, start: float, end: float, what: str = 'signal') -> Array:
    """
    Mean of a signal while the robot stands still, [Gamez2005] Eq. 11, [Gamez2005] Eq. 14.

    Parameters
    ----------
    stream : Stream
    start, end : float
        ``start <= t < end`` [s].
    what : str
        For the message.

    Returns
    -------
    ndarray, shape (k,)

    Raises
    ------
    DataError
        There is no sample.
    """
    values = stream.between(start, end).values
    if not len(values):
        raise DataError(f'no {what} between {start:.3f} s and {end:.3f} s, where the robot stood '
                        'to be measured; record it throughout')
    return np.asarray(values.mean(axis=0))


class Autocovariance(NamedTuple):
    """
    Noise of block means.

    Attributes
    ----------
    lags : ndarray, shape (1 + 2 m, k, k)
        Covariance between a block and the one so many later; m = 0 for white noise.
    blocks : int
        How many blocks it was measured on.
    """

    lags: Array
    blocks: int

    @property
    def weights(self) -> Array:
        """How much each lag but the first counts: fully up to m, then less and less."""
        m = (len(self.lags) - 1) // 2
        return np.minimum(1.0, 2 - np.arange(1, 2 * m + 1) / max(m, 1))

    @property
    def total(self) -> Array:
        """Sum over all lags: the variance of a mean of n blocks, times n; shape (k, k)."""
        total = self.lags[0].copy()
        for weight, lag in zip(self.weights, self.lags[1:]):
            total += weight * (lag + lag.T)
        return _positive(total, self.lags[0])

    def mapped(self, matrix: Array) -> 'Autocovariance':
        """Noise of ``matrix @ x``."""
        return Autocovariance(matrix @ self.lags @ matrix.T, self.blocks)


def _positive(total: Array, white: Array) -> Array:
    """Keep what was summed over lags from falling below a fifth of what white noise gives."""
    values, vectors = np.linalg.eigh(white)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    root = vectors[:, kept] * np.sqrt(values[kept])
    whiten = vectors[:, kept] / np.sqrt(values[kept])
    ratio, turn = np.linalg.eigh(whiten.T @ total @ whiten)
    if ratio.min(initial=1.0) >= _LEAST:
        return total
    out = root @ turn
    return np.asarray((out * np.maximum(ratio, _LEAST)) @ out.T)


def autocovariance(windows: list[Array]) -> Autocovariance:
    """
    Measure the noise of block means while nothing moves.

    The mean of each window is taken off; the bias that leaves behind is put right. As many lags
    are kept as stand out of what white noise would show (flat-top window): none for white noise,
    whose estimate they would only make worse.

    Parameters
    ----------
    windows : list of ndarray, shape (n_i, k)
        Consecutive blocks of each window; NaN rows are left out.

    Returns
    -------
    Autocovariance

    Raises
    ------
    DataError
        No window is long enough.
    """
    windows = [w for w in windows if np.isfinite(w).all(1).sum() >= SHORTEST]
    if not windows:
        raise DataError(f'the robot stood still for less than {SHORTEST} blocks at a time; '
                        'hold each pose for a second or more')
    whole = [np.isfinite(w).all(1) for w in windows]
    clean = [np.where(ok[:, None], w - w[ok].mean(axis=0), 0.0) for w, ok in zip(windows, whole)]
    n = sum(int(ok.sum()) for ok in whole)
    longest = min(MOST_LAGS, min(len(w) for w in windows) // 3)
    lags = np.stack([
        np.asarray(sum(c[:len(c) - lag].T @ c[lag:] for c in clean))
        / max(1, sum(int((ok[:len(ok) - lag] & ok[lag:]).sum()) for ok in whole))
        for lag in range(longest + 1)])
    finest = (_FINEST * max(float(np.nanmax(np.abs(w))) for w in windows))**2
    lags[0] += max(finest, 1e-300) * np.eye(lags.shape[1])
    raw = Autocovariance(lags[:1 + 2 * _memory(lags, n)], n)
    weight = 1 + 2 * raw.weights.sum()
    shortfall = raw.total / max(n / len(windows) - weight, 1.0)
    return Autocovariance(raw.lags + shortfall, n)


def _memory(lags: Array, n: int) -> int:
    """Find the last lag before a run of five at which no channel stands out of white noise."""
    variance = np.diagonal(lags[0]).copy()
    variance[variance == 0] = 1.0
    stands_out = np.abs(np.diagonal(lags, axis1=1, axis2=2) / variance).max(axis=1) \
        > 2 * np.sqrt(np.log10(max(n, 10)) / n)
    most = (len(lags) - 1) // 2
    for m in range(most):
        if not stands_out[m + 1:m + 6].any():
            # what has begun to fade goes on for a while below what can be told from nothing
            return min(m + 1, most) if m else 0
    return most


def correlated_sum(rows: Array, noise: Autocovariance) -> Array:
    """
    Variance of the sum of ``rows[n].T @ e[n]`` over blocks for noise e correlated over blocks.

    Parameters
    ----------
    rows : ndarray, shape (n, k, p)
        Of consecutive blocks; zero where one does not count.
    noise : Autocovariance

    Returns
    -------
    ndarray, shape (p, p)
    """
    total = np.tensordot(rows, noise.lags[0] @ rows, ((0, 1), (0, 1)))
    white = total.copy()
    for shift, (weight, lag) in enumerate(zip(noise.weights, noise.lags[1:]), 1):
        cross = np.tensordot(rows[:-shift], lag @ rows[shift:], ((0, 1), (0, 1)))
        total += weight * (cross + cross.T)
    return _positive(np.asarray(total), np.asarray(white))


def drift(stream: Stream, windows: list[tuple[float, float]]) -> tuple[float, int, int]:
    """
    Find the strongest drift of a signal while the robot stands.

    Parameters
    ----------
    stream : Stream
    windows : list of tuple of float
        Start and end [s].

    Returns
    -------
    sigmas, window, channel : float, int, int
        Mean of the second half less that of the first, in standard errors; 0 where the windows
        hold too few samples to tell.
    """
    worst = (0.0, 0, 0)
    for i, (start, end) in enumerate(windows):
        values = stream.between(start, end).values
        size = max(1, len(values) // 40)
        n = len(values) // size // 2 * 2
        if n < 20:
            continue
        blocks = values[:n * size].reshape(n, size, -1).mean(axis=1)
        noise = np.sqrt((np.diff(blocks, axis=0)**2).mean(axis=0) / 2)
        step = blocks[n // 2:].mean(axis=0) - blocks[:n // 2].mean(axis=0)
        sigmas = np.abs(step) / np.maximum(noise * np.sqrt(4 / n), 1e-300)
        sigmas[noise == 0] = 0
        if sigmas.max() > worst[0]:
            worst = (float(sigmas.max()), i, int(np.argmax(sigmas)))
    return worst
