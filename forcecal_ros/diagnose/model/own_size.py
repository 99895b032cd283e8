"""
A discrepancy as large as it is, channel by channel, and what it does to fitted parameters.

A fit allows for a small discrepancy, the same part of the signal in all channels of a stream, so
that an effect does not count for nothing. What is beside it may be larger, and may have the
effect's own shape: then part of it goes into the effect's numbers, and out of what is left.
"""

from collections.abc import Mapping
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.pieces import pieces
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.diagnose.model.products import Products
from forcecal_ros.diagnose.model.scales import Scales, STREAM
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve


def spread(products: Products, assumed: Scales, sizes: Mapping[int, float]) -> Array:
    """
    Return how products of columns and residual vary by a larger discrepancy than assumed.

    Parameters
    ----------
    assumed : tuple of float
        Part of the signals in each stream that the fit allowed for.
    sizes : mapping of int to float
        Part of its signal that each channel has.

    Returns
    -------
    ndarray, shape (k, k)
        Covariance beyond what that fit knows of; 0 where no channel has more.
    """
    out = np.zeros((products.k, products.k))
    for one in products.parts:
        size, known = sizes.get(one.channel, 0.0), assumed[STREAM[one.channel]]
        if size <= known:
            continue
        cross = one.all.cross[:, 1:]
        if known:
            factor = products.whitened.factor(one.channel, False, known)
            cross = cho_solve((factor, True), cross) / known ** 2
        out[np.ix_(one.there, one.there)] += (size ** 2 - known ** 2) * cross.T @ cross
    return out


class Predicted(NamedTuple):
    """
    What training blocks say of a discrepancy.

    Attributes
    ----------
    rows : list of ndarray, shape (n, channels)
        Of each recording.
    unseen : ndarray, shape (channels,)
        Mean square over the held-out blocks by which that may be wrong.
    """

    rows: list[Array]
    unseen: Array


def predicted(products: Products, sizes: Mapping[int, float], datasets: tuple[Dataset, ...]
              ) -> Predicted:
    """
    Predict a discrepancy from the training blocks.

    Parameters
    ----------
    products : Products
        With the residual.
    sizes : mapping of int to float
        Part of its signal that each channel has.
    """
    whitened, weights = products.whitened, {}
    unseen = np.zeros(len(CHANNELS))
    gram = np.sum([_square(rows, d.held) for rows, d in zip(whitened.basis.rows, datasets)],
                  axis=0) / max(1, sum(int(d.held.sum()) for d in datasets))
    for one in products.parts:
        size = sizes.get(one.channel, 0.0)
        if not size or not len(one.trained.cross):
            continue
        modes = whitened.modes(one.channel)
        factor = whitened.factor(one.channel, True, size), True
        weights[one.channel] = modes.weights @ cho_solve(factor, one.trained.cross[:, 0])
        unseen[one.channel] = np.trace(cho_solve(factor, modes.weights.T @ gram @ modes.weights))
    shapes = [(rows.numbers.shape[1], len(CHANNELS)) for rows in whitened.basis.rows]
    return Predicted(whitened.of_weights(weights, shapes), unseen)


def _square(features: Compact, blocks: NDArray[np.bool_]) -> Array:
    """Return inner products of features over some blocks, shape (k, k)."""
    out = np.zeros((len(features.numbers),) * 2)
    for part in pieces(len(blocks)):
        rows = features.values(part)[:, blocks[part]].astype(float)
        out += rows @ rows.T
    return out
