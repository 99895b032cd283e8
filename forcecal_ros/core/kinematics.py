"""How the sensor moves, block by block, from its measured pose."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_vector, skew
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.core.time_grid import TimeGrid
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.spatial.transform import Rotation, RotationSpline
from scipy.special import comb

CHANCE = 3.0
"""Times the median at rest: the norm of three normal numbers passes it once in 10^5."""

ABRUPT = 0.5
"""
Derivatives to second and to fourth order that differ by more show no acceleration [rad/s^2].

They differ by 0.1 at most on the default motion, and by 0.5 to 40 where it was held back.
"""

REACH = 3
"""Blocks on each side that a derivative and its smoothing reach into."""


class AngularMotion(NamedTuple):
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


class PoseKinematics:
    """Derivatives of the measured pose on a time grid, for any delay."""

    def __init__(self, pose: PoseStream, grid: TimeGrid) -> None:
        self._spline = RotationSpline(pose.t, Rotation.from_matrix(np.array(pose.R_base_sensor)))
        self._place = CubicSpline(pose.t, pose.position) if pose.has_position else None
        self._first, self._last = float(pose.t[0]), float(pose.t[-1])
        self._grid = grid

    def angular(self, delay: float = 0.0) -> AngularMotion:
        """
        Differentiate the measured orientation.

        Parameters
        ----------
        delay : float
            How much later than the grid the pose shows the same instant [s].
        """
        grid = self._grid
        edges = np.append(grid.starts, grid.starts[-1] + grid.length) + delay
        R = self._spline(np.clip(edges, self._first, self._last)).as_matrix()
        middle = edges[:-1] + grid.length / 2
        R_middle = self._spline(np.clip(middle, self._first, self._last)).as_matrix()
        omega = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / grid.length
        return AngularMotion(np.asarray(R_middle), omega, rate_of_change(omega, grid.length))

    def acceleration(self, delay: float = 0.0) -> Array | None:
        """
        Differentiate the measured position twice.

        Parameters
        ----------
        delay : float
            As in :meth:`angular`.

        Returns
        -------
        ndarray, shape (n, 3), or None
            In base [m/s^2]; None where no position was measured.
        """
        if self._place is None:
            return None
        grid = self._grid
        edges = np.append(grid.starts, grid.starts[-1] + grid.length) + delay
        velocity = np.diff(self._place(np.clip(edges, self._first, self._last)), axis=0)
        return rate_of_change(velocity / grid.length, grid.length)


def rate_of_change(means: Array, length: float) -> Array:
    """Differentiate means (n, k) of blocks of length [s], to fourth order; 0 in the outer two."""
    out = np.zeros_like(means)
    out[2:-2] = (8 * (means[3:-1] - means[1:-3]) - (means[4:] - means[:-4])) / (12 * length)
    return out


def acceleration_error(omega: Array, length: float, at_rest: NDArray[np.bool_]) -> Array:
    """
    Tell how far angular accelerations may be off where a motion was abrupt.

    A stop within one command, as of a stream that was held back, is over before the pose has
    shown it. There the derivatives to second and to fourth order differ by more than their noise,
    and the latter is off by as much again.

    Parameters
    ----------
    omega : ndarray, shape (n, 3)
        Means over the blocks [rad/s].
    length : float
        Of the blocks [s].
    at_rest : ndarray of bool, shape (n,)
        Blocks that show the noise.

    Returns
    -------
    ndarray, shape (n,)
        Of the blocks around included, as far as the derivatives reach [rad/s^2]; 0 where smooth.
    """
    apart = np.zeros(len(omega))
    coarse = (omega[3:-1] - omega[1:-3]) / (2 * length)
    apart[2:-2] = np.linalg.norm(rate_of_change(omega, length)[2:-2] - coarse, axis=1)
    noise = float(np.median(apart[at_rest])) if at_rest.any() else 0.0
    beyond: Array = maximum_filter1d(apart, 2 * REACH + 1) - CHANCE * noise
    return 2 * beyond.clip(min=0.0)


def smoothed(rows: Array) -> Array:
    """
    Average over neighbouring blocks with binomial weights.

    Derivatives of the pose are differences: their noise is loud at the blocks' own frequency and
    next to nothing where the motion is. Weighing by smoothed rows, not by the rows themselves,
    keeps that noise from meeting itself in the normal equations.
    """
    return np.asarray(convolve1d(rows, comb(8, np.arange(9)) / 2**8, axis=0, mode='nearest'))
