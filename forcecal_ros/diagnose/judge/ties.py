"""Effects that samples cannot tell apart, whatever a fit says.

A late wrench and one behind a low-pass differ, below the corner, in what the latter takes off
the amplitude at frequency w: (w T)^2 / 2 of a lag T. Readings that come late by a part a of a
sample dt have been interpolated between two of them, or averaged over one, and that takes off the
like, a (1 - a) (w dt)^2 / 2 where it is a straight line. Which of the two such a lag is depends on
how a driver makes its samples, which no recording shows.
"""

from collections.abc import Mapping
import math
from typing import NamedTuple

from forcecal_ros.diagnose.judge.named_effects import Parameter


class _Lag(NamedTuple):
    """Number that is the lag, and the effect that shows like it."""

    number: str
    other: str


LAGS: Mapping[str, _Lag] = {
    'wrench_delay': _Lag('delay', 'wrench_lowpass'),
    'wrench_lowpass': _Lag('time_constant', 'wrench_delay'),
}


def tied(name: str, numbers: Mapping[str, Parameter], period: float) -> str:
    """
    Name the effect that is the same as another to samples so far apart.

    Parameters
    ----------
    name : str
        Of the effect that was accepted.
    numbers : mapping of str to Parameter
        Its own.
    period : float
        Between samples of the wrench [s].

    Returns
    -------
    str
        Empty where there is none.
    """
    lag = LAGS.get(name)
    found = None if lag is None else numbers.get(lag.number)
    return lag.other if lag and found is not None and abs(found.value) < period else ''


def with_tie(alternatives: Mapping[str, float], other: str, odds: float = 1.0
             ) -> dict[str, float]:
    """Return log-odds in which an effect has such odds against the accepted one, at least."""
    return {**alternatives, other: max(math.log(odds), alternatives.get(other, -math.inf))} \
        if other else dict(alternatives)


def note_of(name: str, other: str, period: float) -> str:
    """Say why two effects share the probability."""
    return (f'{name} and {other} are the same where the lag is less than a sample of the wrench '
            f'({1e3 * period:.3g} ms): only a faster recording tells them apart')
