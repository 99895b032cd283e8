"""
Poses of a robot and of its simulation: in one base, at the same instants, merged.

A robot moves much as its simulation does. Where only noise is left of the difference of the two
poses, the simulated one is the better measurement: a tool's acceleration out of noisy poses would
be in the residual and in what is fitted to it, and favour whatever is smooth.
"""

from dataclasses import replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.low_pass import clear_band, slow
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

APART = 0.1
"""Angle beyond which frames are others [rad]: no arm is always that far from its simulation."""

UPRIGHT = 0.05
"""How far the axis of a turn of the base may lean for gravity to stay where it is [rad]."""

SAMPLES = 500
"""Instants at which two motions are compared."""


def merged(measured: PoseStream, simulated: PoseStream) -> PoseStream:
    """
    Return the motion of the robot, as well as both recordings tell it.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock; of one base, or each of its own.

    Returns
    -------
    PoseStream
        While both are there.
    """
    start = max(measured.t[0], simulated.t[0])
    end = min(measured.t[-1], simulated.t[-1])
    # at the measured pose's own rate: more instants would not have its noise
    rate = (len(measured) - 1) / (measured.t[-1] - measured.t[0])
    t = start + np.arange(int((end - start) * rate)) / rate
    q, S = pose_at(simulated, t)
    p, R = pose_at(measured, t)
    turned = rotation_vector(np.swapaxes(S, 1, 2) @ R)
    position = q + _clear(p - q, rate) if measured.has_position and simulated.has_position else p
    return replace(measured, t=t, position=position,
                   R_base_sensor=S @ Rotation.from_rotvec(_clear(turned, rate)).as_matrix())


def pose_at(stream: PoseStream, t: Array) -> tuple[Array, Array]:
    """Return position, NaN where there is none, and orientation at other times."""
    R = RotationSpline(stream.t, Rotation.from_matrix(np.array(stream.R_base_sensor)))
    position = (CubicSpline(stream.t, stream.position)(t) if stream.has_position
                else np.full((len(t), 3), np.nan))
    return np.asarray(position), np.asarray(R(t).as_matrix())


def _clear(difference: Array, rate: float) -> Array:
    """Leave out of a difference, shape (n, 3), what is no more than noise."""
    return slow(difference, rate, clear_band(difference, rate))


def in_base_of(measured: PoseStream, simulated: PoseStream) -> PoseStream:
    """
    Bring simulated poses into the robot's base, which may be turned about the vertical.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock.

    Raises
    ------
    DataError
        The sensor's frames are turned to each other, or a base is not upright.
    """
    start, end = (f(measured.t[i], simulated.t[i]) for f, i in ((max, 0), (min, -1)))
    t = np.linspace(start, end, SAMPLES)
    R, S = (Slerp(p.t, Rotation.from_matrix(np.array(p.R_base_sensor)))(t)
            for p in (measured, simulated))
    sensor, in_sensor = _constant(S.inv() * R)
    base, in_base = _constant(R * S.inv())
    if min(sensor.magnitude(), base.magnitude()) < APART:
        return simulated
    if in_sensor < in_base:
        raise DataError('the poses are of frames that are turned by '
                        f'{np.degrees(sensor.magnitude()):.0f} deg to each other in the robot and '
                        'in the simulator; record the pose of the frame of the wrench in both')
    axis = base.as_rotvec() / base.magnitude()
    if np.hypot(axis[0], axis[1]) > UPRIGHT:
        raise DataError(f'the bases are turned by {np.degrees(base.magnitude()):.0f} deg to each '
                        'other, and not about the vertical; gravity is along -Z of both')
    turn = base.as_matrix()
    return replace(simulated, position=simulated.position @ turn.T,
                   R_base_sensor=turn @ simulated.R_base_sensor)


def _constant(turns: Rotation) -> tuple[Rotation, float]:
    """Return the mean of rotations, and how far they are from it, RMS [rad]."""
    mean = turns.mean()
    apart: Array = (turns * mean.inv()).magnitude()
    return mean, float(np.sqrt(np.mean(apart ** 2)))
