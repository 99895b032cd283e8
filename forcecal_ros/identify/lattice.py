"""A recording in blocks: the wrench, its noise at rest, and how the sensor moves."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.identify.blocks import Averager, block_length, Grid, make_grid
from forcecal_ros.identify.kinematics import ABRUPT, acceleration_doubt, Motions, Turning
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.identify.settings import Settings
from forcecal_ros.recording.noise.autocovariance import Autocovariance, noise_of_windows, SHORTEST
from forcecal_ros.recording.streams import Recording
import numpy as np


class Lattice(NamedTuple):
    """
    What the fits to motion work on.

    Attributes
    ----------
    grid : Grid
    wrench : ndarray, shape (n, 6)
        Block means on the wire; NaN where missing [N, N m].
    noise : Autocovariance
        Of these at rest.
    motions : Motions
    doubt : ndarray, shape (n,)
        How far angular accelerations may be off [rad/s^2].
    """

    grid: Grid
    wrench: Array
    noise: Autocovariance
    motions: Motions
    doubt: Array


class Moved(NamedTuple):
    """
    A recording in blocks with what was found of its motion.

    Attributes
    ----------
    lattice : Lattice
    slide : ndarray, shape (n,)
        Of the tool along x of ft_sensor [m].
    turning : Turning
    """

    lattice: Lattice
    slide: Array
    turning: Turning


def lay_lattice(recording: Recording, poses: list[StaticPose], settings: Settings
                ) -> Lattice | None:
    """
    Lay blocks over a recording.

    Parameters
    ----------
    recording : Recording
        With wrench and pose.
    poses : list of StaticPose
    settings : Settings

    Returns
    -------
    Lattice or None
        None where the poses are too short to show any noise.
    """
    wrench, pose = recording.wrench, recording.pose
    assert wrench is not None and pose is not None
    if len(wrench) < 20 or len(pose) < 10:
        return None
    streams = [s for s in (wrench, recording.accelerometer, recording.optidrive, pose)
               if s is not None and len(s) > 1]
    length = block_length(settings.block, *(float(np.median(np.diff(s.t))) for s in streams))
    grid = make_grid(wrench.t, length, [(p.start, p.end) for p in poses], recording.phases)
    if not any((grid.still == i).sum() > SHORTEST for i in range(len(poses))):
        return None
    averager, motions = Averager(wrench.t, wrench.values), Motions(pose, grid)
    doubt = acceleration_doubt(motions.turning().omega, grid.length, grid.still >= 0)
    grid = grid._replace(free=grid.free & (doubt < 2 * ABRUPT))
    return Lattice(grid, averager.means(grid.starts, grid.length),
                   noise_of_windows(windows_of(averager, grid)), motions, doubt)


def windows_of(averager: Averager, grid: Grid) -> list[Array]:
    """Block means of each static pose."""
    return [averager.means(grid.starts[grid.still == i], grid.length)
            for i in range(grid.still.max() + 1) if (grid.still == i).any()]
