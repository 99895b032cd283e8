"""Probabilities, candidates and the verdict in one word and one sentence."""

from collections.abc import Mapping, Sequence
import math

from forcecal_ros.diagnose.judge.residual_summary import UnexplainedPart
from forcecal_ros.diagnose.search.acceptance import decades_of, log_odds, others_beside, SHARE

CANDIDATES = 0.95
"""Probability that the candidate set covers."""

NAMED = 0.8
"""Share of the misfit that effects must explain to be named although more is unexplained."""

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


def nameless(log_bayes_factors: Mapping[str, float], missing_evidence: float, closed: float,
             known: int = 0) -> dict[str, float]:
    """
    Return the probability that each effect is none, beside a discrepancy.

    Parameters
    ----------
    log_bayes_factors : mapping of str to float
        Of each effect against a discrepancy in its place.
    missing_evidence : float
        As in :func:`doubt`.
    closed : float
        Share of the gap that all of them close.
    known : int
        Effects besides, known before any model.
    """
    out = {}
    for name, factor in log_bayes_factors.items():
        decades = min(_decades(closed), decades_of(factor, missing_evidence))
        cause = _sigmoid(log_odds(decades, known + others_beside(name, log_bayes_factors)))
        out[name] = 1.0 - cause * (1.0 - doubt(factor, missing_evidence))
    return out


def probabilities(slots: Sequence[tuple[str, Mapping[str, float]]], part: UnexplainedPart,
                  closed: float, known: int = 0, doubts: Mapping[str, float] | None = None,
                  log_bayes_factors: Mapping[str, float] | None = None
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
    log_bayes_factors : mapping of str to float, optional
        By which those doubts count in that of the whole.

    Returns
    -------
    named : dict of str to float
        Of each accepted effect.
    candidates : list of (str, float)
        Most probable first, as many as cover 95 %, those of every accepted effect.
    """
    several = len(slots) + known
    if several and (doubts or part.ratio < 1.0 or closed >= NAMED):
        unknown = _sigmoid(-log_odds(_decades(closed), several - 1.0))
    else:
        unknown = min(SURE, _sigmoid(8.0 * (min(part.ratio, 3.0) - 1.0)))
    named: dict[str, float] = {}
    chosen: dict[str, float] = {}
    for name, alternatives in slots:
        doubted = (doubts or {}).get(name, unknown)
        weights = {name: 1.0}
        weights.update({k: math.exp(min(0.0, v)) for k, v in alternatives.items()
                        if k != name})
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
    return named, sorted(chosen.items(), key=lambda pair: -pair[1])


def _decades(closed: float) -> float:
    return -math.log10(max(1e-4, 1.0 - closed))


def _sigmoid(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))
