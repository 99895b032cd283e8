"""Which hypothesis is likeliest, and which is worth accepting."""

from collections.abc import Sequence

from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import Diverged
from forcecal_ros.diagnose.search.acceptance import acceptable
from forcecal_ros.diagnose.search.fitted import Trial
from forcecal_ros.diagnose.search.model_comparison import Bench
import numpy as np

TEMPERATURE = 2.0
"""Of log-likelihoods."""

MISMATCH = 1e-3
"""Part of the energy of an effect in which two sound models of it may differ."""

HOTTEST = 400.0
"""
Most that the temperature grows by: beyond it a discrepancy takes up what a model has wrong.

A crosstalk of 5 and of 10 % led a drift by 1600 and 6700, which has to decide.
"""

PARSIMONY = 0.5
"""Log-odds that each parameter costs besides."""

SHORTLIST = 3
"""Hypotheses that are refined in each round."""

WORTH = 2.0
"""Evidence of the linear screen from which the best are refined whatever their rank."""

CLOSE = 0.5
"""Fraction of the best gain from which a hypothesis is refined as well."""


def ranked(bench: Bench, found: Sequence[Hypothesis], tested: int) -> list[Trial]:
    """Screen hypotheses, refine the best, and return all trials, likeliest first."""
    screened = bench.screen(found)
    by_name = {h.name: h for h in found}
    best = max((t.evidence for t, _ in screened), default=0.0)
    out, refined = [], 0
    for trial, atom in screened:
        promising = trial.evidence > CLOSE * best and np.isfinite(trial.evidence)
        promising |= refined < SHORTLIST and trial.evidence > WORTH
        if atom is not None and promising and trial.gain > 1.0 and refined < 2 * SHORTLIST:
            refined += 1
            better = refined_or_rejected(bench, by_name[trial.name], trial)
            if better.evidence > trial.evidence or acceptable(better, tested) \
                    or not np.isfinite(better.evidence):
                trial = better
        out.append(trial)
    weight = weights(out)
    return sorted(out, key=lambda t: -weight[t.name])


def refined_or_rejected(bench: Bench, hypothesis: Hypothesis, trial: Trial) -> Trial:
    """Refine a trial; where its simulation diverges it is impossible."""
    try:
        return bench.refine(hypothesis, trial)
    except Diverged:
        return trial._replace(gain=-np.inf, evidence=-np.inf)


def tempered(trials: Sequence[Trial]) -> float:
    """Temperature of log-likelihoods beside the energy that is at stake."""
    return TEMPERATURE + min(HOTTEST, MISMATCH * max((t.evidence for t in trials), default=0.0))


def weights(trials: Sequence[Trial]) -> dict[str, float]:
    """
    Weigh hypotheses against the likeliest one.

    Beside gross effects, likelihoods tell apart what no model gets right: they are tempered by
    the energy at stake, and then fewer parameters count.

    Parameters
    ----------
    trials : sequence of Trial

    Returns
    -------
    dict of str to float
        Log-odds; -inf where a hypothesis is impossible.
    """
    best = max((t.evidence for t in trials), default=0.0)
    temperature = tempered(trials)
    return {t.name: (t.evidence - best) / temperature - PARSIMONY * t.degrees
            for t in trials}
