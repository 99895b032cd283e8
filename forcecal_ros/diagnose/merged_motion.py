"""The measured motion without its noise: the simulated one, and what is clear of the difference.

A robot moves much as its simulation does. Where only noise is left of the difference of the two
poses, the simulated one is the better measurement: a tool's acceleration out of noisy poses would
be in the residual and in what is fitted to it alike, and favour whatever is smooth.
"""

from dataclasses import replace

from forcecal_ros.geometry import Array, rotation_vector
from forcecal_ros.recording.streams import PoseStream
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt, welch
from scipy.spatial.transform import Rotation, RotationSpline

RATE = 250.0
"""Of the merged poses [Hz]."""

BANDS = (1.0, 12.5)
"""Where the difference is cut, at least and at most [Hz]: above, no tool moves as a rigid body."""

WINDOW = 4.0
"""Over which spectra are averaged [s]."""

CLEAR = 10.0
"""Times the floor that the power of a difference has where it is no noise."""

ORDER = 4


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
    t = start + np.arange(int((end - start) * RATE)) / RATE
    q, S = _at(simulated, t)
    p, R = _at(measured, t)
    turned = rotation_vector(np.swapaxes(S, 1, 2) @ R)
    position = q + _clear(p - q) if measured.has_position and simulated.has_position else p
    return replace(measured, t=t, position=position,
                   R_base_sensor=S @ Rotation.from_rotvec(_clear(turned)).as_matrix())


def _at(stream: PoseStream, t: Array) -> tuple[Array, Array]:
    R = RotationSpline(stream.t, Rotation.from_matrix(np.array(stream.R_base_sensor)))
    position = (CubicSpline(stream.t, stream.position)(t) if stream.has_position
                else np.full((len(t), 3), np.nan))
    return np.asarray(position), np.asarray(R(t).as_matrix())


def _clear(difference: Array) -> Array:
    """Leave out of a difference, shape (n, 3), what is no more than noise."""
    band = _band(difference)
    return np.asarray(sosfiltfilt(butter(ORDER, band, fs=RATE, output='sos'), difference, axis=0))


def _band(difference: Array) -> float:
    """Return up to where a difference rises from the noise [Hz]."""
    n = min(len(difference), int(WINDOW * RATE))
    frequency, power = welch(difference, RATE, nperseg=n, axis=0)
    power = power.sum(axis=1)
    floor = float(np.median(power[frequency > 2.0 * BANDS[1]]))
    clear = frequency[(power > CLEAR * floor) & (frequency > 0.0)]
    return float(np.clip(clear.max(initial=0.0), *BANDS))
