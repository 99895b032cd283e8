"""Commands that excite the plant: wide slow moves for accuracy, a small random code on top."""

from forcecal_ros.geometry import Array
from forcecal_ros.motion.profiles import quintic
import numpy as np

REACH, MOVE = 0.02, 0.4
"""Minimum-jerk moves within plus and minus that [m], and their duration [s]."""

CODE, CHIP = 0.0005, 2
"""Amplitude of the pseudo-random binary code on top [m], and the periods that it stays the same
at least: it excites up to 0.44 / (CHIP period) Hz."""


def excitation_commands(seconds: float, period: float, *, seed: int = 0) -> Array:
    """
    Return commands along x of ft_sensor, from rest at 0.

    Parameters
    ----------
    seconds : float
        Length.
    period : float
        From one command to the next [s].
    seed : int
        Of the random code and the random goals.

    Returns
    -------
    ndarray, shape (n,)
        [m]
    """
    n, rng = round(seconds / period), np.random.default_rng(seed)
    t = np.arange(n) * period
    goals = np.append(0.0, rng.uniform(-REACH, REACH, int(seconds / MOVE) + 1))
    stage = (t / MOVE).astype(int)
    way, _, _ = quintic(t / MOVE - stage)
    slow = goals[stage] + (goals[stage + 1] - goals[stage]) * way
    chips = rng.choice((-CODE, CODE), n // CHIP + 1)
    fast = np.repeat(chips, CHIP)[:n]
    fast[:CHIP] = 0.0
    return np.asarray(slow + fast)
