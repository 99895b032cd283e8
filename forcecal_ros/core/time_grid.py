"""Block means: every sensor averaged over the same stretches of time, shifted where it lags.

Averaging commutes with everything linear, so a relation that holds between samples of
continuous signals holds between their block means, at any sensor's rate; and a delay of
a fraction of a sample is a shift of the stretch.
"""

from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import FREE, Phase, phase_spans
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

_GAP = 2.5
"""Stamps further apart than this many median periods leave the blocks between them empty."""

_TOO_CLOSE = 0.2
"""Stamps that follow each other by less, in median periods, are joined by straight lines: a cubic
spline through noise at such instants swings by many times the noise."""

_MIN_SAMPLES = 5
"""Of the slowest sensor in a block: fewer do not average its noise."""


class Averager:
    """
    Means of a sampled signal over arbitrary stretches of time.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Strictly increasing [s].
    values : ndarray, shape (n, k)
    """

    def __init__(self, t: Array, values: Array) -> None:
        period = float(np.median(np.diff(t)))
        smooth = np.diff(t).min() > _TOO_CLOSE * period
        curve = CubicSpline(t, values) if smooth else make_interp_spline(t, values, k=1)
        self._integral = curve.antiderivative()
        wide = np.flatnonzero(np.diff(t) > _GAP * period)
        self._gap_start = np.concatenate([t[wide], [t[-1] + period / 2]])
        self._gap_end = np.concatenate([t[wide + 1], [np.inf]])
        self._first = float(t[0] - period / 2)

    def means(self, starts: Array, length: float) -> Array:
        """
        Average over ``[start, start + length)`` for each start.

        Parameters
        ----------
        starts : ndarray, shape (m,)
            [s]
        length : float
            [s]

        Returns
        -------
        ndarray, shape (m, k)
            NaN where samples are missing.
        """
        ends = starts + length
        means = (self._integral(ends) - self._integral(starts)) / length
        missing = (np.searchsorted(self._gap_start, ends - 1e-9)
                   > np.searchsorted(self._gap_end, starts + 1e-9))
        means[missing | (starts < self._first - 1e-9)] = np.nan
        return np.asarray(means)


class TimeGrid(NamedTuple):
    """
    Consecutive blocks of equal length.

    Attributes
    ----------
    starts : ndarray, shape (n,)
        [s]
    length : float
        Of each block [s].
    still : ndarray of int, shape (n,)
        Which static pose a block lies in; -1 for none.
    free : ndarray of bool, shape (n,)
        Moving, or settling, with nothing touching the tool.
    """

    starts: Array
    length: float
    still: NDArray[np.intp]
    free: NDArray[np.bool_]


def block_length(shortest: float, *periods: float) -> float:
    """
    Choose the length of the blocks [s].

    It is a multiple of the first period that holds at least five samples of each sensor, and no
    shorter than requested.
    """
    target = max(shortest, _MIN_SAMPLES * max(periods))
    return float(np.ceil(target / periods[0] - 1e-6) * periods[0])


def make_time_grid(t: Array, length: float, windows: list[tuple[float, float]],
                   phases: tuple[Phase, ...]) -> TimeGrid:
    """
    Lay blocks over a recording and say what happens in each.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Stamps of the wrench [s]; blocks start half-way between two samples.
    length : float
        [s]
    windows : list of tuple of float
        Start and end of each static pose [s].
    phases : tuple of Phase
        Empty where none was recorded: all but the windows counts as free motion.
    """
    period = float(np.median(np.diff(t)))
    n = max(0, int((t[-1] - t[0]) / length))
    starts = t[0] + period / 2 + length * np.arange(n)
    still = np.full(n, -1)
    for i, (begin, end) in enumerate(windows):
        still[_within(starts, length, begin, end)] = i
    free = np.zeros(n, dtype=bool)
    for begin, end in phase_spans(phases, FREE) if phases else [(-np.inf, np.inf)]:
        free |= _within(starts, length, begin, end)
    touched = np.zeros(n, dtype=bool)
    for begin, end in windows:
        touched |= (starts + length > begin) & (starts < end)
    return TimeGrid(starts, length, still, free & ~touched)


def _within(starts: Array, length: float, begin: float, end: float) -> NDArray[np.bool_]:
    return (starts >= begin - 1e-9) & (starts + length <= end + 1e-9)
