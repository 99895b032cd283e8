"""The measured motion without its noise: the simulated one, and what is clear of the difference.

A robot moves much as its simulation does. Where only noise is left of the difference of the two
poses, the simulated one is the better measurement: a tool's acceleration out of noisy poses would
be in the residual and in what is fitted to it alike, and favour whatever is smooth.
"""

from dataclasses import replace

from forcecal_ros.diagnose.carried_tool import slow
from forcecal_ros.diagnose.clear_band import clear_band
from forcecal_ros.geometry import Array, rotation_vector
from forcecal_ros.recording.streams import PoseStream
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline


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
