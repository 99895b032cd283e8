"""How noisy the wrench is now, beside what it was when its noise was measured.

The innovations of filter ``kalman`` tell it, once what a contact puts into them is taken off: a
contact moves on for longer than 4 ms, noise and vibrations do not, so that only the difference of
an innovation from its own mean over 4 ms counts. The level v is that of the variance; each
reading moves it by z = d^2 / (v E d^2), which is 1 on average where v is right:

    v <- v exp((min(z, 5) - 1) dt / 0.5 s)

A blow lasts for a few readings, each of which counts as 5 at most: no contact of its own looks
like noise. The filter of a random walk has a corner that goes as v^-1/2; its gain at zero
frequency stays one, so that a contact force is told later, not smaller.
"""

from math import exp, sqrt
from typing import NamedTuple

from forcecal_ros.observe.tracking import Vector, ZERO

SMOOTHING = 0.004
"""A third of the rise of a contact by the nominal rig's noise, and more than half a period of
vibrations above 100 Hz [s]."""

LONGEST = 2 * SMOOTHING
"""From one reading to the next, up to which a contact's own motion is told from noise by that
mean: slower readings tell nothing of their noise [s]."""

MEMORY = 0.5
"""Time constant: a level of ten is reached in half a second, and left in 1.2 s, both within two
[s]."""

MOST = 5.0
"""What a single reading counts for at most: chance exceeds it twice in a thousand on three axes
[1]."""

LEVELS = (0.25, 1e4)
"""Lowest and highest level that is believed [1]."""

NOTED = (2.0, 4.0)
"""From the first level on the noise is believed to be another one, from the second on wholly so:
noise levels drift by a factor of two on their own [1]."""


class NoiseLevel(NamedTuple):
    """
    What is remembered of the innovations.

    Attributes
    ----------
    level : float
        Variance of the noise over that in the calibration.
    mean : tuple of 3 float
        Of the force's innovation over the last 4 ms [N].
    """

    level: float
    mean: Vector


AS_CALIBRATED = NoiseLevel(1.0, ZERO)


def updated(before: NoiseLevel, dt: float, e: Vector, scale: Vector) -> NoiseLevel:
    """
    Take in an innovation.

    Parameters
    ----------
    dt : float
        Since the last one [s].
    e : tuple of 3 float
        Of the force [N].
    scale : tuple of 3 float
        By :func:`scale_of`.
    """
    (mx, my, mz), (ex, ey, ez), (sx, sy, sz) = before.mean, e, scale
    dx, dy, dz = ex - mx, ey - my, ez - mz
    z = (sx * dx * dx + sy * dy * dy + sz * dz * dz) / before.level
    level = before.level * exp((min(z, MOST) - 1) * min(dt / MEMORY, 1.0))
    k = 1 - exp(-dt / SMOOTHING)
    return NoiseLevel(min(max(level, LEVELS[0]), LEVELS[1]),
                      (mx + k * dx, my + k * dy, mz + k * dz))


def scale_of(variance: tuple[float, ...], dt: float) -> Vector:
    """Return what makes z of squares, for white innovations of these variances (3,) [N^2]."""
    k = 1 - exp(-dt / SMOOTHING)
    x, y, z = (1 / (3 * one * (1 + k / (2 - k))) for one in variance)
    return x, y, z


def believed(level: float) -> float:
    """Return the level that the gain follows: 1 until it is plainly another."""
    low, high = NOTED
    if level <= low:
        return 1.0
    return level if level >= high else 1.0 + (level - low) / (high - low) * (high - 1.0)


def rate_at(level: float, rate: float, slowest: float) -> float:
    """Return the corner of the contact wrench at a level, no slower than ``slowest`` [rad/s]."""
    return max(rate / sqrt(believed(level)), min(rate, slowest))
