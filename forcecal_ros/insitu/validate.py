"""What a calibrated sensor says of the loads: [Traversaro2014] Tables I, II and III."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.insitu.matrix import body_of
import numpy as np


class Felt(NamedTuple):
    """
    One data set as a calibrated sensor feels it.

    ``semi_axes`` (3,) of the ellipsoid of forces, longest first [N]; ``mass`` added, [kg];
    ``position`` (3,) of the added mass, NaN where there is none to speak of [m].
    """

    semi_axes: Array
    mass: float
    position: Array


def force_map(wrench: Array, gravity: Array) -> Array:
    """
    Linear map from gravity to the measured force, shape (3, 3) [kg].

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
    gravity : ndarray, shape (N, m)

    Returns
    -------
    ndarray, shape (3, 3)
        Mass times identity for a perfect sensor.
    """
    return np.asarray(np.linalg.lstsq(gravity, wrench[:, :3], rcond=1e-10)[0][:3].T)


def semi_axes(wrench: Array, gravity: Array, magnitude: float) -> Array:
    """
    Semi-axes of the ellipsoid that gravity's sphere becomes. [Traversaro2014] Table I.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
    gravity : ndarray, shape (N, m)
    magnitude : float
        Of gravity [m/s^2].

    Returns
    -------
    ndarray, shape (3,)
        Longest first [N].
    """
    return magnitude * np.linalg.svd(force_map(wrench, gravity), compute_uv=False)


def feel(wrench: Array, gravity: Array, body: Array, magnitude: float,
         position_wanted: bool) -> Felt:
    """
    Estimate the added mass and its position from a calibrated sensor. Tables I to III.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
        C (r - o) of the pseudo-samples.
    gravity : ndarray, shape (N, m)
    body : ndarray, shape (4,) or (10,)
        Without the added mass.
    magnitude : float
        Of gravity [m/s^2].
    position_wanted : bool
        False where nothing was added.

    Returns
    -------
    Felt
    """
    added = body_of(wrench, gravity) - body
    position = added[1:4] / added[0] if position_wanted and added[0] else np.full(3, np.nan)
    return Felt(semi_axes(wrench, gravity, magnitude), float(added[0]), position)
