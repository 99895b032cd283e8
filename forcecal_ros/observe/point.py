"""Where a contact force acts: the point of its line of action nearest to the sensor."""

from typing import NamedTuple

from forcecal_ros.geometry import Array, skew
import numpy as np

PLAIN = 3.0
"""A force acts somewhere from so many of its standard deviations on; below, its line of action is
noise [1]."""


class ContactPoint(NamedTuple):
    """
    Where a force acts, as far as one wrench tells.

    Attributes
    ----------
    position : ndarray, shape (3,)
        In ft_sensor [m]. The force may act anywhere along its line through this point.
    covariance : ndarray, shape (3, 3)
        [m^2]
    """

    position: Array
    covariance: Array


def contact_point(wrench: Array, covariance: Array) -> ContactPoint | None:
    """
    Find the point from a wrench (6,) about the origin, and the covariance (6, 6) of its error.

    p = F x T / |F|^2, its covariance to first order; exact for a force without a couple. None
    where the force is not plain against its error.
    """
    F, T = wrench[:3], wrench[3:]
    squared = float(F @ F)
    if not squared > PLAIN ** 2 * float(np.trace(covariance[:3, :3])):
        return None
    p = np.cross(F, T) / squared
    J = np.hstack([-skew(T) / squared - 2 * np.outer(p, F) / squared, skew(F) / squared])
    return ContactPoint(p, J @ covariance @ J.T)
