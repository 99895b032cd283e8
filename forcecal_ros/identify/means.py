"""Means of signals while the robot stands still."""

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.white import white_covariance
from forcecal_ros.recording.streams import Stream
import numpy as np


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
        noise = np.sqrt(np.diag(white_covariance(blocks, 1)))
        step = blocks[n // 2:].mean(axis=0) - blocks[:n // 2].mean(axis=0)
        sigmas = np.abs(step) / np.maximum(noise * np.sqrt(4 / n), 1e-300)
        sigmas[noise == 0] = 0
        if sigmas.max() > worst[0]:
            worst = (float(sigmas.max()), i, int(np.argmax(sigmas)))
    return worst
