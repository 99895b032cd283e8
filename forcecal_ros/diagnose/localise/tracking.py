"""How the robot's motion differs from its simulation's, where both were recorded."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_vector
from forcecal_ros.core.streams import PoseStream
from forcecal_ros.sim.poses import pose_at
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from scipy.ndimage import gaussian_filter1d

WIDTH = 0.02
"""Standard deviation of the window that poses are averaged over [s]."""

SEGMENTS = 12
"""Segments of a recording, whose scatter tells the standard error of the delay."""

SLOWEST = (1e-3, 5e-3)
"""
Speeds below which a segment tells nothing of a delay, RMS [m/s], [rad/s]: in 10 ms as far as the
noise of a pose.
"""


class Difference(NamedTuple):
    """
    By how much the robot's translation or rotation differs from its simulation's.

    Attributes
    ----------
    rms : float
        Of the difference [m] or [rad].
    delay, delay_std : float
        By how much the robot is later [s]; NaN where the two motions were laid on each other for
        want of commands, or do not tell it.
    unexplained : float
        RMS without that delay, and without a fixed offset [m] or [rad].
    """

    rms: float
    delay: float
    delay_std: float
    unexplained: float

    def document(self) -> dict[str, float | None]:
        """Return what ``diagnosis.json`` says of it; what is not known is null."""
        numbers = {'rms': self.rms, 'delay': self.delay, 'delay_std': self.delay_std,
                   'left': self.unexplained}
        return {k: v if np.isfinite(v) else None for k, v in numbers.items()}


class Tracking(NamedTuple):
    """The difference of two motions."""

    translation: Difference
    rotation: Difference


def tracking(measured: PoseStream, simulated: PoseStream, own_delay: bool) -> Tracking:
    """
    Compare the measured motion with the simulated.

    Parameters
    ----------
    measured, simulated : PoseStream
        On one clock.
    own_delay : bool
        Whether that clock is the commands'.
    """
    start = max(measured.t[0], simulated.t[0])
    end = min(measured.t[-1], simulated.t[-1])
    t = start + BLOCK * np.arange(1, int((end - start) / BLOCK) - 1)
    p, R = _at(measured, t)
    q, S = _at(simulated, t)
    omega = rotation_vector(np.swapaxes(S[:-1], 1, 2) @ S[1:]) / BLOCK
    return Tracking(
        _difference(p - q, np.gradient(q, BLOCK, axis=0), SLOWEST[0], own_delay),
        _difference(rotation_vector(np.swapaxes(S, 1, 2) @ R), np.vstack([omega[:1], omega]),
                    SLOWEST[1], own_delay))


def _difference(apart: Array, speed: Array, slowest: float, own_delay: bool) -> Difference:
    delay, std = _delay(apart, speed, slowest) if own_delay else (np.nan, np.nan)
    unexplained = apart + delay * speed if np.isfinite(delay) else apart
    return Difference(_rms(apart), delay, std, _rms(unexplained - unexplained.mean(axis=0)))


def _at(stream: PoseStream, t: Array) -> tuple[Array, Array]:
    smooth = WIDTH * (len(stream) - 1) / (stream.t[-1] - stream.t[0])
    return pose_at(replace(stream, position=gaussian_filter1d(
        stream.position, smooth, axis=0)), t)


def _delay(apart: Array, speed: Array, slowest: float) -> tuple[float, float]:
    """Regress a difference on the speed in pieces, each about its own mean."""
    found, weight = [], []
    for d, v in zip(np.array_split(apart, SEGMENTS), np.array_split(speed, SEGMENTS)):
        d, v = d - d.mean(axis=0), v - v.mean(axis=0)
        power = float((v ** 2).sum())
        if power > slowest ** 2 * len(v):
            found.append(-float((d * v).sum()) / power)
            weight.append(power)
    if len(found) < 3:
        return float('nan'), float('nan')
    w, x = np.array(weight) / sum(weight), np.array(found)
    mean = float(w @ x)
    return mean, float(np.sqrt(w ** 2 @ (x - mean) ** 2 * len(x) / (len(x) - 1)))


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean((rows ** 2).sum(axis=1))))
