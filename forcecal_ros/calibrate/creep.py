"""The end of the robot's approach: what it still moves while the tool is said to ring freely.

Robots arrive exponentially. Tens of micrometres over a tenth of a second are 0.05 % of damping.
"""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import PoseStream
import numpy as np

RATE = 8.0
"""Rate at which the last of an approach decays [1/s]; slower adds no force, faster is over."""


class Creep(NamedTuple):
    """Distance still to go along x at the start, x_end + way exp(-RATE t), and its error [m]."""

    way: float
    std: float


STANDS = Creep(0.0, 0.0)


def fit_creep(pose: PoseStream) -> Creep:
    """
    Fit the creep to the measured pose.

    Parameters
    ----------
    pose : PoseStream
        From the start of the ringing on.
    """
    if not pose.has_position or len(pose) < 20:
        return STANDS
    t, x = pose.t - pose.t[0], pose.position @ pose.R_base_sensor[0, :, 0]
    rows = np.column_stack([np.ones(len(t)), np.exp(-RATE * t)])
    solution = np.linalg.lstsq(rows, x, rcond=None)[0]
    variance = float(((x - rows @ solution)**2).sum()) / (len(t) - 2)
    return Creep(float(solution[1]), float(np.sqrt(variance * np.linalg.inv(rows.T @ rows)[1, 1])))


def follow(creep: Creep, t: Array, k: float, d: float, mass: float) -> tuple[Array, Array]:
    """
    Say how the tool follows: m s" + d s' + k s = -m x".

    Parameters
    ----------
    t : ndarray, shape (n,)
        Since the start of the ringing [s].
    k, d, mass : float
        [N/m], [N s/m], [kg]

    Returns
    -------
    tuple of ndarray, shape (n,)
        Displacement [m] and the force that goes with it [N].
    """
    way = -mass * RATE**2 * creep.way / (mass * RATE**2 - d * RATE + k)
    slide = way * np.exp(-RATE * t)
    return slide, (k - d * RATE) * slide
