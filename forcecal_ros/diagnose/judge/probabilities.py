"""Probabilities, candidates and the verdict in one word and one sentence."""

from collections.abc import Mapping, Sequence
import math
from typing import NamedTuple

from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.judge.ties import Tie
from forcecal_ros.diagnose.search.odds import (
    log_odds,
    most_probable,
    PER_DECADE,
    PER_FURTHER,
    TRUST,
)

CANDIDATES = 0.95
"""Probability that the candidate set covers."""

NAMED = 0.8
"""Share of the misfit that effects must explain to be named although more is unexplained."""

MODEST = 0.99
"""Most of the probability of an effect: experience with some hundred shows no more."""

SURE = 0.7
"""
Most of the probability of unknown: some gaps are known effects in forms of their own, or beside
as much of others. Of 31 called unknown with 0.9 in those parts, 22 were.
"""

NEAREST = 3
"""Effects listed that come closest where none is named: as many as are refined at once."""

UNKNOWN = 'unknown'


class Slot(NamedTuple):
    """An accepted effect, its alternatives' log-odds against it, and what does the same."""

    name: str
    alternatives: Mapping[str, float]
    tie: Tie | None = None


def nameless(log_bayes_factors: Mapping[str, float], missing_evidence: Mapping[str, float],
             known: int = 0) -> dict[str, float]:
    """
    Return the probability that each effect is none, beside a discrepancy.

    Parameters
    ----------
    log_bayes_factors : mapping of str to float
        Of each effect against a discrepancy in its place.
    missing_evidence : mapping of str to float
        Log-evidence that a model without any flaw would have more where each acts.
    known : int
        Effects besides, known before any model.
    """
    odds = {name: log_odds(name, log_bayes_factors, missing_evidence[name], known)
            for name in log_bayes_factors}
    return {name: 1.0 - min(most_probable(name), _sigmoid(x)) for name, x in odds.items()}


def probabilities(slots: Sequence[Slot], part: UnexplainedPart, closed: float, known: int = 0,
                  doubts: Mapping[str, float] | None = None,
                  log_bayes_factors: Mapping[str, float] | None = None,
                  nearest: Mapping[str, float] | None = None
                  ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """
    Turn log-odds into probabilities.

    Parameters
    ----------
    slots : sequence of Slot
        One for each accepted effect.
    closed : float
        Share of the gap that is closed.
    known : int
        Effects that close a part of it besides, known before any model.
    doubts : mapping of str to float, optional
        Of each accepted effect, where a discrepancy is allowed for: that it is none.
    log_bayes_factors : mapping of str to float, optional
        By which those doubts count in that of the whole.
    nearest : mapping of str to float, optional
        Log-odds, among themselves, of effects that come closest where none is accepted.

    Returns
    -------
    named : dict of str to float
        Of each accepted effect.
    candidates : list of (str, float)
        Most probable first, as many as cover 95 %, those of every accepted effect.
    """
    several = len(slots) + known
    if several and (doubts or part.ratio < 1.0 or closed >= NAMED):
        shrunk = -math.log10(max(1e-4, 1.0 - closed))
        unknown = max(1.0 - MODEST, _sigmoid(PER_FURTHER * (several - 1) - TRUST
                                             - PER_DECADE * shrunk))
    else:
        unknown = min(SURE, _sigmoid(8.0 * (min(part.ratio, 3.0) - 1.0)))
    named: dict[str, float] = {}
    chosen: dict[str, float] = {}
    for name, alternatives, tie in slots:
        doubted = (doubts or {}).get(name, unknown)
        weights = {name: 1.0, **{k: math.exp(min(0.0, v)) for k, v in alternatives.items()
                                 if k != name}}
        if tie is not None:
            weights[tie.other] = max(tie.odds, weights.get(tie.other, 0.0))
        total = sum(weights.values())
        shares = {k: (1.0 - doubted) * w / total for k, w in weights.items()}
        shares[UNKNOWN] = doubted
        named[name] = shares[name]
        covered = 0.0
        for k, share in sorted(shares.items(), key=lambda pair: -pair[1]):
            if covered >= CANDIDATES:
                break
            chosen[k] = max(chosen.get(k, 0.0), share)
            covered += share
    if doubts and log_bayes_factors and UNKNOWN in chosen:
        weight = {name: max(factor, 1e-9) for name, factor in log_bayes_factors.items()}
        chosen[UNKNOWN] = sum(w * doubts[n] for n, w in weight.items()) / sum(weight.values())
    if not slots and part.ratio >= 1.0 and unknown > 1.0 - CANDIDATES:
        chosen[UNKNOWN] = unknown
        chosen.update(_shared(1.0 - SURE, nearest or {}))
    return named, sorted(chosen.items(), key=lambda pair: -pair[1])


def _shared(whole: float, log_odds_among: Mapping[str, float]) -> dict[str, float]:
    """Share a probability among the likeliest few."""
    likeliest = sorted(log_odds_among, key=lambda name: -log_odds_among[name])[:NEAREST]
    weight = {name: math.exp(log_odds_among[name] - log_odds_among[likeliest[0]])
              for name in likeliest}
    return {name: whole * w / sum(weight.values()) for name, w in weight.items()}


def _sigmoid(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


def listed_once(candidates: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    """List every name once, the most probable first."""
    highest: dict[str, float] = {}
    for name, p in candidates:
        highest[name] = max(p, highest.get(name, 0.0))
    return sorted(highest.items(), key=lambda pair: -pair[1])
