"""Block means: every sensor averaged over the same stretches of time, shifted where it lags.

Averaging commutes with everything linear, so a relation that holds between samples of
continuous signals holds between their block means, at any sensor's rate; and a delay of
a fraction of a sample is a shift of the stretch.
"""


from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import FREE, Phase, phase_spans, STILL
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

_GAP = 2.5
"""Stamps further apart than this many median periods leave the blocks between them empty."""

_TOO_CLOSE = 0.2
"""Where stamps follow each other by less, in median periods, or with a gap, readings are joined by
straight lines: a cubic spline through noise at such instants swings by many times the noise."""

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
        steps = np.diff(t) / period
        even = steps.min() > _TOO_CLOSE and steps.max() < _GAP
        curve = CubicSpline(t, values) if even else make_interp_spline(t, values, k=1)
        self._integral = curve.antiderivative()
        wide = np.flatnonzero(np.diff(t) > _GAP * period)
        self._gap_start = np.concatenate([t[wide], [t[-1] + period / 2]])
        self._gap_end = np.concatenate([t[wide + 1], [np.inf]])
        self._first = float(t[0] - period / 2)

    def interpolated(self, starts: Array, length: float) -> Array:
        """Average as :meth:`means`, across gaps along straight lines."""
        return np.asarray((self._integral(starts + length) - self._integral(starts)) / length)

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
        means = self.interpolated(starts, length)
        missing = (np.searchsorted(self._gap_start, ends - 1e-9)
                   > np.searchsorted(self._gap_end, starts + 1e-9))
        means[missing | (starts < self._first - 1e-9)] = np.nan
        return np.asarray(means)


def block_length(shortest: float, *periods: float) -> float:
    """
    Choose the length of the blocks [s].

    It is a multiple of the first period that holds at least five samples of each sensor, and no
    shorter than requested.
    """
    target = max(shortest, _MIN_SAMPLES * max(periods))
    return float(np.ceil(target / periods[0] - 1e-6) * periods[0])


def labelled(starts: Array, length: float, windows: list[tuple[float, float]],
             phases: tuple[Phase, ...]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """
    Say what happens in blocks.

    Parameters
    ----------
    starts : ndarray, shape (n,)
        Of blocks of `length` [s].
    windows : list of tuple of float
        Start and end of each static pose [s].
    phases : tuple of Phase
        Empty where none was recorded: all but the windows counts as free motion.

    Returns
    -------
    still : ndarray of int, shape (n,)
        Which static pose a block lies in; -1 for none.
    free : ndarray of bool, shape (n,)
        Moving, or settling, with nothing touching the tool.
    """
    still = np.full(len(starts), -1)
    for i, (begin, end) in enumerate(windows):
        still[_within(starts, length, begin, end)] = i
    free = np.zeros(len(starts), dtype=bool)
    for begin, end in phase_spans(phases, (*FREE, *STILL)) if phases else [(-np.inf, np.inf)]:
        free |= _within(starts, length, begin, end)
    return still, free & (still < 0)


def _within(starts: Array, length: float, begin: float, end: float) -> NDArray[np.bool_]:
    return (starts >= begin - 1e-9) & (starts + length <= end + 1e-9)
