"""When commands take effect: the instant at which the robot's period 0 began."""

from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.streams import PoseStream, Recording
from forcecal_ros.simulators.rig.replay import Replay
import numpy as np

ON_GRID = 2e-5
"""Commands stamped this close to the pose's grid hold from their stamp on [s]."""

GATHERED = 0.3
"""Mean of unit vectors, one a stamp, below which stamps keep no grid; even ones give 1, or 0."""

SETTLING = 20.0
"""Length of a recording, at most, that is replayed to choose among whole periods [s]."""


def start_of(recording: Recording, rig: Rig, accelerometer: str) -> float:
    """
    Find when the robot's period 0 began.

    Stamps of the measured pose lie on the grid of the robot's periods, or on a finer one where
    there are several in each. Commands on the same grid hold from their stamp on; others from one
    of the grid's next points, chosen by the pose.

    Parameters
    ----------
    recording : Recording
        With commands.

    Returns
    -------
    float
        [s]

    Raises
    ------
    DataError
        There are no commands.
    """
    target, pose, period = recording.target, recording.pose, rig.robot.period
    if target is None or not target.has_position:
        raise DataError('the recording holds no commands (target_frame); record them, the '
                        'simulator replays them')
    first = float(target.t[0])
    if pose is None or len(pose) < 50 or not pose.has_position:
        return first
    grid = min(period, float(np.median(np.diff(pose.t))))
    shift = shift_of(target.t, pose.t, period)
    if not shift:
        return first
    starts = [first + shift + k * grid for k in range(-1, 1 + round(period / grid))]
    return min(starts, key=lambda start: _pose_error(rig, target, pose, start, accelerometer))


def shift_of(commands: Array, poses: Array, period: float) -> float:
    """
    Return how long after a command's stamp the grid of the poses has a point [s].

    0 where both are on one grid, or where one has none.
    """
    grid = min(period, float(np.median(np.diff(poses))))
    if min(_concentration(commands, grid), _concentration(poses, grid)) < GATHERED:
        return 0.0
    shift = (_phase(poses, grid) - _phase(commands, grid)) % grid
    return 0.0 if min(shift, grid - shift) < ON_GRID else shift


def _concentration(t: Array, period: float) -> float:
    return float(np.abs(np.mean(np.exp(2j * np.pi * (t - t[0]) / period))))


def _phase(t: Array, period: float) -> float:
    angle = 2.0 * np.pi * (t - t[0]) / period
    mean = np.angle(np.mean(np.exp(1j * angle)))
    return float((t[0] + mean * period / (2.0 * np.pi)) % period)


def _pose_error(rig: Rig, target: PoseStream, pose: PoseStream, start: float,
                accelerometer: str) -> float:
    speed = np.linalg.norm(np.diff(target.position, axis=0), axis=1)
    moving = target.t[1:][speed > 0.1 * speed.max()] if speed.max() > 0.0 else target.t
    end = min(float(pose.t[-1]), float(moving[0]) + SETTLING)
    replayed = Replay(rig, target, start, end, accelerometer).signals(rig)
    times = start + (1.0 + np.arange(len(replayed.position))) * 1e-3
    part = pose.between(float(times[0]), float(times[-1]))
    return float(sum(np.sum((part.position[:, i] - np.interp(
        part.t, times, replayed.position[:, i])) ** 2) for i in range(3)))
