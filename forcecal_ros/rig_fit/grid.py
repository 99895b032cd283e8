"""Commands and measured poses on the grid of the robot's periods."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, quaternion_from_matrix
from forcecal_ros.core.streams import phase_spans, Recording, TOUCHING
from forcecal_ros.diagnose.recordings import grid_shift
from forcecal_ros.sim.poses import pose_at
from forcecal_ros.sim.rig.offline import held_commands
import numpy as np
from numpy.typing import NDArray

SETTLING = 0.5
"""Start of a recording whose errors do not count, since the robot may have moved before [s]."""

SHORTEST = 10.0
"""Commands and poses that a robot is fitted to, at least [s]: some ten of its slowest motions."""

EVERY = 3
"""
Second that is not fitted, where no recording is given to judge on: programs move one axis after
the other, and each has to be in both parts.
"""


class Followed(NamedTuple):
    """
    One recording, a row a period: what was commanded in it, what was reached at its end.

    Attributes
    ----------
    start : float
        When period 0 begins [s].
    position, reached : ndarray, shape (m, 3)
    R_command, R_reached : ndarray, shape (m, 3, 3)
    used, held : ndarray of bool, shape (m,)
        To fit on, and to judge on.
    """

    start: float
    position: Array
    R_command: Array
    reached: Array
    R_reached: Array
    used: NDArray[np.bool_]
    held: NDArray[np.bool_]

    @property
    def xyzw(self) -> Array:
        """Commanded orientations."""
        return quaternion_from_matrix(self.R_command)


def followed(recording: Recording, period: float) -> Followed:
    """
    Bring a recording onto the grid of the commands.

    Raises
    ------
    DataError
        Commands and poses overlap for too short a time.
    """
    target, pose = recording.target, recording.pose
    assert target is not None
    assert pose is not None
    start = float(target.t[0]) + grid_shift(target.t, pose.t, period)
    end = min(float(target.t[-1]) + period, float(pose.t[-1]))
    m = int((end - start) / period)
    starts: Array = start + period * np.arange(float(max(0, m)))
    seen = starts + period >= pose.t[0]
    if seen.sum() * period < SHORTEST:
        raise DataError(f'{recording.source}: commands (target_frame) and poses (current_pose) '
                        f'overlap for {seen.sum() * period:.1f} s, expected {SHORTEST:g} s at '
                        'least; record a longer motion')
    held = held_commands(target.t, starts, period / 2.0)
    reached, R = pose_at(pose, np.clip(starts + period, pose.t[0], pose.t[-1]))
    free = seen & (starts > max(start, float(pose.t[0])) + SETTLING)
    for begin, end in phase_spans(recording.phases, TOUCHING):
        free &= (starts + period < begin) | (starts >= end)
    late = np.floor(starts - start).astype(int) % EVERY == EVERY - 1
    return Followed(start, target.position[held], target.R_base_sensor[held], reached, R,
                    free & ~late, free & late)


def fit_and_judge(recordings: Sequence[Recording], heldout: Recording | None, period: float
                  ) -> list[Followed]:
    """Bring recordings onto the grid; one to judge on alone leaves the others to fit on."""
    ready = [followed(one, period) for one in recordings]
    if heldout is None:
        return ready
    last = followed(heldout, period)
    return [*(one._replace(used=one.used | one.held, held=np.zeros_like(one.held))
              for one in ready),
            last._replace(used=np.zeros_like(last.used), held=last.used | last.held)]
