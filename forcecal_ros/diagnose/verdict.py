"""The verdict in one word and one sentence."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

UNKNOWN = 'unknown'
"""Among candidates: what no library has."""

NAMED = 0.5
"""Probability from which an effect is named: likelier than not."""

TOLERANCE = 0.1
"""RMS of what is unexplained, in that of a channel's noise, that does not matter by default."""


def tolerated(given: float | None, exact: float) -> float:
    """Return the tolerance: the given one, else TOLERANCE or, if coarser, how exact a model is."""
    return max(TOLERANCE, exact) if given is None else given


MIN_EXPLAINED_WHOLE = 0.95
"""Explained share from which what is unexplained does not matter beside it."""

MAX_UNEXPLAINED_RATIO = 10.0
"""Ratio of the unexplained part from which it matters beside any explained share."""

LEAST_EXPLAINED = 0.5
"""Explained share below which effects beside a discrepancy leave more than they explain."""

WITHIN = 'within tolerance'
"""How much of a recording is explained whose residual is more than noise but does not matter."""


class UnexplainedPart(NamedTuple):
    """
    What is unexplained, as a multiple of what noise would leave.

    Attributes
    ----------
    ratio : float
        Largest statistic over its threshold: more than noise from 1 on.
    words : str
        What it is.
    within : str
        What is more than noise, but no more than is tolerated; empty where something matters.
    """

    ratio: float
    words: str
    within: str = ''


def percent(share: float) -> str:
    """Write a share; what is not all is never called 100 %, what is not nothing never 0 %."""
    whole = round(100.0 * share)
    if whole == 100 and share < 1.0:
        return 'over 99 %'
    return 'under 1 %' if whole == 0 and share > 0.0 else f'{whole} %'


def verdict(named: Sequence[str], candidates: Sequence[tuple[str, float]],
            part: UnexplainedPart, closed: float | None, excited: bool, whole: bool = True,
            with_discrepancy: bool = False, slow_noise: bool = False, band: float = inf,
            certain: Sequence[str] = (),
            at_limit: Sequence[str] = (), at_tolerance: Sequence[str] = ()) -> tuple[str, str]:
    """
    Say it in one word and one sentence.

    Parameters
    ----------
    named : sequence of str
        Accepted effects.
    closed : float or None
        Explained fraction; None where effects show in stamps and values alone.
    excited : bool
        Whether the recording moves enough to separate effects.
    whole : bool
        Whether every stream could be compared.
    with_discrepancy : bool
        Whether the effects were weighed beside a discrepancy, which then is the residual.
    slow_noise : bool
        Whether slow variation counts as noise, which it may not be.
    band : float
        Up to which frequency the simulation is meant to hold [Hz].
    certain : sequence of str
        Which of the effects stamps or values show: they are there in any case.
    at_limit : sequence of str
        Numbers of accepted effects that would be larger if their limits let them.
    at_tolerance : sequence of str
        Numbers of the rig beside them that would be further off if their tolerances let them.
    """
    listed = ' and '.join(named)
    significant = part.ratio >= 1.0
    if not excited:
        return 'not_excited', ('the recording moves too little to separate effects; record '
                               'what forcecal plan writes')
    if not named:
        if significant:
            return 'unknown', (f'there is a gap that no effect of the library explains: '
                               f'{part.words}')
        what = 'the recording' if whole else 'what could be compared'
        below = f' below {band:g} Hz' if band < inf else ''
        slow = ', if slow variation is noise' if slow_noise else ''
        if part.within:
            return 'no_gap', (f'the recalibrated rig explains {what}{below} {WITHIN}{slow}: '
                              f'{part.within}')
        return 'no_gap', f'the recalibrated rig explains {what}{below} down to its noise{slow}'
    unknown = dict(candidates).get(UNKNOWN, 0.0) >= 1.0 - NAMED
    end = '' if len(named) > 1 else 's'
    if at_limit or (unknown and not certain):
        if at_limit:
            why = (f'{" and ".join(at_limit)} reached its limit: the recording is probably '
                   'of another robot, tool or unit than the model')
        elif closed is None or closed < 0.0:
            why = 'adding it increases the held-out residual'
        else:
            why = f'explain{end} {percent(closed)} of the residual'
        more = f'; residual: {part.words}' if significant else ''
        return 'unknown', (f'no effect of the library explains the gap: {listed} come{end} '
                           f'closest, but {why}{more}')
    done = f'explain{end} {percent(closed or 0.0)} of the residual'
    if closed is None:
        done, closed = f'show{end} in stamps and values', 1.0
    beside = with_discrepancy and not unknown
    rest = f'; residual: {part.words}' if significant else ''
    others = [name for name in named if name not in certain]
    if unknown and others:
        these = ' and '.join(others) if certain else 'these together'
        rest += f'; one effect that is not in the library is likelier than {these}'
    if at_tolerance:
        rest += (f'; at the limit of the tolerance: {", ".join(at_tolerance)} (another robot, '
                 'tool or unit was recorded than it is compared with, or more than this differs)')
    partly = unknown or (significant and (
        closed < MIN_EXPLAINED_WHOLE or part.ratio > MAX_UNEXPLAINED_RATIO))
    if closed < LEAST_EXPLAINED if beside else partly:
        return 'partial', f'{listed} {done}{rest}'
    rivals = [n for n, _ in candidates if n not in named and n != UNKNOWN]
    if rivals:
        return 'ambiguous', (f'{listed} {done}, but {" or ".join(rivals)} may be '
                             f'the cause instead{rest}')
    return 'partial' if at_tolerance else 'identified', f'{listed} {done}{rest}'
