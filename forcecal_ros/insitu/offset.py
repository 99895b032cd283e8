"""
The sensor's offset, and the three dimensions of raw measurements, [Traversaro2014] Lemma 1.

In the subspace, y = E g + y_o with the twelve unknowns E (3 x 3) and y_o (3): a linear regression
on the measured gravity, not the fit of a quadric to the cloud.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.moments import Moments
import numpy as np


@dataclass(frozen=True)
class Subspace:
    """
    Affine space of the raw measurements of one data set.

    Attributes
    ----------
    mean : ndarray, shape (n,)
        A point of it, Eq. 9.
    basis : ndarray, shape (n, 3)
        Orthonormal, Eq. 10.
    """

    mean: Array
    basis: Array


def mean_measurement(raw: Array) -> Array:
    """Mean of the raw measurements (N, n), a point of their subspace. [Traversaro2014] Eq. 9."""
    return np.asarray(raw.mean(axis=0))


def principal_directions(raw: Array) -> tuple[Array, Array]:
    """
    Directions of the scatter by a singular value decomposition. [Traversaro2014] Eq. 10.

    Parameters
    ----------
    raw : ndarray, shape (N, n)

    Returns
    -------
    basis : ndarray, shape (n, 3)
        Orthonormal, strongest first.
    singular_values : ndarray, shape (n,)
        Over sqrt(N).
    """
    _, s, vh = np.linalg.svd(raw - mean_measurement(raw), full_matrices=False)
    return vh[:3].T, s / np.sqrt(len(raw))


def from_scatter(mean: Array, scatter: Array) -> Subspace:
    """
    Subspace from a covariance; Eq. 10 without the samples, and with noise taken off.

    Parameters
    ----------
    mean : ndarray, shape (n,)
    scatter : ndarray, shape (n, n)
    """
    _, vectors = np.linalg.eigh(scatter)
    return Subspace(mean, vectors[:, :-4:-1])


def to_coordinates(subspace: Subspace, raw: Array) -> Array:
    """
    Coordinates y of raw measurements, B^T (r - mean). [Traversaro2014] Eq. 12, 13 (left side).

    Parameters
    ----------
    raw : ndarray, shape (..., n)

    Returns
    -------
    ndarray, shape (..., 3)
    """
    return np.asarray((raw - subspace.mean) @ subspace.basis)


def from_coordinates(subspace: Subspace, coordinates: Array) -> Array:
    """
    Raw measurement at given coordinates, mean + B y. [Traversaro2014] Eq. 11.

    Parameters
    ----------
    coordinates : ndarray, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., n)
    """
    return np.asarray(subspace.mean + coordinates @ subspace.basis.T)


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
