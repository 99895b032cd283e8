"""A recording in blocks: the wrench, its noise at standstill, and how the sensor moves."""

from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.identify.settings import IdentificationSettings
from forcecal_ros.recording.kinematics import (
    ABRUPT,
    acceleration_error,
    AngularMotion,
    PoseKinematics,
)
from forcecal_ros.recording.noise.autocovariance import Autocovariance, noise_of_windows, SHORTEST
from forcecal_ros.recording.streams import Recording
from forcecal_ros.recording.time_grid import Averager, block_length, make_time_grid, TimeGrid
import numpy as np
from numpy.typing import NDArray


class GriddedRecording(NamedTuple):
    """
    What the fits to motion work on.

    Attributes
    ----------
    wrench : ndarray, shape (n, 6)
        Block means on the wire; NaN where missing [N, N m].
    noise : Autocovariance
        Of these at standstill.
    alpha_error : ndarray, shape (n,)
        How far angular accelerations may be off [rad/s^2].
    untouched : ndarray of bool, shape (n,)
        Whether nothing touched the tool; of these the grid counts as free what was not abrupt.
    """

    grid: TimeGrid
    wrench: Array
    noise: Autocovariance
    kinematics: PoseKinematics
    alpha_error: Array
    untouched: NDArray[np.bool_]


class ToolMotion(NamedTuple):
    """
    How tool and sensor moved in each block.

    Attributes
    ----------
    slide : ndarray, shape (n,)
        Displacement of the tool along x of ft_sensor [m].
    """

    gridded: GriddedRecording
    slide: Array
    angular: AngularMotion


def grid_recording(recording: Recording, poses: list[StaticPose], settings: IdentificationSettings
                   ) -> GriddedRecording | None:
    """Average a recording over blocks; None where its poses are too short to show any noise."""
    wrench, pose = recording.wrench, recording.pose
    assert wrench is not None and pose is not None
    if len(wrench) < 20 or len(pose) < 10:
        return None
    streams = [s for s in (wrench, recording.accelerometer, recording.optidrive, pose)
               if s is not None and len(s) > 1]
    length = block_length(settings.block, *(float(np.median(np.diff(s.t))) for s in streams))
    grid = make_time_grid(wrench.t, length, [(p.start, p.end) for p in poses], recording.phases)
    if not any((grid.still == i).sum() > SHORTEST for i in range(len(poses))):
        return None
    averager, kinematics = Averager(wrench.t, wrench.values), PoseKinematics(pose, grid)
    error = acceleration_error(kinematics.angular().omega, grid.length, grid.still >= 0)
    untouched = grid.free
    grid = grid._replace(free=untouched & (error < 2 * ABRUPT))
    return GriddedRecording(
        grid, averager.means(grid.starts, grid.length),
        noise_of_windows(windows_of(averager, grid)), kinematics, error, untouched)


def windows_of(averager: Averager, grid: TimeGrid) -> list[Array]:
    """Block means of each static pose."""
    return [averager.means(grid.starts[grid.still == i], grid.length)
            for i in range(grid.still.max() + 1) if (grid.still == i).any()]
