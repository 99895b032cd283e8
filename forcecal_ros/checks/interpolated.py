"""Poses that were interpolated along straight lines from a slow source."""

from forcecal_ros.checks import limits
from forcecal_ros.core.geometry import rotation_vector
from forcecal_ros.core.streams import PoseStream
import numpy as np
from numpy.typing import NDArray

STRAIGHT = 1e-6
"""Share of its way by which a position between its neighbours is off their line, at most, where it
was computed from them: encoders and accelerations make a thousandth and more of it."""

MOSTLY = 0.75
"""Share of a motion that is straight lines, at least: of what robots report none is."""

FEWEST = 20
"""Corners, and turns at them, of fewer nothing is said."""

EVEN = 0.2
"""Corners come at one rate where most are one median apart, to this share of it."""

ASTRAY = 0.01
"""Orientations that are off by less between the corners are worth no word [rad]: a tenth of a
newton for 1 kg."""


def interpolated(pose: PoseStream) -> str:
    """Say in a note that poses lie on straight lines between few; empty: they do not."""
    if not pose.has_position or len(pose) < 2 * FEWEST:
        return ''
    moved = np.flatnonzero(np.diff(pose.position, axis=0).any(axis=1))
    if len(moved) < 2 * FEWEST:
        return ''
    corners, straight = _corners(pose)
    if len(corners) < FEWEST or straight < MOSTLY:
        return ''
    apart = np.diff(pose.t[corners])
    period = float(np.median(apart))
    if np.mean(np.abs(apart / period - 1.0) < EVEN) < 0.5:
        return ''
    astray = _astray(pose, corners)
    if astray < ASTRAY:
        return ''
    return (f'pose: between {1.0 / period:.3g} poses a second it moves along straight lines, so '
            f'that orientations were interpolated, and some {astray:.2g} rad off in between: '
            'weight and inertia are taken off wrongly while the robot moves; record every pose')


def _corners(pose: PoseStream) -> tuple[NDArray[np.intp], float]:
    """Return rows at which straight lines meet, and the share of a motion that is straight."""
    t, place = pose.t, pose.position
    share = ((t[1:-1] - t[:-2]) / np.maximum(t[2:] - t[:-2], limits.TINY))[:, None]
    way = np.linalg.norm(place[2:] - place[:-2], axis=1)
    off = np.linalg.norm(place[1:-1] - place[:-2] - share * (place[2:] - place[:-2]), axis=1)
    moving = way > 0.0
    bent = moving & (off > STRAIGHT * way)
    alone = bent & ~np.roll(bent, 1) & ~np.roll(bent, -1)
    return np.flatnonzero(alone) + 1, 1.0 - float(bent.sum()) / max(1.0, float(moving.sum()))


def _astray(pose: PoseStream, corners: NDArray[np.intp]) -> float:
    """How far orientations are off in between, by how the turning changes at corners [rad]."""
    R, t = pose.R_base_sensor[corners], pose.t[corners]
    turned = rotation_vector(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    # a chord of two intervals' change of speed: h^2 a / 8
    changes = np.linalg.norm(np.diff(turned, axis=0), axis=1) / 8.0
    even = np.abs(np.diff(t) / np.median(np.diff(t)) - 1.0) < EVEN
    both = even[1:] & even[:-1]
    return float(np.quantile(changes[both], 0.9)) if both.any() else 0.0
