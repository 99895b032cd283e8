"""One forward model of a tool on a sensor: wrench from measured motion and parameters."""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.core.time_grid import Averager
import numpy as np

INERTIAL = 10
"""Parameters of a rigid body: mass, first moments (3), inertia about the sensor (6)."""


class BodyMotion(NamedTuple):
    """
    Motion of ft_sensor on a grid, seen in ft_sensor.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    apparent_gravity : ndarray, shape (n, 3)
        Gravity minus acceleration of the sensor's origin [m/s^2].
    omega, alpha : ndarray, shape (n, 3)
        [rad/s], [rad/s^2]
    """

    t: Array
    apparent_gravity: Array
    omega: Array
    alpha: Array


def rate_of_change(means: Array, length: float) -> Array:
    """Differentiate means (n, k) of blocks of length [s], to fourth order; 0 in the outer two."""
    out = np.zeros_like(means)
    out[2:-2] = (8 * (means[3:-1] - means[1:-3]) - (means[4:] - means[:-4])) / (12 * length)
    return out


def body_motion(pose: PoseStream, starts: Array, length: float, gravity: Array) -> BodyMotion:
    """
    Differentiate block means of a pose by central differences, to fourth order.

    Without positions the origin of the sensor is taken as unaccelerated.

    Parameters
    ----------
    starts : ndarray, shape (n,)
        Starts of blocks, evenly `length` apart, within the pose's time [s].
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    """
    means = Averager(pose.t, pose.R_base_sensor.reshape(-1, 9)).interpolated(starts, length)
    U, _, Vt = np.linalg.svd(means.reshape(-1, 3, 3))
    R = U @ Vt
    rate = np.swapaxes(R, 1, 2) @ rate_of_change(R.reshape(-1, 9), length).reshape(-1, 3, 3)
    omega = np.stack([rate[:, 2, 1] - rate[:, 1, 2], rate[:, 0, 2] - rate[:, 2, 0],
                      rate[:, 1, 0] - rate[:, 0, 1]], axis=1) / 2
    accel = np.zeros((len(starts), 3))
    if pose.has_position:
        place = Averager(pose.t, pose.position - pose.position[0]).interpolated(starts, length)
        accel = rate_of_change(rate_of_change(place, length), length)
    force = np.einsum('nij,ni->nj', R, gravity - accel)
    return BodyMotion(starts + length / 2, force, omega, rate_of_change(omega, length))


def inertia_columns(v: Array) -> Array:
    """Return I v by the elements xx, yy, zz, xy, xz, yz of I, shape (n, 3, 6)."""
    x, y, z, o = *v.T, np.zeros(len(v))
    return np.stack([np.stack([x, o, o, y, z, o], 1), np.stack([o, y, o, x, o, z], 1),
                     np.stack([o, o, z, o, x, y], 1)], axis=1)


def symmetric(e: Array) -> Array:
    """Return the matrix of elements xx, yy, zz, xy, xz, yz, shape (3, 3)."""
    return np.array([[e[0], e[3], e[4]], [e[3], e[1], e[5]], [e[4], e[5], e[2]]])


def sliding(motion: BodyMotion, slide: Array, length: float) -> BodyMotion:
    """Return the motion of a tool that is displaced along x by `slide` (n,) [m]."""
    accel = acceleration_of_slide(slide, motion.omega, motion.alpha, length)
    return motion._replace(apparent_gravity=motion.apparent_gravity - accel)


def acceleration_of_slide(slide: Array, omega: Array, alpha: Array, length: float) -> Array:
    """Return the acceleration (n, 3) of a point at `slide` (n,) along x against the origin."""
    s = slide[:, None] * [1.0, 0.0, 0.0]
    speed, W = rate_of_change(s, length), skew(omega)
    return np.asarray(rate_of_change(speed, length) + 2 * np.cross(omega, speed)
                      + np.einsum('nij,nj->ni', skew(alpha) + W @ W, s))


def regressor(motion: BodyMotion, slide: Array | None = None) -> Array:
    """
    Return the wrench by each parameter, shape (n, 6, 10).

    Parameters
    ----------
    slide : ndarray, shape (n,), or None
        Displacement of the tool along x [m], in whose `motion` it is contained; None: rigid.

    Notes
    -----
    F = m u - (alpha x + omega x omega x) m c and T = m c x u - I alpha - omega x I omega, with
    apparent gravity u = g - a, first moments m c and inertia I about the sensor's origin (xx, yy,
    zz, xy, xz, yz).
    """
    W = skew(motion.omega)
    X = np.zeros((len(motion.t), 6, INERTIAL))
    X[:, :3, 0] = motion.apparent_gravity
    X[:, :3, 1:4] = -(skew(motion.alpha) + W @ W)
    X[:, 3:, 1:4] = -skew(motion.apparent_gravity)
    if slide is not None:
        X[:, 3:, 0] = slide[:, None] * np.cross([1.0, 0.0, 0.0], motion.apparent_gravity)
        X[:, 3:, 1:4] += slide[:, None, None] * (skew(np.array([1.0, 0.0, 0.0])) @ X[:, :3, 1:4])
    X[:, 3:, 4:] = -(inertia_columns(motion.alpha) + W @ inertia_columns(motion.omega))
    return X
