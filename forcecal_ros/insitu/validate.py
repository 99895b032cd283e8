"""Added masses and their positions by a calibrated sensor: [Traversaro2014] Tables I to III."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.insitu.matrix import body_of
from forcecal_ros.insitu.motion import body_map
import numpy as np


class LoadEstimate(NamedTuple):
    """
    The load of one data set by a calibrated sensor.

    ``semi_axes`` (3,) of the ellipsoid of forces, longest first [N]; ``mass`` added, [kg];
    ``position`` (3,) of the added mass, NaN where there is none to speak of [m].
    """

    semi_axes: Array
    mass: float
    position: Array


def force_map(wrench: Array, gravity: Array, total: Array) -> Array:
    """
    Linear map from gravity to the measured force, what motion adds taken off.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
    gravity : ndarray, shape (N, m)
    total : ndarray, shape (4,) or (16,)
        Body with what is added to it.

    Returns
    -------
    ndarray, shape (3, 3)
        Mass times identity for a perfect sensor [kg].
    """
    motion = gravity[:, 3:] @ body_map(total, gravity.shape[1])[:3, 3:].T
    return np.linalg.lstsq(gravity[:, :3], wrench[:, :3] - motion, rcond=1e-10)[0].T


def semi_axes(linear: Array, magnitude: float) -> Array:
    """
    Semi-axes of the ellipsoid that gravity's sphere becomes. [Traversaro2014] Table I.

    Parameters
    ----------
    linear : ndarray, shape (3, 3)
        Map from gravity to force [kg].
    magnitude : float
        Of gravity [m/s^2].

    Returns
    -------
    ndarray, shape (3,)
        Longest first [N].
    """
    return magnitude * np.linalg.svd(linear, compute_uv=False)


def estimate_load(wrench: Array, gravity: Array, body: Array, magnitude: float,
                  position_wanted: bool) -> LoadEstimate:
    """
    Estimate the added mass and its position from a calibrated sensor. Tables I to III.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
        C (r - o) of the pseudo-samples.
    gravity : ndarray, shape (N, m)
    body : ndarray, shape (4,) or (16,)
        Without the added mass.
    magnitude : float
        Of gravity [m/s^2].
    position_wanted : bool
        False where nothing was added.
    """
    total = body_of(wrench, gravity)
    added = total - body
    position = added[1:4] / added[0] if position_wanted and added[0] else np.full(3, np.nan)
    axes = semi_axes(force_map(wrench, gravity, total), magnitude)
    return LoadEstimate(axes, float(added[0]), position)
