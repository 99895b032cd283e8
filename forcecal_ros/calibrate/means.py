"""Signals in static poses: their means, and what moves in them."""

from typing import NamedTuple

from forcecal_ros.checks.signals import resolution
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.noise.white import white_covariance
from forcecal_ros.core.streams import Stream
import numpy as np

_WINDOWS, _SAMPLES = 3, 10
"""Fewer windows have no usual one among them, fewer samples in one do not show how they move."""


def window_mean(stream: Stream, start: float, end: float, what: str = 'signal') -> Array:
    """
    Mean of a signal while the robot stands still, [Gamez2005] Eq. 11, [Gamez2005] Eq. 14.

    Parameters
    ----------
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


DRIFT = 6.0
"""Drifts within a static pose of fewer standard errors are taken for chance."""


def drift(stream: Stream, windows: list[tuple[float, float]]) -> tuple[float, int, int]:
    """
    Find the strongest drift of a signal while the robot stands.

    Parameters
    ----------
    windows : list of tuple of float
        Start and end [s].

    Returns
    -------
    sigmas, window, channel : float, int, int
        Mean of the second half less that of the first, in standard errors by noise that may be
        coloured; 0 where the windows hold too few samples to tell.
    """
    parts = [stream.between(start, end).values for start, end in windows]
    size = max(1, int(np.median([len(part) for part in parts])) // 40) if parts else 1
    whole = [(i, _block_means(part, size)) for i, part in enumerate(parts)
             if len(part) // size >= 20]
    if not whole:
        return 0.0, 0, 0
    noise = noise_of_windows([_detrended(blocks) for _, blocks in whole]).at_least_white
    worst = (0.0, 0, 0)
    for i, blocks in whole:
        n = len(blocks) // 2 * 2
        step = np.abs(blocks[n // 2:n].mean(axis=0) - blocks[:n // 2].mean(axis=0))
        white = np.diag(white_covariance(blocks, 1))
        sigmas = step / np.sqrt(np.maximum(np.maximum(np.diag(noise), white) * 4 / n, 1e-300))
        sigmas[white == 0] = 0
        if sigmas.max() > worst[0]:
            worst = (float(sigmas.max()), i, int(np.argmax(sigmas)))
    return worst


class Restless(NamedTuple):
    """
    A window in which a signal moves more than in the others.

    Attributes
    ----------
    times : float
        Standard deviation there over the median of all windows.
    size : float
        That standard deviation.
    window, channel : int
    """

    times: float
    size: float
    window: int
    channel: int


def restless(stream: Stream, windows: list[tuple[float, float]]) -> Restless | None:
    """
    Find where a signal moves more than elsewhere while the robot stands.

    A jump within a window widens the noise that is seen there, and hides behind it.

    Parameters
    ----------
    windows : list of tuple of float
        Start and end [s].

    Returns
    -------
    Restless or None
        None where windows or their samples are too few.
    """
    parts = [stream.between(start, end).values for start, end in windows]
    if len(parts) < _WINDOWS or min(map(len, parts)) < _SAMPLES:
        return None
    spread = np.array([part.std(axis=0) for part in parts])
    step = np.array([resolution(column) for column in np.concatenate(parts).T])
    usual = np.maximum(np.median(spread, axis=0), step)
    times = np.where(usual > 0, spread / np.where(usual > 0, usual, 1.0), 0.0)
    window, channel = map(int, np.unravel_index(int(np.argmax(times)), times.shape))
    return Restless(float(times.max()), float(spread[window, channel]), window, channel)


def _block_means(values: Array, size: int) -> Array:
    n = len(values) // size
    return np.asarray(values[:n * size].reshape(n, size, -1).mean(axis=1))


def _detrended(blocks: Array) -> Array:
    """Take a line off, which is drift and no noise."""
    t = np.linspace(-1.0, 1.0, len(blocks))
    return np.asarray(blocks - blocks.mean(axis=0) - np.outer(t, t @ blocks / (t @ t)))
