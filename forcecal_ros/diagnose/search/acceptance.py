"""What an effect has to bring to be accepted, and which hypothesis is likeliest."""

from collections.abc import Sequence

from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import Diverged, LinearisedModel
from forcecal_ros.diagnose.search.fitted import HypothesisFit
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.recording.noise.autoregression import unpredicted
import numpy as np

SIGNIFICANT = 0.01
"""Family-wise error of a round of hypotheses (Holm's first step)."""

LEAST_GAIN = 3.0
"""Log-likelihood of held-out blocks that an effect has to gain."""

LEAST_FRACTION = 0.05
"""Lower bound of the above-noise energy that an effect has to explain."""

NEGLIGIBLE = 0.05
"""RMS of a difference, in noise RMS of every channel and kind of motion, that is no gap."""

SHARE = 0.5
"""
Log-evidence that an effect has to bring, as a share of the missing evidence.

Of some thirty development recordings with a background, effects that were not there brought up
to 0.14 of it on simulated motion and 0.8, once 2.7, on a real arm's; effects of ten times the
background's energy 0.8 to 1e5; fainter ones 0.06 to 6.
"""

LEAST_LONG_MEMORY_RATIO = 8.0
"""Log-likelihood ratio that an effect needs on all data where the noise may have a long memory."""

FORM = 5e-3
"""Part of the energy, or evidence, of an effect that a wrong form of it may leave."""

LEAST_BEYOND = 25.0
"""Whitened energy that a further effect has to explain beyond what a wrong form may leave."""


def long_memory_likelihood_ratio(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood that an effect brings where the noise may have a long memory.

    A drift, a cable and the like look as 1/f noise does. So both residuals, whitened by the
    same filter, may be predicted from the means of their own past (a heterogeneous
    autoregression) before they are compared.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with the effect, each at its best fit.
    """
    total = 0.0
    for noise, r0, r1 in zip(after.noise, before.residuals, after.residuals):
        for c in range(len(CHANNELS)):
            rows = noise.rows[:, c] & noise.sigma[noise.groups, c].astype(bool)
            if not rows.any() or np.array_equal(r0[:, c], r1[:, c]):
                continue
            white = noise.whiten(np.stack([r0[:, c], r1[:, c]]), c)
            rests = [unpredicted(w, rows) for w in white]
            total += 0.5 * int(rows.sum()) * float(np.log(rests[0] / rests[1]))
    return total


def acceptable(result: HypothesisFit, tested: int) -> bool:
    """Say whether a fitted hypothesis passes significance, gain, fraction and size."""
    return (result.gain > LEAST_GAIN and result.p * tested < SIGNIFICANT
            and result.fraction > LEAST_FRACTION and result.size > NEGLIGIBLE)


def beyond_mismatch(first: LinearisedModel, before: LinearisedModel,
                    after: LinearisedModel) -> float:
    """
    Energy that the last effect explains beyond what a wrong form of the others may leave.

    Parameters
    ----------
    first, before, after : LinearisedModel
        Without any effect, without the last one, with it.
    """
    total = 0.0
    for noise, r0, r1, r2 in zip(after.noise, first.residuals, before.residuals, after.residuals):
        for c in range(len(CHANNELS)):
            if noise.sigma[:, c].any():
                white = noise.whiten(np.stack([r0[:, c] - r1[:, c], r1[:, c] - r2[:, c]]), c)
                others, last = np.sum(white ** 2, axis=1)
                total += max(0.0, float(last) - FORM * float(others))
    return total


def holds_beside_long_memory(before: LinearisedModel, after: LinearisedModel) -> bool:
    """Say whether :func:`long_memory_likelihood_ratio` is large enough for an effect."""
    return long_memory_likelihood_ratio(before, after) > LEAST_LONG_MEMORY_RATIO


def explains_beyond(bare: LinearisedModel, before: LinearisedModel,
                    after: LinearisedModel) -> bool:
    """Say whether :func:`beyond_mismatch` is large enough for an effect of its own."""
    return beyond_mismatch(bare, before, after) > LEAST_BEYOND


TEMPERATURE = 2.0
"""Temperature of log-likelihoods where no large effect is at stake."""

MISMATCH = 1e-3
"""Part of the energy of an effect in which two valid models of it may differ."""

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


def temperature_of(results: Sequence[HypothesisFit]) -> float:
    """Temperature of log-likelihoods beside the energy that is at stake."""
    return TEMPERATURE + min(HOTTEST, MISMATCH * max((t.evidence for t in results), default=0.0))


def weights(results: Sequence[HypothesisFit]) -> dict[str, float]:
    """
    Weigh hypotheses against the likeliest one.

    Beside large effects, likelihoods tell apart what no model gets right: the temperature rises
    with the energy at stake, and then fewer parameters count.

    Returns
    -------
    dict of str to float
        Log-odds; -inf where a hypothesis is impossible.
    """
    best = max((t.evidence for t in results), default=0.0)
    temperature = temperature_of(results)
    return {t.name: (t.evidence - best) / temperature - PARSIMONY * t.degrees
            for t in results}
