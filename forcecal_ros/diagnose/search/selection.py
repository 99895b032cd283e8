"""Which effects: added one by one with joint refits, dropped again, exchanged, and weighed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.hypotheses import EffectJacobian, Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.model.scales import NO_DISCREPANCY
from forcecal_ros.diagnose.search.acceptance import (
    acceptable,
    explains_beyond,
    holds_beside_long_memory,
    least_evidence,
    LEAST_FRACTION,
    LEAST_GAIN,
    ranked,
    weights,
)
from forcecal_ros.diagnose.search.exchange import exchange, Exchanged
from forcecal_ros.diagnose.search.fitted import Accepted, HypothesisFit
from forcecal_ros.diagnose.search.joint_fit import (
    joint_fit,
    joint_fit_if_finite,
    JointFit,
    shaped,
    without_effect,
)
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.diagnose.search.odds import log_odds
from forcecal_ros.effects.nuisances import LIMIT, ROBOT
import numpy as np

MOST_EFFECTS = 4
"""Effects that are searched for in one diagnosis."""


class Selection(NamedTuple):
    """
    Outcome of the search.

    Attributes
    ----------
    model : LinearisedModel
        With the accepted effects, at the joint fit.
    alternatives : dict of str to dict of str to float
        Log-odds of each hypothesis in the place of an accepted one against that one.
    log_bayes_factors : dict of str to float
        Of each accepted effect against a discrepancy in its place.
    discrepancy_evidence : float
        Log-likelihood of a discrepancy, and of whatever else is unexplained.
    missing_evidence : dict of str to float
        Log-evidence that a model without any flaw would have more, of each accepted or doubtful
        effect in the streams in which it acts.
    missing_by_stream : ndarray, shape (streams,)
        The same in each stream.
    doubtful : dict of str to float
        The same as ``log_bayes_factors`` of effects that a discrepancy may only look like.
    """

    model: LinearisedModel
    accepted: tuple[Accepted, ...]
    jacobians: tuple[EffectJacobian, ...]
    alternatives: dict[str, dict[str, float]]
    log_bayes_factors: Mapping[str, float] = MappingProxyType({})
    discrepancy_evidence: float = 0.0
    missing_evidence: Mapping[str, float] = MappingProxyType({})
    missing_by_stream: Array = np.zeros(len(STREAM_SLICES))
    doubtful: Mapping[str, float] = MappingProxyType({})

    @property
    def beside_discrepancy(self) -> bool:
        """Whether the effects were weighed beside a discrepancy."""
        return self.model.discrepancy_scales != NO_DISCREPANCY


def select(model: LinearisedModel, found: Sequence[Hypothesis], bare: LinearisedModel,
           free: Sequence[Hypothesis] = (), begin: JointFit | None = None) -> Selection:
    """
    Search for the effects that explain the recordings.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated, no effect accepted.
    bare : LinearisedModel
        The same without what is known before any model, such as limits.
    free : sequence of Hypothesis
        What may begin or end in the place of an effect that does.
    begin : JointFit, optional
        Effects to search from; none is accepted unless they are given.
    """
    start, now = model, begin or JointFit(model, [], [])
    out: set[str] = set()
    while len(now.accepted) < MOST_EFFECTS:
        untried = [h for h in found if h.name not in out | {a.name for a in now.accepted}]
        tested, others = sum(h.ways for h in untried), now.accepted or now.model.fixed
        results = ranked(now.comparison(), untried, tested)
        fitted = None
        while (best := next((t for t in results if t.name not in out
                             and acceptable(t, tested)), None)) is not None:
            fitted = _with(now, best)
            if fitted is not None and holds_beside_long_memory(now.model, fitted.model) \
                    and (not others or explains_beyond(bare, now.model, fitted.model)):
                break
            out.add(best.name)
            fitted = None
        fitted = fitted or _in_full(now, results, out)
        if fitted is None:
            break
        now = _refitted(shaped(fitted))
    if len(now.accepted) > 1:
        now = _drop(start, bare, now)
    exchanged = exchange(start, now, found, free)
    now, last = _certain(start, exchanged)
    factors = exchanged.log_bayes_factors
    sure = {a.name: factors[a.name] for a in now.accepted}
    doubtful = {name: factor for name, factor in factors.items() if name not in sure}
    return Selection(now.model, tuple(now.accepted), tuple(now.jacobians), exchanged.alternatives,
                     sure, last.discrepancy_evidence, _missing(last, exchanged.acts),
                     last.missing_by_stream, doubtful)


def nearest(selection: Selection, found: Sequence[Hypothesis]) -> dict[str, float]:
    """
    Weigh what comes closest to explaining recordings in which no effect was accepted.

    Parameters
    ----------
    found : sequence of Hypothesis
        All that was tried.

    Returns
    -------
    dict of str to float
        Log-odds of each against the likeliest.
    """
    comparison = JointFit(selection.model, [], []).comparison()
    results = ranked(comparison, found, sum(h.ways for h in found))
    weight = weights(results, comparison.missing_evidence)
    return {t.name: weight[t.name] for t in results
            if t.evidence > LEAST_GAIN and t.name not in selection.doubtful}


def _with(now: JointFit, best: HypothesisFit) -> JointFit | None:
    """Accept one more effect and refit; nothing where a simulation diverges."""
    return joint_fit_if_finite(replace(now.model, discrepancy_scales=best.discrepancy),
                               [*now.accepted, Accepted.of(best)], best.nuisances)


def _in_full(now: JointFit, results: Sequence[HypothesisFit], out: set[str]) -> JointFit | None:
    """
    Fit the likeliest effect in full where the robot's own nuisances stand in for it.

    These have gone so far that what their columns say of it holds no more: its evidence shows,
    but neither what it brings on held-out data nor its share.
    """
    standing_in = any(n.key == ROBOT and abs(x) > 0.9 * LIMIT
                      for n, x in zip(now.model.nuisances, now.model.centre))
    best = max((t for t in results if t.name not in out), key=lambda t: t.evidence, default=None)
    if best is None or not standing_in or best.evidence < LEAST_GAIN:
        return None
    before = now.comparison()
    fitted = _with(now, best)
    if fitted is None:
        return None
    after = fitted.comparison()
    explained = 1.0 - after.excess / before.excess
    return fitted if (after.null_predictive > before.null_predictive + LEAST_GAIN
                      and explained > LEAST_FRACTION) else None


def _missing(comparison: ModelComparison, acts: Mapping[str, Array]) -> dict[str, float]:
    """Return the evidence that is missing in the streams in which each effect acts."""
    return {name: float(weight @ comparison.missing_by_stream) for name, weight in acts.items()}


def _certain(start: LinearisedModel, exchanged: Exchanged) -> tuple[JointFit, ModelComparison]:
    """Drop what a discrepancy as large as what is unexplained, or another, could do as well."""
    now, _, factors, acts = exchanged
    while True:
        last = now.comparison()
        now = now._replace(model=replace(now.model, discrepancy_scales=last.scales))
        shown = {a.name: factors[a.name] for a in now.accepted}
        missing, found = _missing(last, acts), list(shown.values())
        doubtful = [a for a in now.accepted
                    if factors[a.name] < least_evidence(missing[a.name], found)
                    or (factors[a.name] < max(shown.values())
                        and last.scales != NO_DISCREPANCY
                        and log_odds(a.name, shown, missing[a.name]) < 0.0)]
        if not doubtful:
            return now, last
        worst = min(doubtful, key=lambda a: factors[a.name])
        less = without_effect(start, now, worst.name)
        now = joint_fit(less.model, less.accepted) if less.accepted else less


def _refitted(now: JointFit) -> JointFit:
    """Fit the noise to the residual, and everything beside that noise."""
    now.model.refit_noise(np.zeros(len(now.model.nuisances)))
    return joint_fit_if_finite(now.model, now.accepted) or now


def _drop(start: LinearisedModel, bare: LinearisedModel, now: JointFit) -> JointFit:
    """Take out what the others, fitted anew, explain as well but for a wrong form of theirs."""
    full = now.comparison()
    for a in list(now.accepted):
        if len(now.accepted) == 1:
            break
        less = without_effect(start, now, a.name)
        fitted = joint_fit(less.model, less.accepted)
        # evidence, not squares: a discrepancy that grows in its place takes up what it explained
        without = fitted.comparison()
        if less.comparison().null_predictive > full.null_predictive - LEAST_GAIN \
                or without.null_evidence > full.null_evidence - LEAST_GAIN \
                or not explains_beyond(bare, fitted.model, now.model):
            now, full = fitted, without
    return now
