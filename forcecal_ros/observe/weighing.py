"""
How much of what an accelerometer shows beyond gravity is motion, axis by axis.

Where an axis hardly moves, an accelerometer adds more error than it explains. How much the force
confirmed of it in free motion is its share, and how large it was then its level. As long as it
is not larger, only that share of it counts; the more it exceeds the level, the more of it is
motion, up to all of it.
"""

from math import exp, inf
from typing import NamedTuple

from forcecal_ros.observe.tracking import Vector, ZERO

SLOWEST = 1.0
"""Time constant over which its mean is left alone: free motion of some seconds tells no share of
an offset [s]."""

JUDGED = 31.0
"""Corner below which share and level are judged, twice of first order [rad/s]: 5 Hz, where the
inertia of a robot's own motion is and a contact's approach is not yet."""

WEIGHED = 120.0
"""Corner below which it is weighed [rad/s]: 19 Hz. Vibrations above it are real on an arm, and
pass."""

MEMORY = 0.3
"""Of its power [s]: some reversals of a motion of 5 Hz."""

BEYOND = 4.0
"""Times the level's power from which on it is taken for motion. The error's own power wanders: on
an arm that hardly moved along y, 1 took 25 % of it for motion, 2 9 %, 4 2 %."""


class Weighing(NamedTuple):
    """
    What is remembered of it, in ft_sensor.

    Attributes
    ----------
    t : float
        [s]
    mean, slow, first, second : tuple of 3 float
        Over ``SLOWEST``, below ``WEIGHED``, and below ``JUDGED`` once and twice, without the mean
        [m/s^2].
    power : tuple of 3 float
        [(m/s^2)^2]
    """

    t: float = -inf
    mean: Vector = ZERO
    slow: Vector = ZERO
    first: Vector = ZERO
    second: Vector = ZERO
    power: Vector = ZERO


def weigh(before: Weighing, t: float, beyond: Vector, share: Vector, level: Vector,
          pause: float) -> tuple[Weighing, Vector]:
    """
    Take in one reading.

    Parameters
    ----------
    t : float
        Stamp [s].
    beyond : tuple of 3 float
        What the accelerometer shows beyond gravity, in ft_sensor [m/s^2].
    share : tuple of 3 float
        Of it that the force confirmed in free motion, 0 to 1.
    level : tuple of 3 float
        Its RMS below ``JUDGED`` then [m/s^2].
    pause : float
        After a longer one it starts anew [s].

    Returns
    -------
    Weighing
    left_out : tuple of 3 float
        What does not count [m/s^2].
    """
    dt = t - before.t
    if not 0.0 < dt <= pause:
        return Weighing(t, beyond, ZERO, ZERO, ZERO, ZERO), ZERO
    gains = (1 - exp(-dt / SLOWEST), 1 - exp(-dt * WEIGHED), 1 - exp(-dt * JUDGED),
             1 - exp(-dt / MEMORY))
    x = _axis(before, 0, beyond, gains)
    y = _axis(before, 1, beyond, gains)
    z = _axis(before, 2, beyond, gains)
    after = Weighing(t, (x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]),
                     (x[3], y[3], z[3]), (x[4], y[4], z[4]))
    return after, (_left_out(x, share[0], level[0]), _left_out(y, share[1], level[1]),
                   _left_out(z, share[2], level[2]))


Axis = tuple[float, float, float, float, float]
"""(mean, slow, first, second, power) of one axis."""


def _axis(before: Weighing, i: int, beyond: Vector, gains: tuple[float, float, float, float]
          ) -> Axis:
    slowest, weighed, judged, memory = gains
    mean = before.mean[i] + slowest * (beyond[i] - before.mean[i])
    moved = beyond[i] - mean
    slow = before.slow[i] + weighed * (moved - before.slow[i])
    first = before.first[i] + judged * (moved - before.first[i])
    second = before.second[i] + judged * (first - before.second[i])
    power = before.power[i] + memory * (second * second - before.power[i])
    return mean, slow, first, second, power


def _left_out(axis: Axis, share: float, level: float) -> float:
    _, slow, _, second, power = axis
    expected = BEYOND * level * level
    size = max(power, second * second)
    if size > expected:
        share = 1 - (1 - share) * expected / size
    return (1 - share) * slow
