"""Probabilities, candidates and the verdict in one word and one sentence."""

from collections.abc import Mapping, Sequence
import math

from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.search.acceptance import SHARE

CANDIDATES = 0.95
"""Probability that the candidate set covers."""

NAMED = 0.8
"""Share of the misfit that effects must explain to be named although more is unexplained."""

TRUST, PER_DECADE, PER_FURTHER = 0.7, 1.4, 1.5
"""
Log-odds that effects are the cause which close nothing; more for each factor of ten by which the
gap shrinks, less for each effect beyond one: a logistic fit to 150 effects that were named in
opened blind recordings.
"""

STEEPNESS = 3.0
"""Log-odds of an effect against a discrepancy for each factor of ten by which it brings more."""

SURE = 0.9
"""Most of the probability of unknown: some gaps are known effects in forms of their own."""

UNKNOWN = 'unknown'


def doubt(log_bayes_factor: float, missing_evidence: float) -> float:
    """
    Return the probability that a discrepancy only looks like an effect.

    Parameters
    ----------
    log_bayes_factor : float
        Log-evidence of the effect against a discrepancy in its place.
    missing_evidence : float
        Log-evidence that a model without any flaw would have more; 0: there is none.
    """
    if missing_evidence <= 0.0:
        return 0.0
    return _sigmoid(-STEEPNESS * math.log10(max(log_bayes_factor,
                                                1e-9) / (SHARE * missing_evidence)))


def probabilities(slots: Sequence[tuple[str, Mapping[str, float]]], part: UnexplainedPart,
                  closed: float, known: int = 0, doubts: Mapping[str, float] | None = None
                  ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """
    Turn log-odds into probabilities.

    Parameters
    ----------
    slots : sequence of (str, mapping of str to float)
        Each accepted effect, and its alternatives' log-odds against it.
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
    if several and (doubts or part.ratio < 1.0 or closed >= NAMED):
        rest = math.log10(max(1e-4, 1.0 - closed))
        unknown = _sigmoid(-TRUST + PER_DECADE * rest + PER_FURTHER * (several - 1))
    else:
        unknown = min(SURE, _sigmoid(8.0 * (min(part.ratio, 3.0) - 1.0)))
    named: dict[str, float] = {}
    chosen: dict[str, float] = {}
    for name, alternatives in slots:
        nameless = 1.0 - (1.0 - unknown) * (1.0 - (doubts or {}).get(name, 0.0))
        weights = {name: 1.0}
        weights.update({k: math.exp(min(0.0, v)) for k, v in alternatives.items()
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
    if not slots and part.ratio >= 1.0 and unknown > 1.0 - CANDIDATES:
        chosen[UNKNOWN] = unknown
    return named, sorted(chosen.items(), key=lambda pair: -pair[1])


def _sigmoid(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))
