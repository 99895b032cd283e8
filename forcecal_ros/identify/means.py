"""Means over time and what they are worth: noise that is coloured, correlated between axes."""

from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.samples import Stream
import numpy as np

LAGS = 5
"""Blocks over which noise is taken to forget itself."""


def window_mean(stream: Stream, start: float, end: float, what: str = 'signal') -> Array:
    """
    Mean of a signal while the robot stands still, [Gamez2005] Eq. 11 and Eq. 14.

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
    lags : ndarray, shape (1 + LAGS, k, k)
        Covariance between a block and the one so many later.
    blocks : int
        How many blocks it was measured on.
    """

    lags: Array
    blocks: int

    @property
    def total(self) -> Array:
        """Sum over all lags: the variance of a mean of n blocks, times n; shape (k, k)."""
        weights = _taper()
        total = self.lags[0].copy()
        for weight, lag in zip(weights, self.lags[1:]):
            total += weight * (lag + lag.T)
        return _positive(total, self.lags[0])

    def mapped(self, matrix: Array) -> 'Autocovariance':
        """Noise of ``matrix @ x``."""
        return Autocovariance(matrix @ self.lags @ matrix.T, self.blocks)


def _taper() -> Array:
    return 1 - np.arange(1, LAGS + 1) / (LAGS + 1)


def _positive(total: Array, variance: Array) -> Array:
    """Keep an estimated long-run covariance from falling far below that of one block."""
    scale = np.sqrt(np.diag(variance))
    scale[scale == 0] = 1.0
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    kept = (vectors * np.maximum(values, 0.2)) @ vectors.T
    return np.asarray(kept * np.outer(scale, scale))


def autocovariance(windows: list[Array]) -> Autocovariance:
    """
    Measure the noise of block means while nothing moves.

    The mean of each window is taken off; the bias that leaves behind is put right.

    Parameters
    ----------
    windows : list of ndarray, shape (n_i, k)
        Consecutive blocks of each window; NaN rows are left out.

    Returns
    -------
    Autocovariance
    """
    centred = [w - np.nanmean(w, axis=0) for w in windows if np.isfinite(w).all(1).sum() > LAGS]
    n = sum(int(np.isfinite(w).all(1).sum()) for w in centred)
    if not n:
        raise DataError(f'the robot stood still for less than {LAGS + 1} blocks at a time; '
                        'hold each pose for a second or more')
    clean = [np.where(np.isfinite(w).all(1)[:, None], w, 0.0) for w in centred]
    lags = []
    for lag in range(LAGS + 1):
        pairs = sum(int((np.isfinite(w[:len(w) - lag]).all(1)
                         & np.isfinite(w[lag:]).all(1)).sum()) for w in centred)
        total = sum(c[:len(c) - lag].T @ c[lag:] for c in clean)
        lags.append(np.asarray(total) / max(pairs, 1))
    raw = Autocovariance(np.stack(lags), n)
    weight = 1 + 2 * _taper().sum()
    length = n / len(centred)
    shortfall = raw.total / max(length - weight, 1.0)
    return Autocovariance(raw.lags + shortfall, n)


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
    total = np.einsum('nip,ij,njq->pq', rows, noise.lags[0], rows, optimize=True)
    for weight, lag, shift in zip(_taper(), noise.lags[1:], range(1, LAGS + 1)):
        cross = np.einsum('nip,ij,njq->pq', rows[:-shift], lag, rows[shift:], optimize=True)
        total += weight * (cross + cross.T)
    return np.asarray(total)


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
