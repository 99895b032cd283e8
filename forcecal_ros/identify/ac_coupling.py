"""The first-order high-pass of an AC-coupled accelerometer."""

from dataclasses import replace

from forcecal_ros.geometry import Array
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.recording.streams import Stream
import numpy as np


def lowpassed(f: Array, length: float, cutoff: float) -> Array:
    """
    Block means of what a first-order high-pass takes off, starting from state 0.

    The output of the high-pass is f minus this, but for its unknown initial state w0, which adds
    ``w0 * fading(...)``; within a block f is taken as constant.

    Parameters
    ----------
    f : ndarray, shape (n, ...)
        Block means of consecutive blocks.
    length : float
        Of the blocks [s].
    cutoff : float
        Corner [Hz].

    Returns
    -------
    ndarray, shape (n, ...)
    """
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    x = 2 * np.pi * cutoff * length
    keep = np.exp(-x)
    at_start = lfilter([0.0, 1 - keep], [1.0, -keep], f, axis=0)
    return np.asarray(f + (at_start - f) * (1 - keep) / x)


def fading(n: int, length: float, cutoff: float) -> Array:
    """
    Block means of exp(-2 pi cutoff t), t from the start of the first block.

    Parameters
    ----------
    length, cutoff : float
        [s], [Hz]

    Returns
    -------
    ndarray, shape (n,)
    """
    x = 2 * np.pi * cutoff * length
    return np.asarray(np.exp(-x * np.arange(n)) * (1 - np.exp(-x)) / x)


def without_fading(stream: Stream, poses: list[StaticPose], cutoff: float) -> Stream:
    """
    Take off what fades in each static pose, once it is fitted as a * exp(-2 pi cutoff t).

    Parameters
    ----------
    stream : Stream
        Behind the high-pass.
    cutoff : float
        Corner [Hz].

    Returns
    -------
    Stream
        The same outside the poses.
    """
    values = stream.values.copy()
    for pose in poses:
        i, j = np.searchsorted(stream.t, [pose.start, pose.end])
        shape = np.exp(-2 * np.pi * cutoff * (stream.t[i:j] - pose.start))
        x = np.column_stack([shape, np.ones_like(shape)])
        good = np.isfinite(values[i:j]).all(axis=1)
        size = np.linalg.lstsq(x[good], values[i:j][good], rcond=None)[0][0]
        values[i:j] -= np.outer(shape, size)
    return replace(stream, values=values)
