"""What the residuals of single samples say, where no noise is known to judge them by."""

from collections.abc import Iterator
from typing import NamedTuple

from forcecal_ros.geometry import Array
import numpy as np
from scipy.special import stdtr

_SHARE = 0.05
"""Scatter about one tool, as a share of the span of the forces, from which it is no sensor's:
data sheets promise 2 % at most of a range, and the real arm's residuals here are 0.7 %."""

_ARM = 0.05
"""Range of torque over range of force of wrist sensors, 0.03 to 0.08 [m]: torques of a tool whose
centre of mass is nearer scatter like those of one that is so far."""

_FEWEST = 8
"""Poses from which the residuals of all but one tell what the one should be."""


class Outlier(NamedTuple):
    """The pose that is farthest off: which, in which channel, by how much [N, N m]; and chance."""

    pose: int
    channel: int
    size: float
    probability: float


def scatters(residuals: Array, wrench: Array, com: Array) -> Iterator[tuple[int, float, float]]:
    """
    Find channels that scatter about one tool by more than a sensor does.

    Parameters
    ----------
    residuals, wrench : ndarray, shape (n, 6)
        Read minus fitted; read [N, N m].
    com : ndarray, shape (3,)
        Centre of mass [m].

    Yields
    ------
    channel, rms, share : int, float, float
        Share of the span of the forces, of torques times the arm of the tool.
    """
    span = float(np.ptp(wrench[:, :3], axis=0).max())
    arm = max(_ARM, float(np.linalg.norm(com)))
    for j, rms in enumerate(np.sqrt((residuals**2).mean(axis=0))):
        share = float(rms) / (span * (1.0 if j < 3 else arm))
        if share > _SHARE:
            yield j, float(rms), share


def farthest(residuals: Array) -> Outlier | None:
    """
    Find the reading that is farthest off (Grubbs, Technometrics 11, 1969).

    Parameters
    ----------
    residuals : ndarray, shape (n, 6)

    Returns
    -------
    Outlier or None
        None of too few poses.
    """
    n = len(residuals)
    if n < _FEWEST:
        return None
    spread = residuals.std(axis=0, ddof=1)
    G = np.abs(residuals) / np.maximum(spread, 1e-300)
    i, j = (int(k) for k in np.unravel_index(np.argmax(G), G.shape))
    square = n * (n - 2) * G[i, j]**2 / max((n - 1)**2 - n * G[i, j]**2, 1e-300)
    chance = 2 * residuals.size * stdtr(n - 2, -np.sqrt(square))
    return Outlier(i, j, float(residuals[i, j]), float(min(1.0, chance)))
