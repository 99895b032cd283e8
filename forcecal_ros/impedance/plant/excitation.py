"""Commands that excite the plant: wide slow moves for accuracy, a small random code on top."""

from forcecal_ros.geometry import Array
from forcecal_ros.motion.profiles import quintic
import numpy as np


def excitation_commands(seconds: float, period: float, *, seed: int = 0, reach: float = 0.02,
                        move: float = 0.4, code: float = 0.0005, chip: int = 2) -> Array:
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
    reach, move : float
        Minimum-jerk moves within plus and minus that [m], and their duration [s].
    code : float
        Amplitude of the pseudo-random binary code on top [m].
    chip : int
        Periods that the code stays the same at least: it excites up to 0.44 / (chip period) Hz.

    Returns
    -------
    ndarray, shape (n,)
        [m]
    """
    n, rng = round(seconds / period), np.random.default_rng(seed)
    t = np.arange(n) * period
    goals = np.append(0.0, rng.uniform(-reach, reach, int(seconds / move) + 1))
    stage = (t / move).astype(int)
    way, _, _ = quintic(t / move - stage)
    slow = goals[stage] + (goals[stage + 1] - goals[stage]) * way
    chips = rng.choice((-code, code), n // chip + 1)
    fast = np.repeat(chips, chip)[:n]
    fast[:chip] = 0.0
    return np.asarray(slow + fast)
