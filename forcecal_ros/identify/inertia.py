"""Inertia of the tool from rotations that were made, in the poses' transits or elsewhere.

In free motion the wire's torque less that of the wire's force at the centre of mass is what
turns the tool:

    n - b_n - (c + s x_hat) x (F - b_F) = -(J alpha + omega x J omega)
"""

from typing import NamedTuple

from forcecal_ros.geometry import Array, skew
from forcecal_ros.identify.estimating import jacobian
from forcecal_ros.recording.kinematics import smoothed
from forcecal_ros.recording.noise.autocovariance import noise_of_windows
import numpy as np
from numpy.typing import NDArray

ELEMENTS = ('xx', 'yy', 'zz', 'xy', 'xz', 'yz')


class InertiaFit(NamedTuple):
    """
    Result.

    Attributes
    ----------
    elements : ndarray, shape (6,)
        J_xx, J_yy, J_zz, J_xy, J_xz, J_yz about the centre of mass [kg m^2].
    covariance : ndarray, shape (6, 6)
    weakest : ndarray, shape (6,)
        Combination of elements that the motion determines worst, of unit norm.
    """

    elements: Array
    covariance: Array
    weakest: Array

    @property
    def matrix(self) -> Array:
        """Shape (3, 3)."""
        return symmetric(self.elements)

    @property
    def std(self) -> Array:
        """Standard errors, shape (3, 3)."""
        return symmetric(np.sqrt(np.diag(self.covariance)))


def symmetric(e: Array) -> Array:
    """Return the matrix of elements xx, yy, zz, xy, xz, yz, shape (3, 3)."""
    return np.array([[e[0], e[3], e[4]], [e[3], e[1], e[5]], [e[4], e[5], e[2]]])


def inertia_regressor(omega: Array, alpha: Array) -> Array:
    """
    Matrix that turns the six elements of J into J alpha + omega x J omega.

    Parameters
    ----------
    omega, alpha : ndarray, shape (n, 3)
        In ft_sensor [rad/s], [rad/s^2].

    Returns
    -------
    ndarray, shape (n, 3, 6)
    """
    return _times(alpha) + skew(omega) @ _times(omega)


def _times(v: Array) -> Array:
    """Return (n, 3, 6) so that it times the elements of J is J v."""
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.stack([np.stack([x, o, o, y, z, o], axis=1), np.stack([o, y, o, x, o, z], axis=1),
                     np.stack([o, o, z, o, x, y], axis=1)], axis=1)


def unexplained_torque(wrench: Array, slide: Array, tool: Array) -> Array:
    """
    Wire's torque less bias and less that of the wire's force at the centre of mass.

    Parameters
    ----------
    wrench : ndarray, shape (n, 6)
    slide : ndarray, shape (n,)
        Of the tool along x [m].
    tool : ndarray, shape (10,)
        Mass, force bias, com, torque bias.

    Returns
    -------
    ndarray, shape (n, 3)
        [N m]
    """
    lever = tool[4:7] + slide[:, None] * np.array([1.0, 0.0, 0.0])
    return np.asarray(wrench[:, 3:] - tool[7:10] - np.cross(lever, wrench[:, :3] - tool[1:4]))


def identify_inertia(
        wrench: Array, slide: Array, omega: Array, alpha: Array, free: NDArray[np.bool_],
        still: NDArray[np.intp], tool: Array, tool_covariance: Array) -> InertiaFit | None:
    """
    Fit the inertia to all blocks of free motion.

    Parameters
    ----------
    wrench : ndarray, shape (n, 6)
        Block means on the wire; NaN where missing.
    slide : ndarray, shape (n,)
        [m]
    omega, alpha : ndarray, shape (n, 3)
        In ft_sensor [rad/s], [rad/s^2].
    free, still : ndarray, shape (n,)
        Free motion; which static pose, -1 for none.
    tool, tool_covariance : ndarray, shapes (10,), (10, 10)
        Mass, force bias, com, torque bias.

    Returns
    -------
    InertiaFit or None
        None where the robot never turned the tool.
    """
    use = free & np.isfinite(wrench).all(1) & np.isfinite(slide) & np.isfinite(alpha).all(1)
    if use.sum() < 12:
        return None
    rows = -inertia_regressor(np.nan_to_num(omega), np.nan_to_num(alpha))
    smooth = smoothed(rows)
    torque = np.where(use[:, None], unexplained_torque(wrench, slide, tool), 0.0)
    still_torque = [unexplained_torque(wrench[still == i], slide[still == i], tool)
                    for i in range(still.max() + 1)]
    weight = np.linalg.inv(noise_of_windows(still_torque).covariance)
    weighted = np.where(use[:, None, None], weight @ smooth, 0.0)
    normal = np.einsum('nip,niq->pq', weighted, rows)
    # what noise of the orientation adds to the products, measured where there is nothing else
    at_rest = still >= 0
    normal -= use.sum() / at_rest.sum() * np.einsum(
        'nip,niq->pq', weight @ smooth[at_rest], rows[at_rest])
    sigma, vectors = np.linalg.eigh((normal + normal.T) / 2)
    if sigma[-1] <= 0 or sigma[0] < 1e-9 * sigma[-1]:
        return None
    inverse = np.linalg.inv(normal)
    elements = inverse @ np.einsum('nip,ni->p', weighted, torque)
    by_tool = inverse @ jacobian(
        lambda v: np.einsum('nip,ni->p', weighted, np.where(
            use[:, None], unexplained_torque(wrench, slide, v), 0.0)),
        tool, np.array([1e-3] * 4 + [1e-5] * 3 + [1e-3] * 3))
    noise = noise_of_windows([torque - smooth[still == i] @ elements
                              for i, torque in enumerate(still_torque)])
    covariance = inverse @ noise.covariance_of_sum(weighted) @ inverse.T \
        + by_tool @ tool_covariance @ by_tool.T
    return InertiaFit(elements, covariance, vectors[:, 0])
