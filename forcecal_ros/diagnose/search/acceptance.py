"""What an effect has to bring to be accepted, and which hypothesis is likeliest."""

from collections.abc import Callable, Iterator, Sequence

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import unpredicted
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import Diverged, LinearisedModel
from forcecal_ros.diagnose.search.fitted import HypothesisFit
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.diagnose.search.odds import prior_log_odds
import numpy as np
from numpy.typing import NDArray

SIMILAR = 0.8
"""
Part of an effect's evidence from which an alternative is fitted in full, whatever the odds.

Evidence is linear in the nuisances, taken where these stand in for the effect; so may its gain
be, which counts for nothing here. Delays of 4 and 6 ms had 0.95 and 0.91 of the evidence of the
low-pass that they were not, and a gain below 0.
"""

SIGNIFICANT = 0.01
"""Family-wise error of a round of hypotheses (Holm's first step)."""

LEAST_GAIN = 3.0
"""Log-likelihood of held-out blocks that an effect has to gain."""

LEAST_FRACTION = 0.05
"""Lower bound of the above-noise energy that an effect has to explain."""

MOST_OF_IT = 0.5
"""
The same, of which nuisances could do much as well: half of all that is wrong is no chance. A drift
of 37 times its background, nearly all that was wrong, had less than LEAST_FRACTION without them.
"""

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
    return _likelihood_ratio(before, after, unpredicted)


def of_slow_noise(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood that is gained by following noise whose memory is long, and by that alone.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with what follows it.
    """
    def squares(white: Array, rows: NDArray[np.bool_]) -> float:
        return float(np.sum(white[rows] ** 2))

    return max(0.0, _likelihood_ratio(before, after, squares)
               - long_memory_likelihood_ratio(before, after))


def held_out_likelihood_ratio(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood of the held-out blocks that is gained, noise as it is.

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with what was fitted to the training blocks.
    """
    total = 0.0
    for i, rows, white in _whitened(after, before.residuals, after.residuals):
        squares = np.sum(white[:, rows & after.datasets[i].held] ** 2, axis=1)
        total += 0.5 * float(squares[0] - squares[1])
    return total


def _whitened(model: LinearisedModel, *residuals: Sequence[Array]
              ) -> Iterator[tuple[int, NDArray[np.bool_], Array]]:
    """
    Whiten residuals of each recording and channel by a model's noise, where they differ.

    Yields
    ------
    recording : int
    rows : ndarray of bool, shape (n,)
        Samples that count.
    white : ndarray, shape (residuals, n)
    """
    for i, (noise, *own) in enumerate(zip(model.noise, *residuals)):
        for c in range(len(CHANNELS)):
            rows = noise.rows[:, c] & noise.sigma[noise.groups, c].astype(bool)
            stack = np.stack([one[:, c] for one in own])
            if rows.any() and not (stack == stack[0]).all():
                yield i, rows, noise.whiten(stack, c)


def _likelihood_ratio(before: LinearisedModel, after: LinearisedModel,
                      unexplained: Callable[[Array, NDArray[np.bool_]], float]) -> float:
    """Compare whitened residuals by the squares of each channel that remain unexplained."""
    total = 0.0
    for _, rows, white in _whitened(after, before.residuals, after.residuals):
        rests = [unexplained(w, rows) for w in white]
        total += 0.5 * int(rows.sum()) * float(np.log(rests[0] / rests[1]))
    return total


def least_evidence(missing_evidence: float, log_bayes_factors: Sequence[float]) -> float:
    """
    Return the log-evidence that an effect has to bring against a discrepancy in its place.

    Parameters
    ----------
    missing_evidence : float
        That a model without any flaw would have more.
    log_bayes_factors : sequence of float
        Of the accepted effects: what the strongest leaves if its form is another is no effect.
    """
    return max([SHARE * missing_evidence, *(FORM * factor for factor in log_bayes_factors)])


def acceptable(result: HypothesisFit, tested: int) -> bool:
    """Say whether a fitted hypothesis passes significance, gain, fraction and size."""
    enough = result.fraction > LEAST_FRACTION or result.fraction_along > MOST_OF_IT
    return (result.gain > LEAST_GAIN and result.p * tested < SIGNIFICANT and enough
            and result.size > 1.0)


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
    for _, _, white in _whitened(after, first.residuals, before.residuals, after.residuals):
        others, last = np.sum(np.diff(white, axis=0) ** 2, axis=1)
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
    with the energy at stake, and then fewer parameters count; and so does how much of what no
    library has looks like them, where something is missing.

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
            + prior_log_odds(t.name, missing) for t in results}
