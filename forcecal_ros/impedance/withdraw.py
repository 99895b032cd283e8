"""Coming to rest from any motion: a quintic that ends at rest at a given place."""

from dataclasses import dataclass
from typing import NamedTuple

STEPS = 8
"""Number of end points that are tried for a stop, from the farthest back to the gentlest."""


class LineMotion(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s^2] along one line."""

    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


@dataclass(frozen=True)
class Withdrawal:
    """
    From a motion to rest.

    Attributes
    ----------
    goal : float
        [m]
    duration : float
        [s]
    """

    start: LineMotion
    goal: float
    duration: float

    def at(self, t: float) -> LineMotion:
        """
        Return the motion at one time.

        Parameters
        ----------
        t : float
            Since the start [s]; held beyond the ends.
        """
        T = self.duration
        x = min(max(t / T, 0.0), 1.0)
        p, v, a = self.start.position, self.start.velocity * T, self.start.acceleration * T * T
        way = self.goal - p
        c3 = 10.0 * way - 6.0 * v - 1.5 * a
        c4 = -15.0 * way + 8.0 * v + 1.5 * a
        c5 = 6.0 * way - 3.0 * v - 0.5 * a
        if x == 1.0:
            return LineMotion(self.goal)
        return LineMotion(
            p + x * (v + x * (0.5 * a + x * (c3 + x * (c4 + x * c5)))),
            (v + x * (a + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / T,
            (a + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (T * T))


def to_rest(motion: LineMotion, duration: float, retract: float, acceleration: float
            ) -> Withdrawal:
    """
    Return the stop of a motion.

    Parameters
    ----------
    duration : float
        [s]
    retract : float
        How far back from here it ends, less where that takes too much acceleration [m]; 0:
        wherever the gentlest stop ends.
    acceleration : float
        Limit of it [m/s^2].
    """
    gentlest = motion.position + 0.5 * motion.velocity * duration
    if not retract > 0.0:
        return Withdrawal(motion, gentlest, duration)
    for share in range(STEPS, 0, -1):
        back = share / STEPS
        goal = min(motion.position - retract, gentlest)
        chosen = Withdrawal(motion, gentlest + back * (goal - gentlest), duration)
        if _peak_acceleration(chosen) <= acceleration:
            return chosen
    return Withdrawal(motion, gentlest, duration)


def _peak_acceleration(withdrawal: Withdrawal) -> float:
    return max(abs(withdrawal.at(withdrawal.duration * k / 16).acceleration) for k in range(17))
