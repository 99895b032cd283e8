"""How the sensor turns, block by block, from its measured orientation."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from forcecal_ros.geometry import Array, rotation_vector, skew
from forcecal_ros.identify.blocks import Grid
from forcecal_ros.samples import PoseStream


class Turning(NamedTuple):
    """
    Orientation and its derivatives, in ft_sensor, at each block.

    Attributes
    ----------
    R_base_sensor : ndarray, shape (n, 3, 3)
        In the middle of the block.
    omega, alpha : ndarray, shape (n, 3)
        Means over the block [rad/s], [rad/s^2].
    """

    R_base_sensor: Array
    omega: Array
    alpha: Array

    @property
    def lever(self) -> Array:
        """[alpha]x + [omega]x [omega]x: what a lever arm is accelerated by, (n, 3, 3) [1/s^2]."""
        W = skew(self.omega)
        return np.asarray(skew(self.alpha) + W @ W)


def turning(pose: PoseStream, grid: Grid, delay: float = 0.0) -> Turning:
    """
    Differentiate the measured orientation.

    Parameters
    ----------
    pose : PoseStream
    grid : Grid
    delay : float
        How much later than the wrench the pose shows the same instant [s].

    Returns
    -------
    Turning
    """
    edges = np.append(grid.starts, grid.starts[-1] + grid.length) + delay
    spline = RotationSpline(pose.t, Rotation.from_matrix(pose.R_base_sensor))
    inside = np.clip(edges, pose.t[0], pose.t[-1])
    R = spline(inside).as_matrix()
    middle = spline(np.clip(edges[:-1] + grid.length / 2, pose.t[0], pose.t[-1])).as_matrix()
    omega = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / grid.length
    alpha = np.zeros_like(omega)
    alpha[2:-2] = (8 * (omega[3:-1] - omega[1:-3]) - (omega[4:] - omega[:-4])) / (12 * grid.length)
    return Turning(np.asarray(middle), omega, alpha)
