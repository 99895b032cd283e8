"""When commands take effect, and what lies between commands that were recorded seldom."""

from dataclasses import replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream, Recording
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.rig.replay import Replay
from forcecal_ros.sim.signals import RATE
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

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


SPARSE = 1.5
"""Distance of commands, in periods of the rig, from which periods without one are the rule."""

FEWEST = 50
"""Measured poses from which they tell how the robot went on between two commands."""

NEARER = 0.5
"""
Misfit of the poses with commands interpolated, in that with commands held, from which they were
not held: of poses at 20 Hz 0.006 where 250 Hz were thinned to that, 200 where 20 Hz were held.
"""

FINEST = 1e-6
"""Noise of poses, at least [m], [rad]: an encoder of 22 bits, and no robot's pose is finer."""


def refuse_sparse_commands(recording: Recording, rig: Rig, accelerometer: str) -> None:
    """
    Refuse commands of which most are missing, as the measured poses show.

    A robot that was told something only now and then holds that, as the rig does. One that went
    smoothly from one recorded command to the next was told more than was recorded; what is known
    of its way is then good enough to tell that, but not for the forces along it.

    Parameters
    ----------
    recording : Recording
        With commands.

    Raises
    ------
    DataError
        With how far commands and periods are apart.
    """
    target, pose, period = recording.target, recording.pose, rig.robot.period
    if (target is None or not target.has_position or len(target) < FEWEST or pose is None
            or len(pose) < FEWEST or not pose.has_position):
        return
    apart = float(np.median(np.diff(target.t)))
    if apart < SPARSE * period:
        return
    held, led = (_misfit(replace(recording, target=one), rig, accelerometer)
                 for one in (target, _led(target, period)))
    if led < NEARER * held:
        raise DataError(
            f'commands were recorded every {1e3 * apart:.3g} ms, the rig takes one every '
            f'{1e3 * period:.3g} ms, and the measured poses show that the robot did not hold each '
            f'so long, but was told more in between: {held:.0f} times their noise away with '
            f'commands held, {led:.2g} with commands interpolated, and along a guessed way no '
            'force is known; give --calibration, to compare the wrench with the measured motion')


def _led(target: PoseStream, period: float) -> PoseStream:
    """Return commands in each period, on a smooth way through those there are."""
    t = np.arange(target.t[0], target.t[-1], period)
    turned = RotationSpline(target.t, Rotation.from_matrix(np.array(target.R_base_sensor)))
    return replace(target, t=t, position=CubicSpline(target.t, target.position)(t),
                   R_base_sensor=turned(t).as_matrix())


def _misfit(recording: Recording, rig: Rig, accelerometer: str) -> float:
    """RMS of measured less replayed poses, in their noise; NaN where there are too few."""
    target, pose, sensor = recording.target, recording.pose, rig.pose_sensor
    assert target is not None
    assert pose is not None
    start = start_of(recording, rig, accelerometer)
    replayed = Replay(rig, target, start, float(target.t[-1]), accelerometer).signals(rig)
    t = start + (1.0 + np.arange(len(replayed.position))) / RATE
    seen = pose.between(float(t[0]), float(t[-1]))
    if len(seen) < FEWEST:
        return np.nan
    nearest = np.clip(np.rint((seen.t - t[0]) * RATE).astype(np.intp), 0, len(t) - 1)
    turn = rotation_vector(np.swapaxes(replayed.R_base_sensor[nearest], 1, 2)
                           @ seen.R_base_sensor)
    shift = seen.position - replayed.position[nearest]
    return float(np.sqrt(0.5 * (
        np.mean((shift / max(sensor.position_noise, FINEST)) ** 2)
        + np.mean((turn / max(sensor.orientation_noise, FINEST)) ** 2))))
