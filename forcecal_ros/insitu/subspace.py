"""The three dimensions that raw measurements live in, [Traversaro2014] Lemma 1 and Eq. 9-13."""

from dataclasses import dataclass

from forcecal_ros.geometry import Array
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
