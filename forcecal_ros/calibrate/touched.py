"""Whether something touches the tool in a motion that is taken for free."""

from forcecal_ros.calibrate.means import GriddedRecording
from forcecal_ros.calibrate.tool import Weight
from forcecal_ros.core.geometry import Array
import numpy as np

ASKED = 5.0
"""Acceleration that forces ask of a tool in half of a motion, from which it is no motion of the
tool alone [m/s^2]: hands of arms do as much for moments. The calibration of the demo asks for 0.3,
an arm that holds what another one peels for 1.7, tools that a hand leads ask for 10 and 26."""


def acceleration_asked(gridded: GriddedRecording, weight: Weight, gravity: float) -> float:
    """
    Return what free motion would have to accelerate the tool by, beyond what its pose shows.

    Parameters
    ----------
    gravity : float
        Magnitude [m/s^2].

    Returns
    -------
    float
        Median over free motion of the force that the tool's weight leaves over, by its mass; less
        the same at rest, which is noise [m/s^2].
    """
    grid, R = gridded.grid, gridded.kinematics.angular().R_base_sensor
    shown = gridded.kinematics.acceleration()
    free_fall = -gravity * R[:, 2]
    if shown is not None:
        free_fall = free_fall - np.einsum('nij,ni->nj', R, shown)
    asked = (gridded.wrench[:, :3] - weight.force_bias) / weight.mass - free_fall
    size = np.linalg.norm(asked, axis=1)
    moved, rested = (_median(size[blocks]) for blocks in (grid.free, grid.still >= 0))
    return float(np.sqrt(max(0.0, moved**2 - rested**2)))


def _median(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else 0.0


def what_touches(gridded: GriddedRecording, weight: Weight, gravity: float) -> str:
    """Say that something touches the tool in what counts as free motion; empty: nothing does."""
    asked = acceleration_asked(gridded, weight, gravity)
    if asked < ASKED:
        return ''
    return (f'in half of the motion the force is {weight.mass * asked:.2g} N or more off the '
            f'weight of {weight.mass:.3g} kg, which would have to move by {asked:.2g} m/s^2: '
            'something touches the tool')
