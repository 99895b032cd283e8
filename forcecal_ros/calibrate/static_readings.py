"""What the static poses show, and whether they show enough."""

from typing import NamedTuple

from forcecal_ros.core.errors import below, DataError, UnobservableError
from forcecal_ros.core.geometry import Array
import numpy as np


class Statics(NamedTuple):
    """
    What was read in each static pose.

    Attributes
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    wrench : ndarray, shape (n, 6)
        Mean on the wire [N, N m].
    covariance : ndarray, shape (n, 6, 6), or None
        Of these means; None: not known, taken from the residuals.
    slide : ndarray, shape (n,)
        Mean displacement of the tool along x; zeros for a rigid one [m].
    slide_variance : ndarray, shape (n,)
        Of these means [m^2].
    """

    gravity: Array
    wrench: Array
    covariance: Array | None
    slide: Array
    slide_variance: Array


def gravity_spread(gravity: Array) -> tuple[Array, Array]:
    """
    How far the poses turn gravity about in ft_sensor.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor, one row a pose [m/s^2].

    Returns
    -------
    spread : ndarray, shape (3,)
        Singular values about the mean, per root of poses, gravity taken as 1.
    directions : ndarray, shape (3, 3)
        Rows: the directions they belong to, in ft_sensor.
    """
    return principal_spread(gravity / np.linalg.norm(gravity, axis=1, keepdims=True))


def principal_spread(vectors: Array) -> tuple[Array, Array]:
    """Return the RMS variation (3,) of vectors (n, 3), and its principal directions (3, 3)."""
    padded = np.vstack([vectors - vectors.mean(axis=0), np.zeros((3, 3))])
    _, size, directions = np.linalg.svd(padded, full_matrices=False)
    return size / np.sqrt(len(vectors)), directions


def check_weight(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not tell the mass from the bias.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest reciprocal of the first spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    spread, _ = gravity_spread(gravity)
    n = len(gravity)
    if spread[0] < 1 / condition:
        raise UnobservableError(
            f'{n} static pose{"s" * (n > 1)} with gravity along one direction of ft_sensor '
            f'(spread {below(spread[0], 1 / condition, 2)}, wanted {1 / condition:g}): mass and '
            'bias cannot be told apart; add a pose tilted by 90 deg about y of ft_sensor, and one '
            'about x')


def check_poses(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not determine mass, centre of mass and biases.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest ratio of the first to the second spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    check_weight(gravity, condition)
    spread, directions = gravity_spread(gravity)
    if spread[1] * condition >= spread[0]:
        return
    mean = gravity.mean(axis=0) / np.linalg.norm(gravity, axis=1).mean()
    # across the line that gravity moves along, out of the plane it spans with the mean
    missing = np.cross(directions[0], mean)
    if np.linalg.norm(missing) < 1e-3:
        missing = directions[1]
    axis = int(np.argmax(np.round(np.abs(np.cross(mean, missing)), 3)))
    raise UnobservableError(
        f'centre of mass and torque bias are not observable from {len(gravity)} static poses: '
        f'gravity moves along one line of ft_sensor (condition '
        f'{spread[0] / max(spread[1], 1e-12):.3g} > {condition:.3g}); '
        f'add a pose tilted about {"xyz"[axis]} of ft_sensor')


class TurnedWrench(DataError):
    """The wrench has the opposite sign: what is measured is the other body's."""


def refuse_negative(mass: float) -> None:
    """
    Refuse a mass below zero.

    Raises
    ------
    TurnedWrench
    """
    if mass <= 0:
        raise TurnedWrench(
            f'the mass comes out as {mass:.4g} kg: the wrench has the opposite sign')
