"""One topic's samples as they arrive, kept for as long as stillness is judged over."""

from collections import deque
from math import asin, inf, sqrt

from forcecal_ros.geometry import Array
import numpy as np

KEPT = 2.0
"""Samples are kept for that long to judge stillness [s]."""


class Channel:
    """The last that was heard of one topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.heard = -inf
        self.changed = -inf
        self.stamp = -inf
        self.late_since = inf
        self.values: tuple[float, ...] = ()
        self.recent: deque[tuple[float, tuple[float, ...]]] = deque()

    def take(self, alive: float, stamp: float, values: tuple[float, ...]) -> None:
        """Note a sample; ``alive`` is the caller's time of arrival."""
        if values != self.values:
            self.changed = alive
        self.heard, self.stamp, self.values = alive, stamp, values

    def keep(self) -> None:
        """Keep the last sample to judge stillness by."""
        recent = self.recent
        recent.append((self.stamp, self.values))
        while recent and not 0.0 <= self.stamp - recent[0][0] <= KEPT:
            recent.popleft()

    @property
    def span(self) -> float:
        """How long the samples kept reach back [s]."""
        return self.recent[-1][0] - self.recent[0][0] if self.recent else 0.0

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


def distance_between(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the distance of two points [m]."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
