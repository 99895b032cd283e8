"""Control limits of a number that is estimated again and again: a self-starting CUSUM.

Nobody knows beforehand what a robot's number is, nor how far it scatters from night to night. Each
new estimate is therefore compared with those before it ([Hawkins1987]), weighted by their standard
errors, which are taken to be right up to a common factor: what no calibration knows of itself
scatters, too. While nothing changes the scores are independent and standard normal, exactly, from
the third estimate on; what they add up to is compared with a limit.
"""

from collections.abc import Sequence
from math import copysign, exp, inf, isfinite, sqrt
from statistics import median
from typing import NamedTuple

from scipy.optimize import brentq
from scipy.special import ndtri, stdtr

SLACK = 0.5
"""Half the shift that is found soonest, in standard deviations of an estimate: 0.5 finds one of 1
soonest ([Page1954])."""

LONE = 0.7
"""Share of the limit that a single estimate may fill: one bad recording is no change, two are."""

HEAVIEST = 1e6
"""Weight of one estimate beside the usual: a standard error of a thousandth is a slip."""

LEAST = 3
"""Estimates before the first score: two tell no scatter."""


class Change(NamedTuple):
    """
    A number that did not stay what it was.

    Attributes
    ----------
    onset : int
        Index of the first estimate that is counted to what is so now.
    noticed : int
        Index of the one at which the limit was passed.
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
        Standard errors; where one is not known, all count the same.
    h : float
        Of :func:`limit`.
    """
    known = len(stds) > 0 and all(isfinite(s) and s > 0.0 for s in stds)
    usual = median(stds) if known else 0.0
    weights = [min(max((usual / s) * (usual / s), 1.0 / HEAVIEST), HEAVIEST) if known else 1.0
               for s in stds]
    levels, odd, changes = list[float](), list[int](), list[Change]()
    while len(levels) < len(values):
        run = _run(values, weights, h, len(levels), usual)
        levels += run.level
        odd += run.odd
        changes += run.changes
    return Chart(tuple(levels), tuple(odd), tuple(changes))


def _run(values: Sequence[float], weights: Sequence[float], h: float, begin: int, usual: float
         ) -> Chart:
    """Follow a series from one estimate on until it changes."""
    base, most = _Base(usual), LONE * h + SLACK
    up = down = 0.0
    levels, odd = list[float](), list[int]()
    for i in range(begin, len(values)):
        score = base.score(values[i], weights[i])
        up = max(0.0, up + min(score, most) - SLACK)
        down = max(0.0, down - max(score, -most) - SLACK)
        levels.append(max(up, down) / h)
        if max(up, down) >= h:
            found = _change(values, weights, begin, i, base.scale)
            return Chart(tuple(levels), tuple(odd), (found,))
        if abs(score) >= most:
            odd.append(i)
        else:
            base.add(values[i], weights[i])
    return Chart(tuple(levels), tuple(odd), ())


def _change(values: Sequence[float], weights: Sequence[float], begin: int, noticed: int,
            scale: float) -> Change:
    """Find the likeliest onset: the two means on either side explain most of the scatter."""
    def split(at: int) -> Change:
        (before, one), (after, other) = (
            _mean(values[part], weights[part])
            for part in (slice(begin, at), slice(at, noticed + 1)))
        return Change(at, noticed, before, after, scale * sqrt(1.0 / one + 1.0 / other))

    whole = _mean(values[begin:noticed + 1], weights[begin:noticed + 1])[1]

    def explained(change: Change) -> float:
        one = sum(weights[begin:change.onset])
        return (change.after - change.before) ** 2 * one * (whole - one)

    return max(map(split, range(begin + 1, noticed + 1)), key=explained)


def _mean(values: Sequence[float], weights: Sequence[float]) -> tuple[float, float]:
    """Return the weighted mean, and the sum of the weights."""
    total = sum(weights)
    return sum(w * x for w, x in zip(weights, values)) / total, total


class _Base:
    """Weighted mean and scatter of what came before, one estimate after the other ([West1979])."""

    def __init__(self, usual: float) -> None:
        self._usual = usual
        self._n, self._weight, self._mean, self._squares = 0, 0.0, 0.0, 0.0

    @property
    def scale(self) -> float:
        """Standard deviation of an estimate of weight 1; where none scattered, as they say."""
        scatter = sqrt(self._squares / (self._n - 1)) if self._n > 1 else 0.0
        return scatter or self._usual

    def score(self, value: float, weight: float) -> float:
        """Return how far an estimate is off, as a standard normal number."""
        if self._n < LEAST - 1 or value == self._mean:
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
