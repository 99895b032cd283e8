"""The samples of one topic as they arrive, over the time in which stillness is judged."""

from collections import deque
from itertools import islice, pairwise
from math import asin, inf, sqrt
from typing import TypeAlias

from forcecal_ros.core.geometry import Array
import numpy as np

Timed: TypeAlias = tuple[float, tuple[float, ...]]
"""A time [s] and the values at that time."""

KEPT = 2.0
"""Samples are kept for that long [s]: eight windows of stillness at the defaults, of which a start
needs two to learn the noise."""

SURELY_FROZEN = 5.0
"""Readings at rest that repeat for so many times as long as they use to are frozen: live, a false
alarm ends a motion, a miss is found in the recording."""

HABIT_EXCEPTIONS, HABIT_CHANGES = 2, 20
"""So many of the longest repetitions before a start are no habit: a sensor that had frozen; fewer
changes than the second show none."""


class Channel:
    """
    The last sample of one topic, and those of the last two seconds.

    Attributes
    ----------
    heard, changed : float
        When a sample arrived last, and when one that differs from the one before, on the
        caller's clock [s].
    rest_timeout : float
        Repeating the same reading for longer is no habit of the robot at rest [s].
    moving_since : float
        Since when the commanded motion should show in the readings, on the caller's clock [s].
    stamp : float
        Header stamp of the last sample [s].
    late_since : float
        Since when the newest stamp has been too old, on the caller's clock [s].
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.heard = -inf
        self.changed = -inf
        self.rest_timeout = inf
        self.moving_since = inf
        self.stamp = -inf
        self.late_since = inf
        self.values: tuple[float, ...] = ()
        self.recent: deque[Timed] = deque()

    def take(self, now: float, stamp: float, values: tuple[float, ...]) -> None:
        """Take in a sample that arrives at ``now`` of the caller's clock."""
        if values != self.values:
            self.changed = now
        self.heard, self.stamp, self.values = now, stamp, values

    def keep(self) -> None:
        """Keep the last sample to judge stillness and repeated readings by."""
        recent = self.recent
        recent.append((self.stamp, self.values))
        while recent and not 0.0 <= self.stamp - recent[0][0] <= KEPT:
            recent.popleft()

    def learn(self, shortest: float) -> None:
        """
        Learn from the samples kept, of a robot at rest, for how long readings usually repeat.

        Where they change too rarely to tell, what an earlier start has learnt holds. The longest
        repetitions are left out, so that a freeze which has healed does not excuse the next.

        Parameters
        ----------
        shortest : float
            Repetitions for that long are never too long [s].
        """
        changes = [self.recent[0][0]] if self.recent else []
        for (_, before), (stamp, values) in zip(self.recent, islice(self.recent, 1, None)):
            if values != before:
                changes.append(stamp)
        same = sorted(end - begin for begin, end in pairwise(changes))
        if len(same) >= HABIT_CHANGES:
            usual = same[-1 - HABIT_EXCEPTIONS]
            self.rest_timeout = max(shortest, SURELY_FROZEN * usual)

    @property
    def span(self) -> float:
        """How long the samples kept reach back [s]."""
        return self.recent[-1][0] - self.recent[0][0] if self.recent else 0.0

    def spaced(self, interval: float, count: int) -> list[Timed]:
        """Return up to ``count`` of the samples kept, newest first, ``interval`` [s] apart."""
        chosen: list[Timed] = []
        for sample in reversed(self.recent):
            if not chosen or chosen[-1][0] - sample[0] >= interval - 1e-6:
                chosen.append(sample)
                if len(chosen) == count:
                    break
        return chosen

    def window(self, length: float, columns: int) -> Array:
        """Return the samples of the newest ``length`` seconds, (n, columns); empty if short."""
        recent = self.recent
        if not recent or self.span < length:
            return np.empty((0, columns))
        begin = recent[-1][0] - length
        return np.array([values[:columns] for stamp, values in recent if stamp >= begin])


def angle_between(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the angle between two unit xyzw quaternions [rad]."""
    same = sum((x - y) ** 2 for x, y in zip(a, b))
    opposite = sum((x + y) ** 2 for x, y in zip(a, b))
    return 4.0 * asin(min(1.0, sqrt(min(same, opposite)) / 2))


def transform_point(point: Array, pose: tuple[float, ...]) -> tuple[float, float, float]:
    """Transform a point from the frame of a pose, x y z [m] qx qy qz qw, to base [m]."""
    x, y, z, qx, qy, qz, qw = pose
    a, b, c = point.tolist()
    u, v, w = 2 * (qy * c - qz * b), 2 * (qz * a - qx * c), 2 * (qx * b - qy * a)
    return (x + a + qw * u + qy * w - qz * v, y + b + qw * v + qz * u - qx * w,
            z + c + qw * w + qx * v - qy * u)


def rates(samples: list[Timed]) -> list[Timed]:
    """Return the difference quotients of consecutive samples, at the times halfway between."""
    return [((t1 + t0) / 2, tuple((x1 - x0) / (t1 - t0) for x1, x0 in zip(v1, v0)))
            for (t1, v1), (t0, v0) in pairwise(samples)]


def distance_between(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the distance of two points [m]."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
