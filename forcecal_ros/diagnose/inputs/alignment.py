"""Two recordings of the same commands on one clock: what a simulator made, and the robot."""

from dataclasses import fields, replace
from typing import Any, NamedTuple

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.signal import correlate
from scipy.spatial.transform import Rotation, Slerp

WIDTH = 0.02
"""Standard deviation of the window that speeds are averaged over [s]."""

FEWEST = 20
"""Poses, at least, that make a motion."""

LEVER = 0.2
"""Lever at which turning counts as much as moving [m]: a tool's length."""

LEAST_CORRELATION = 0.98
"""
Correlation of the speeds of two recordings of one motion, at least: an arm in MuJoCo with half the
gains and no friction kept 0.9999 with its simulation, a motion of the same kind but half a radian
off in phase had 0.95 to 0.96, four random motions of that arm 0.54 to 0.62 with each other.
"""


class Alignment(NamedTuple):
    """
    How a simulated recording was brought to the clock of the robot's.

    Attributes
    ----------
    shift : float
        Added to the simulated stamps [s].
    by : str
        ``target`` where both hold the commands: what the robot is late is then its own. Else
        ``pose``: the motions lie on each other, and a common delay cannot show.
    correlation : float
        Of the speeds.
    """

    shift: float
    by: str
    correlation: float


def aligned(recording: Recording, simulated: Recording) -> tuple[Recording, Alignment]:
    """
    Bring a simulated recording to the clock of the robot's.

    Parameters
    ----------
    recording : Recording
        Of the robot.
    simulated : Recording
        Of the simulator, driven by the same commands.

    Returns
    -------
    Recording
        The simulated one, its times counted as the robot's are.
    Alignment

    Raises
    ------
    DataError
        Neither commands nor poses are in both, or they are not of the same motion.
    """
    for by, what in (('target', 'commands'), ('pose', 'motions')):
        speeds = [_speed(getattr(r, by)) for r in (recording, simulated)]
        if all(speed is not None and speed[1].any() for speed in speeds):
            break
    else:
        raise DataError('the two recordings cannot be aligned: neither commands nor poses that '
                        'move are in both; record target_frame in both')
    one, other = (speed for speed in speeds if speed is not None)
    shift, correlation = _match(one, other)
    if correlation < LEAST_CORRELATION:
        raise DataError(
            f'the {what} of the simulated recording are not those of the robot: their speeds '
            f'correlate by {correlation:.2f}, expected {LEAST_CORRELATION:g} or more; run the '
            'simulator with the recorded commands')
    return shifted(simulated, shift), Alignment(shift, by, correlation)


def shifted(recording: Recording, shift: float) -> Recording:
    """Count a recording's times from an earlier instant, by so many seconds."""
    changed: dict[str, Any] = {}
    for field in fields(recording):
        part = getattr(recording, field.name)
        if isinstance(part, Stream | PoseStream):
            changed[field.name] = replace(part, t=part.t + shift)
    phases = tuple(Phase(p.name, p.start + shift, p.end + shift) for p in recording.phases)
    return replace(recording, **changed, phases=phases)


def _speed(stream: PoseStream | None) -> tuple[float, Array] | None:
    """Return when a grid of blocks begins, and the speed in each: the same in any base."""
    if stream is None or len(stream) < FEWEST:
        return None
    n = max(2, int((stream.t[-1] - stream.t[0]) / BLOCK))
    t = stream.t[0] + BLOCK * np.arange(n)
    R = Slerp(stream.t, Rotation.from_matrix(np.array(stream.R_base_sensor)))(t).as_matrix()
    speed = LEVER * np.linalg.norm(rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:]), axis=1)
    if stream.has_position:
        p = np.stack([np.interp(t, stream.t, x) for x in stream.position.T], axis=1)
        speed = speed + np.linalg.norm(np.diff(p, axis=0), axis=1)
    return float(t[0]), np.asarray(gaussian_filter1d(speed, WIDTH / BLOCK) / BLOCK)


def _match(one: tuple[float, Array], other: tuple[float, Array]) -> tuple[float, float]:
    """Return by how much the other has to be shifted, and how well they then correlate."""
    (start, a), (its_start, b) = one, other
    product = correlate(a - a.mean(), b - b.mean(), method='fft')
    coarse = start - its_start + BLOCK * (int(np.argmax(product)) - (len(b) - 1))
    spline = CubicSpline(its_start + BLOCK * np.arange(len(b)), b)
    t = start + BLOCK * np.arange(len(a))

    def unlike(shift: float) -> float:
        at = t - shift
        both = (at >= its_start) & (at <= spline.x[-1])
        if both.sum() < 20 or not a[both].std():
            return 1.0
        there = spline(at[both])
        return 1.0 - float(np.corrcoef(a[both], there)[0, 1]) if there.std() else 1.0

    fine = minimize_scalar(unlike, bounds=(coarse - 2 * BLOCK, coarse + 2 * BLOCK),
                           method='bounded', options={'xatol': 1e-6})
    return float(fine.x), 1.0 - float(fine.fun)
