"""The sensor's offset from gravity directions and raw measurements, [Traversaro2014] Eq. 11-17.

In the subspace, y = E g + y_o with the twelve unknowns E (3 x 3) and y_o (3): a linear regression
on the measured gravity, not the fit of a quadric to the cloud.
"""

from collections.abc import Sequence

from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
from forcecal_ros.insitu.moments import Moments
from forcecal_ros.insitu.subspace import from_coordinates, from_scatter, Subspace, to_coordinates
import numpy as np


def offset_rows(gravity: Array) -> Array:
    """
    Regressor of the twelve unknowns, [g^T (x) I, I] a sample. [Traversaro2014] Eq. 14, 16.

    Parameters
    ----------
    gravity : ndarray, shape (N, 3)

    Returns
    -------
    ndarray, shape (3 N, 12)
        For the unknowns [vec E; y_o], vec stacking columns (Eq. 1, 17).
    """
    ones = np.ones((len(gravity), 1))
    return np.asarray(np.kron(np.hstack([gravity, ones]), np.eye(3)))


def offset_coordinates(subspace: Subspace, gravity: Array, raw: Array) -> Array:
    """
    Coordinates of the offset from samples, by least squares. [Traversaro2014] Eq. 13-17.

    The form of the paper, for data at hand; :func:`offset_of` does the same from moments.

    Parameters
    ----------
    gravity : ndarray, shape (N, 3)
    raw : ndarray, shape (N, n)

    Returns
    -------
    ndarray, shape (3,)
    """
    y = to_coordinates(subspace, raw).ravel()
    return np.linalg.lstsq(offset_rows(gravity), y, rcond=None)[0][9:]


def offset_of(moments: Moments) -> Array:
    """
    Offset of one data set. [Traversaro2014] Eq. 9-17.

    The regression of all channels is projected on the subspace, which gives what a regression of
    the projected channels gives.

    Returns
    -------
    ndarray, shape (n,)
    """
    total = moments.count * moments.mean
    intercept = (total - moments.ones @ moments.raw) / moments.constant_weight
    if moments.directions.shape[1] > 3:
        return np.asarray(intercept)
    subspace = from_scatter(moments.mean, moments.scatter)
    return from_coordinates(subspace, to_coordinates(subspace, intercept))


def shared_offset(data_sets: Sequence[Moments]) -> Array:
    """
    One offset of several data sets, each weighted by what it knows of a constant.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    UnobservableError
        Gravity does not move enough in any data set.
    """
    weights = np.array([moments.constant_weight for moments in data_sets])
    if not (weights > 0).all():
        raise UnobservableError('gravity does not move beyond its noise; tilt the body further')
    return np.average([offset_of(moments) for moments in data_sets], axis=0, weights=weights)
