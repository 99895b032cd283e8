"""Which hypothesis is likeliest, and which is worth accepting."""

from collections.abc import Sequence

from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import Diverged
from forcecal_ros.diagnose.search.acceptance import acceptable
from forcecal_ros.diagnose.search.fitted import HypothesisFit
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
import numpy as np

TEMPERATURE = 2.0
"""Temperature of log-likelihoods where no large effect is at stake."""

MISMATCH = 1e-3
"""Part of the energy of an effect in which two valid models of it may differ."""

TAKEN_UP = 0.2
"""
Part of the missing evidence by which one of two valid models may lead for taking up something that
neither is meant for: in development cases on a real arm's motion wrong ones led by 0.2 and 0.5 of
it, right ones by 0.1 to 1.
"""

HOTTEST = 400.0
"""
Most that the temperature grows by: beyond it a discrepancy takes up what a model has wrong.

A crosstalk of 5 and of 10 % led a drift by 1600 and 6700, which has to decide.
"""

PARSIMONY = 0.5
"""Log-odds that each estimated parameter costs, beside its prior."""

SHORTLIST = 3
"""Hypotheses that are refined in each round, be they close to the best or not."""

WORTH = 2.0
"""Evidence of the linear screen from which the best are refined whatever their rank."""

CLOSE = 0.5
"""Fraction of the best gain from which a hypothesis is refined as well."""


def ranked(comparison: ModelComparison, found: Sequence[Hypothesis],
           tested: int) -> list[HypothesisFit]:
    """Screen hypotheses, refine the best, and return all fits, likeliest first."""
    screened = comparison.screen(found)
    by_name = {h.name: h for h in found}
    best = max((t.evidence for t, _ in screened), default=0.0)
    out, refined = [], 0
    for result, atom in screened:
        promising = result.evidence > CLOSE * best and np.isfinite(result.evidence)
        promising |= refined < SHORTLIST and result.evidence > WORTH
        if atom is not None and promising and result.gain > 1.0 and refined < 2 * SHORTLIST:
            refined += 1
            better = refined_or_rejected(comparison, by_name[result.name], result)
            if better.evidence > result.evidence or acceptable(better, tested) \
                    or not np.isfinite(better.evidence):
                result = better
        out.append(result)
    weight = weights(out)
    return sorted(out, key=lambda t: -weight[t.name])


def refined_or_rejected(comparison: ModelComparison, hypothesis: Hypothesis,
                        result: HypothesisFit) -> HypothesisFit:
    """Refine a fit; where its simulation diverges it is impossible."""
    try:
        return comparison.refine(hypothesis, result)
    except Diverged:
        return result._replace(gain=-np.inf, evidence=-np.inf)


def temperature_of(results: Sequence[HypothesisFit], missing: float = 0.0) -> float:
    """Temperature of log-likelihoods beside the energy that is at stake, and what is missing."""
    best = max((t.evidence for t in results), default=0.0)
    return TEMPERATURE + min(HOTTEST, MISMATCH * best + TAKEN_UP * missing)


def weights(results: Sequence[HypothesisFit], missing: float = 0.0) -> dict[str, float]:
    """
    Weigh hypotheses against the likeliest one.

    Beside large effects, likelihoods tell apart what no model gets right: the temperature rises
    with the energy at stake, and then fewer parameters count.

    Parameters
    ----------
    missing : float
        Log-evidence that a model without any flaw would have more than the likeliest.

    Returns
    -------
    dict of str to float
        Log-odds; -inf where a hypothesis is impossible.
    """
    best = max((t.evidence for t in results), default=0.0)
    temperature = temperature_of(results, missing)
    return {t.name: (t.evidence - best) / temperature - PARSIMONY * t.degrees
            for t in results}
