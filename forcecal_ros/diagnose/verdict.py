"""Probabilities, candidates and the verdict in one word and one sentence."""

from collections.abc import Mapping, Sequence
import math
from typing import NamedTuple

from forcecal_ros.diagnose.ranking import SHARE

CANDIDATES = 0.95
"""Probability that the candidate set covers."""

NAMED = 0.8
"""Share of the gap that effects must close to be named although something is left."""

WHOLE = 0.95
"""Share from which what is left does not matter beside it."""

GLARING = 10.0
"""Ratio of what is left from which it matters beside any share."""

TRUST, PER_DECADE, PER_FURTHER = 0.7, 1.4, 1.5
"""
Log-odds that effects are the cause which close nothing; more for each factor of ten by which the
gap shrinks, less for each effect beyond one: a logistic fit to 150 effects that were named in
opened blind recordings.
"""

HALF = 0.5
"""Share below which effects that are sure leave more than they explain."""

STEEPNESS = 3.0
"""Log-odds of an effect against a discrepancy for each factor of ten by which it brings more."""

SURE = 0.9
"""Most of the probability of unknown: some gaps are known effects in forms of their own."""

UNKNOWN = 'unknown'


class Remains(NamedTuple):
    """
    What is left unexplained, as multiples of what noise leaves.

    Attributes
    ----------
    ratio : float
        Largest statistic over its threshold: something is left from 1 on.
    words : str
        What it is.
    """

    ratio: float
    words: str


def doubt(lead: float, wanting: float) -> float:
    """
    Return the probability that a discrepancy only looks like an effect.

    Parameters
    ----------
    lead : float
        Log-evidence of the effect against a discrepancy in its place.
    wanting : float
        Log-evidence that a model without any flaw would have more; 0: there is none.

    Returns
    -------
    float
    """
    if wanting <= 0.0:
        return 0.0
    return _sigmoid(-STEEPNESS * math.log10(max(lead, 1e-9) / (SHARE * wanting)))


def probabilities(slots: Sequence[tuple[str, Mapping[str, float]]], remains: Remains,
                  closed: float, known: int = 0, doubts: Mapping[str, float] | None = None
                  ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """
    Turn log-odds into probabilities.

    Parameters
    ----------
    slots : sequence of (str, mapping of str to float)
        Each accepted effect, and its rivals' log-odds against it.
    remains : Remains
    closed : float
        Share of the gap that is closed.
    known : int
        Effects that close a part of it besides, known before any model.
    doubts : mapping of str to float, optional
        Of each accepted effect, where a discrepancy is allowed for: that it is none.

    Returns
    -------
    named : dict of str to float
        Of each accepted effect.
    candidates : list of (str, float)
        Most probable first, as many as cover 95 %, those of every accepted effect.
    """
    several = len(slots) + known
    if several and (doubts or remains.ratio < 1.0 or closed >= NAMED):
        rest = math.log10(max(1e-4, 1.0 - closed))
        unknown = _sigmoid(-TRUST + PER_DECADE * rest + PER_FURTHER * (several - 1))
    else:
        unknown = min(SURE, _sigmoid(8.0 * (min(remains.ratio, 3.0) - 1.0)))
    named: dict[str, float] = {}
    chosen: dict[str, float] = {}
    for name, rivals in slots:
        nameless = 1.0 - (1.0 - unknown) * (1.0 - (doubts or {}).get(name, 0.0))
        weights = {name: 1.0}
        weights.update({k: math.exp(min(0.0, v)) for k, v in rivals.items()
                        if k != name})
        total = sum(weights.values())
        shares = {k: (1.0 - nameless) * w / total for k, w in weights.items()}
        shares[UNKNOWN] = nameless
        named[name] = shares[name]
        covered = 0.0
        for k, share in sorted(shares.items(), key=lambda pair: -pair[1]):
            if covered >= CANDIDATES:
                break
            chosen[k] = max(chosen.get(k, 0.0), share)
            covered += share
    if not slots and remains.ratio >= 1.0 and unknown > 1.0 - CANDIDATES:
        chosen[UNKNOWN] = unknown
    return named, sorted(chosen.items(), key=lambda pair: -pair[1])


def _sigmoid(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


def percent(share: float) -> str:
    """Write a share; what is not all is never called 100 %, what is not nothing never 0 %."""
    whole = round(100.0 * share)
    if whole == 100 and share < 1.0:
        return 'over 99 %'
    return 'under 1 %' if whole == 0 and share > 0.0 else f'{whole} %'


def verdict(named: Sequence[str], candidates: Sequence[tuple[str, float]], remains: Remains,
            closed: float | None, excited: bool, whole: bool = True, allowed: bool = False
            ) -> tuple[str, str]:
    """
    Say it in one word and one sentence.

    Parameters
    ----------
    named : sequence of str
        Accepted effects.
    candidates : sequence of (str, float)
    remains : Remains
    closed : float or None
        Share of the gap that the effects close; None where they show in stamps and values alone.
    excited : bool
        Whether the recording moves enough to tell effects apart.
    whole : bool
        Whether every stream could be looked at.
    allowed : bool
        Whether the effects were weighed beside a discrepancy, which then is what is left.

    Returns
    -------
    word, sentence : str
    """
    listed = ' and '.join(named)
    left = remains.ratio >= 1.0
    if not excited:
        return 'not_excited', ('the recording moves too little to tell effects apart; record '
                               'poses, a step, a sweep, slow reversals and contact')
    if not named:
        if left:
            return 'unknown', (f'there is a gap that no effect of the library explains: '
                               f'{remains.words}')
        what = 'the recording' if whole else 'what could be looked at'
        return 'no_gap', f'the recalibrated rig explains {what} down to its noise'
    if closed is not None and closed < 0.0:
        more = f'; unexplained: {remains.words}' if left else ''
        return 'unknown', (f'no effect of the library explains the gap: {listed} fits what it was '
                           f'fitted to and makes the rest worse{more}')
    done = f'explains {percent(closed or 0.0)} of the misfit'
    if closed is None:
        done, closed = 'shows in stamps and values', 1.0
    doubtful = dict(candidates).get(UNKNOWN, 0.0) > 0.5
    beside = allowed and not doubtful
    if not beside and left and (closed < NAMED or doubtful):
        closest = (f'{listed} comes closest and would explain {percent(closed)} of the misfit'
                   ', too little to be named; unexplained: ') if closed > 0.0 else ''
        return 'unknown', (f'no effect of the library explains the gap: {closest}'
                           f'{remains.words}')
    rest = f'; {"what remains" if beside else "unexplained"}: {remains.words}' if left else ''
    if doubtful:
        rest += '; one effect that is not in the library is likelier than these together'
    partly = doubtful or (left and (closed < WHOLE or remains.ratio > GLARING))
    if closed < HALF if beside else partly:
        return 'partial', f'{listed} {done}{rest}'
    others = [n for n, _ in candidates if n not in named and n != UNKNOWN]
    if others:
        return 'ambiguous', (f'{listed} {done}, but {" or ".join(others)} explains it '
                             f'about as well{rest}')
    return 'identified', f'{listed} {done}{rest}'
