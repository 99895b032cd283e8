"""What of the tool's ringing is left in the static poses, and what it does to their means.

A sensor's noise hides ringing that still bends the means of a pose by a share of their standard
error, always the same way, for the motion before is the same in every run. Once the tool's
stiffness and damping are known only size and phase of what is left are unknown, and with them
the tool's mean acceleration, d(ds/dt) / T over a pose of duration T, is known far better than any
sensor shows it: that much, as specific force, the sensor reads beside gravity.

Nor is it noise. Taken for it, a tool that rang for 0.3 s made the noise of force and slide look
correlated in time, and standard errors up to twice as large as the errors were.
"""

from math import sqrt
from typing import NamedTuple

from forcecal_ros.calibrate.means import GriddedRecording
from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.calibrate.ringing import RingFit
from forcecal_ros.calibrate.static_readings import Statics
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import noise_of_windows
from forcecal_ros.core.streams import Recording, Stream
import numpy as np

_PRECISE = 0.3
"""Share of the standard error of a pose's mean force that a correction is to be known to: it then
adds 5 % to it at most."""


class Mode(NamedTuple):
    """Decay and angular frequency of the free tool [1/s]."""

    decay: float
    omega: float


class Unsettled(NamedTuple):
    """
    What the tool still does in one pose, along x.

    Attributes
    ----------
    acceleration : float
        Its mean [m/s^2].
    std : float
        Standard error of that.
    slide : float
        Mean displacement from where it comes to rest [m].
    """

    acceleration: float
    std: float
    slide: float


def mode_of(ring: RingFit, mass: float) -> Mode | None:
    """Return how the tool rings; None where it creeps back without ringing."""
    decay = ring.damping / (2 * mass)
    square = ring.stiffness / mass - decay * decay
    return Mode(decay, sqrt(square)) if square > 0 else None


def _motion(mode: Mode, t: Array) -> Array:
    """Displacement and velocity of a unit cosine and a unit sine, shape (2, 2, n)."""
    decay, omega = mode
    e, c, s = np.exp(-decay * t), np.cos(omega * t), np.sin(omega * t)
    return np.array([[e * c, e * s], [e * (-decay * c - omega * s), e * (omega * c - decay * s)]])


def without_ringing(gridded: GriddedRecording, mode: Mode) -> GriddedRecording:
    """Measure the noise of the static poses anew, what rings in them taken off."""
    grid = gridded.grid
    windows = [grid.still == i for i in range(grid.still.max() + 1)]
    windows = [window for window in windows if window.any()]
    # the mean over a block is the value at its start times a constant of its own
    ringing = [_motion(mode, grid.starts[window] - grid.starts[window][0])[0].T
               for window in windows]
    return gridded._replace(
        ringing=ringing,
        noise=noise_of_windows([gridded.wrench[window] for window in windows], ringing))


def unsettled(t: Array, values: Array, duration: float, mode: Mode,
              force: tuple[float, float] | None) -> Unsettled:
    """
    Fit what is left of the ringing in one pose.

    Parameters
    ----------
    t, values : ndarray, shape (n,)
        Since the start of the pose [s]; displacement [m], or force along x [N].
    duration : float
        Of the pose [s].
    force : tuple of float or None
        Stiffness and damping where ``values`` are a force.
    """
    slide, speed = _motion(mode, t)
    shown = slide if force is None else force[0] * slide + force[1] * speed
    rows = np.column_stack([np.ones(len(t)), shown.T])
    inverse = np.linalg.pinv(rows.T @ rows)
    found = inverse @ (rows.T @ values)
    variance = float(((values - rows @ found) ** 2).sum()) / (len(t) - 3)
    edges = _motion(mode, np.array([0.0, duration]))
    along = (edges[1, :, 1] - edges[1, :, 0]) / duration
    # m s" + d ds/dt + k s = 0, so the mean displacement follows from the edges, too
    square = mode.decay ** 2 + mode.omega ** 2
    mean = -(along + 2 * mode.decay * (edges[0, :, 1] - edges[0, :, 0]) / duration) / square
    return Unsettled(float(along @ found[1:]),
                     sqrt(max(float(along @ inverse[1:, 1:] @ along) * variance, 0.0)),
                     float(mean @ found[1:]))


def settled(statics: Statics, recording: Recording, poses: list[StaticPose], mass: float,
            ring: RingFit) -> Statics:
    """
    Count what is left of the ringing in the static poses.

    Parameters
    ----------
    statics
        As read.
    mass : float
        [kg]
    ring : RingFit
        Stiffness and damping, from the step.

    Returns
    -------
    Statics
        With ``ringing``, zero in poses in which that is not known well.
    """
    mode = mode_of(ring, mass)
    if mode is None or statics.covariance is None:
        return statics
    ringing = np.zeros((len(poses), 2))
    for i, pose in enumerate(poses):
        found = _in_pose(recording, pose, mode, ring, statics.slide_variance[i] > 0)
        if found is not None and mass * found.std < _PRECISE * sqrt(statics.covariance[i, 0, 0]):
            ringing[i] = found.slide, found.acceleration
    return statics._replace(ringing=ringing)


def _in_pose(recording: Recording, pose: StaticPose, mode: Mode, ring: RingFit, observed: bool
             ) -> Unsettled | None:
    stream: Stream | None = recording.optidrive if observed else recording.wrench
    assert stream is not None
    late = ring.slide_delay if observed else 0.0
    cut = stream.between(pose.start + late, pose.end + late)
    if len(cut) < 30:
        return None
    return unsettled(cut.t - pose.start - late, cut.values[:, 0], pose.end - pose.start, mode,
                     None if observed else (ring.stiffness, ring.damping))
