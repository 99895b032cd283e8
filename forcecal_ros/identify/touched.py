"""Whether something touches the tool in a motion that is taken for free."""

from forcecal_ros.geometry import Array
from forcecal_ros.identify.means import GriddedRecording
from forcecal_ros.identify.tool import Weight
import numpy as np

ASKED = 10.0
"""Acceleration that forces ask of a tool in half of a motion, from which it is no motion of the
tool alone [m/s^2]: hands of arms do as much for moments. Free motions of this package's rigs and
of a KUKA ask for 0.1 to 2, a tool that a hand leads for 10 to 26."""


def accelerations_asked(gridded: GriddedRecording, weight: Weight, gravity: float) -> Array:
    """
    Return what free motion would have to accelerate the tool by, beyond what its pose shows.

    Parameters
    ----------
    gravity : float
        Magnitude [m/s^2].

    Returns
    -------
    ndarray, shape (n,)
        Of the blocks of free motion that hold wrenches: norm of the force that the tool's weight
        leaves over, by its mass [m/s^2].
    """
    R = gridded.kinematics.angular().R_base_sensor
    shown = gridded.kinematics.acceleration()
    free_fall = -gravity * R[:, 2]
    if shown is not None:
        free_fall = free_fall - np.einsum('nij,ni->nj', R, shown)
    asked = (gridded.wrench[:, :3] - weight.force_bias) / weight.mass - free_fall
    size = np.linalg.norm(asked[gridded.grid.free], axis=1)
    return np.asarray(size[np.isfinite(size)])


def what_touches(gridded: GriddedRecording, weight: Weight, gravity: float) -> str:
    """Say that something touches the tool in what counts as free motion; empty: nothing does."""
    asked = accelerations_asked(gridded, weight, gravity)
    half = float(np.median(asked)) if len(asked) else 0.0
    if half < ASKED:
        return ''
    return (f'in half of the motion the force is {weight.mass * half:.2g} N or more off the '
            f'weight of {weight.mass:.3g} kg, which would have to move by {half:.2g} m/s^2: '
            'something touches the tool')
