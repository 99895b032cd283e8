"""Control limits of a number that is estimated again and again: a self-starting CUSUM.

A robot's number and its scatter from night to night are not known beforehand. Each new estimate is
compared with those before it ([Hawkins1987]), weighted by their standard errors, which are assumed
to be right up to a common factor. While nothing changes, the scores are independent and standard
normal, exactly, from the third estimate on; their sum is compared with a limit.
"""

from collections.abc import Sequence
from math import copysign, exp, inf, isfinite, sqrt
from statistics import median
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri, stdtr

SLACK = 0.5
"""Half the shift that is found soonest, in standard deviations of an estimate: 0.5 finds one of 1
soonest ([Page1954])."""

SINGLE_FRACTION = 0.7
"""Fraction of the limit that one estimate may fill: one bad recording is not a change, two are."""

MAX_WEIGHT = 1e6
"""Of one estimate relative to the median: a standard error of a thousandth is not accepted."""


class Change(NamedTuple):
    """
    A change of a number.

    Attributes
    ----------
    onset : int
        Index of the first estimate after it.
    noticed : int
        Index of the estimate at which the limit was passed.
    before : float
        Weighted mean before the onset.
    after, std : float
        Weighted mean from the onset to where it was noticed, and the standard error of the change
        by the scatter before.
    """

    onset: int
    noticed: int
    before: float
    after: float
    std: float


class Chart(NamedTuple):
    """
    A series against its limits.

    Attributes
    ----------
    level : tuple of float
        Of each estimate, how full the fuller of both sums is; from 1 on it counts as a change.
    odd : tuple of int
        Estimates that by themselves are as far off as one may be.
    changes : tuple of Change
    """

    level: tuple[float, ...]
    odd: tuple[int, ...]
    changes: tuple[Change, ...]


def limit(run_length: float) -> float:
    """
    Return the limit of a two-sided CUSUM, in standard deviations.

    [Siegmund1985]: a one-sided sum with slack k reaches h by chance after
    (exp(2 k b) - 2 k b - 1) / (2 k^2) numbers on average, where b = h + 1.166.

    Parameters
    ----------
    run_length : float
        Numbers between two false alarms, on average.
    """
    def excess(h: float) -> float:
        b = 2.0 * SLACK * (h + 1.166)
        return (exp(b) - b - 1.0) / (2.0 * SLACK ** 2) - 2.0 * run_length

    return float(brentq(excess, 0.1, 100.0))


def chart(values: Sequence[float], stds: Sequence[float], h: float) -> Chart:
    """
    Follow a series; after a change it begins anew.

    With what came after the change was noticed: what made it noticed is far off by selection, and
    what is compared with that returns to the mean.

    Parameters
    ----------
    values : sequence of float
        In the order of time.
    stds : sequence of float
        Standard errors; if one is not known, all count the same.
    h : float
        Of :func:`limit`.
    """
    known = len(stds) > 0 and all(isfinite(s) and s > 0.0 for s in stds)
    usual = median(stds) if known else 0.0
    weights = [min(max((usual / s) * (usual / s), 1.0 / MAX_WEIGHT), MAX_WEIGHT) if known else 1.0
               for s in stds]
    levels, odd, changes = list[float](), list[int](), list[Change]()
    begin, base, up, down = 0, _Base(usual), 0.0, 0.0
    most = SINGLE_FRACTION * h + SLACK
    for i, (value, weight) in enumerate(zip(values, weights)):
        score = base.score(value, weight)
        up = max(0.0, up + min(score, most) - SLACK)
        down = max(0.0, down - max(score, -most) - SLACK)
        levels.append(max(up, down) / h)
        if max(up, down) >= h:
            changes.append(_change(np.array(values[begin:i + 1]), np.array(weights[begin:i + 1]),
                                   begin, base.scale))
            begin, base, up, down = i + 1, _Base(usual), 0.0, 0.0
        elif abs(score) >= most:
            odd.append(i)
        else:
            base.add(value, weight)
    return Chart(tuple(levels), tuple(odd), tuple(changes))


def _change(x: Array, w: Array, begin: int, scale: float) -> Change:
    """Find the likeliest onset: the two means on either side explain most of the scatter."""
    one, other = np.cumsum(w)[:-1], np.cumsum(w[::-1])[-2::-1]
    before, after = np.cumsum(w * x)[:-1] / one, np.cumsum((w * x)[::-1])[-2::-1] / other
    at = int(np.argmax((after - before) ** 2 * one * other))
    return Change(begin + at + 1, begin + len(x) - 1, float(before[at]), float(after[at]),
                  scale * sqrt(1.0 / one[at] + 1.0 / other[at]))


class _Base:
    """Weighted mean and scatter of what came before, one estimate after the other ([West1979])."""

    def __init__(self, usual: float) -> None:
        self._usual = usual
        self._n, self._weight, self._mean, self._squares = 0, 0.0, 0.0, 0.0

    @property
    def scale(self) -> float:
        """Standard deviation of an estimate of weight 1; without scatter, the median error."""
        scatter = sqrt(self._squares / (self._n - 1)) if self._n > 1 else 0.0
        return scatter or self._usual

    def score(self, value: float, weight: float) -> float:
        """Return how far an estimate is off, as a standard normal number."""
        if self._n < 2 or value == self._mean:
            return 0.0
        spread = self.scale * sqrt(1.0 / weight + 1.0 / self._weight)
        off = (value - self._mean) / spread if spread else copysign(inf, value - self._mean)
        # the smaller tail has the digits
        return float(-ndtri(stdtr(self._n - 1, -abs(off)))) * (1.0 if off > 0.0 else -1.0)

    def add(self, value: float, weight: float) -> None:
        """Count an estimate in."""
        off = value - self._mean
        self._n, self._weight = self._n + 1, self._weight + weight
        self._mean += off * weight / self._weight
        self._squares += weight * off * (value - self._mean)
