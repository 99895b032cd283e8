"""Which effects: added one by one with joint refits, dropped again, exchanged, and weighed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.diagnose.inputs.channels import STREAM_SLICES
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.hypotheses import EffectJacobian, for_a_part, Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.acceptance import (
    acceptable,
    explains_beyond,
    holds_beside_long_memory,
    least_evidence,
    LEAST_FRACTION,
    LEAST_GAIN,
    log_odds,
    PARSIMONY,
    ranked,
    SIMILAR,
    temperature_of,
    weights,
)
from forcecal_ros.diagnose.search.fitted import Accepted, HypothesisFit
from forcecal_ros.diagnose.search.joint_fit import (
    joint_fit,
    joint_fit_if_finite,
    JointFit,
    without_effect,
)
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.effects.nuisances import LIMIT, ROBOT
from forcecal_ros.geometry import Array
import numpy as np

NEAR = 3.0
"""Log-odds within which an alternative is fitted in full."""

TRIES = 2
"""Alternatives of each effect that are fitted in full."""

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


def select(model: LinearisedModel, found: Sequence[Hypothesis], bare: LinearisedModel,
           free: Sequence[Hypothesis] = ()) -> Selection:
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
    """
    start, now = model, JointFit(model, [], [])
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
        now = _refitted(_shaped(fitted))
    if len(now.accepted) > 1:
        now = _drop(start, bare, now)
    now, alternatives, factors, acts = _exchange(start, now, found, free)
    now, last = _certain(start, now, factors, acts)
    sure = {a.name: factors[a.name] for a in now.accepted}
    doubtful = {name: factor for name, factor in factors.items() if name not in sure}
    return Selection(now.model, tuple(now.accepted), tuple(now.jacobians), alternatives, sure,
                     last.discrepancy_evidence, _missing(last, acts), last.missing_by_stream,
                     doubtful)


def nearest(selection: Selection, found: Sequence[Hypothesis], least: float = LEAST_GAIN
            ) -> dict[str, float]:
    """
    Weigh what comes closest to explaining recordings in which no effect was accepted.

    Parameters
    ----------
    found : sequence of Hypothesis
        All that was tried.
    least : float
        Log-evidence that one has to gain.

    Returns
    -------
    dict of str to float
        Log-odds of each against the likeliest.
    """
    comparison = JointFit(selection.model, [], []).comparison()
    results = ranked(comparison, found, sum(h.ways for h in found))
    weight = weights(results, comparison.missing_evidence)
    return {t.name: weight[t.name] for t in results
            if t.evidence > least and t.name not in selection.doubtful}


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
    """Return what is missing where each effect acts: of an arm's motion it is no wrench's."""
    return {name: float(weight @ comparison.missing_by_stream) for name, weight in acts.items()}


def _acts(without: ModelComparison, whole: ModelComparison) -> Array:
    """Return how much an effect explains in each stream, in the most of any."""
    gained = np.maximum(without.unexplained - whole.unexplained, 0.0)
    return gained / gained.max() if gained.any() else np.ones(len(gained))


def _certain(start: LinearisedModel, now: JointFit, factors: Mapping[str, float],
             acts: Mapping[str, Array]) -> tuple[JointFit, ModelComparison]:
    """Drop what a discrepancy as large as what is unexplained, or another, could do as well."""
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


def _shaped(now: JointFit) -> JointFit:
    """Give the effect accepted last the shapes that it began without, if that is better."""
    last = now.accepted[-1]
    for i, q in enumerate(now.model.library[last.name].parameters):
        if len(last.theta) and q.shapes and i not in last.free:
            theta = last.theta.copy()
            theta[i] = q.starts[-1]
            other = joint_fit_if_finite(now.model, [*now.accepted[:-1], last._replace(
                theta=theta, free=np.sort(np.append(last.free, i)))])
            if other is not None and holds_beside_long_memory(now.model, other.model):
                now, last = other, other.accepted[-1]
    return now


def _drop(start: LinearisedModel, bare: LinearisedModel, now: JointFit) -> JointFit:
    """Take out what the others, fitted anew, explain as well but for a wrong form of theirs."""
    full = now.comparison()
    for a in list(now.accepted):
        if len(now.accepted) == 1:
            break
        less = without_effect(start, now, a.name)
        fitted = joint_fit(less.model, less.accepted)
        # evidence, not squares: a discrepancy that grows in its place takes up what it explained
        if less.comparison().null_predictive > full.null_predictive - LEAST_GAIN \
                or fitted.comparison().null_evidence > full.null_evidence - LEAST_GAIN \
                or not explains_beyond(bare, fitted.model, now.model):
            now, full = fitted, fitted.comparison()
    return now


def _near(results: Sequence[HypothesisFit], name: str, tested: int) -> list[HypothesisFit]:
    """List what may do as well as an effect, both as screened and refined."""
    weight, own = weights(results), next(t for t in results if t.name == name)
    return [t for t in results if t.name != name and (
        t.evidence > SIMILAR * own.evidence > 0.0
        or (weight[t.name] > weight[name] - NEAR and acceptable(t, tested)))]


def _in_its_place(less: JointFit, found: Sequence[Hypothesis], free: Sequence[Hypothesis],
                  name: str) -> tuple[JointFit, list[Hypothesis]]:
    """Return what may stand in the place of an effect: of one that begins what begins with it."""
    model, taken = less.model, {a.name for a in less.accepted}
    if name not in model.gates:
        return less, [h for h in found if h.name not in taken]
    gate = model.gates[name]
    others = [for_a_part(model, h, gate) for h in free if h.name not in taken]
    gates = {**{h.name: gate for h in others},
             **{n: model.gates[n] for n in taken if n in model.gates}}
    return less._replace(model=replace(model, gates=gates)), others


def _pruned(now: JointFit) -> JointFit:
    """Forget when effects would act that are not there."""
    gates = {n: g for n, g in now.model.gates.items() if n in now.model.effects}
    return now._replace(model=replace(now.model, gates=gates))


def _exchange(start: LinearisedModel, now: JointFit, found: Sequence[Hypothesis],
              free: Sequence[Hypothesis]
              ) -> tuple[JointFit, dict[str, dict[str, float]], dict[str, float],
                         dict[str, Array]]:
    """
    Try every other effect in the place of each accepted one; keep what is better.

    An effect that brings nothing any more beside noise that is fitted with it is dropped. Returns
    the alternatives' log-odds, and the log Bayes factors, of :class:`Selection`, and how much each
    explains in each stream.
    """
    alternatives: dict[str, dict[str, float]] = {}
    factors: dict[str, float] = {}
    acts: dict[str, Array] = {}
    for a in list(now.accepted):
        less = without_effect(start, now, a.name)
        less, options = _in_its_place(less, found, free, a.name)
        comparison = less.comparison()
        whole = now.comparison()
        log_evidence, missing = whole.null_evidence, whole.missing_evidence
        # screened anew an effect may lie far from where it was fitted to
        fitted = log_evidence - comparison.null_evidence
        anew = ranked(comparison, options, len(found))
        near = _near(anew, a.name, len(found))
        results = [t._replace(evidence=max(t.evidence, fitted)) if t.name == a.name else t
                   for t in anew]
        weight = weights(results, missing)
        if next(t.evidence for t in results if t.name == a.name) < LEAST_GAIN:
            now = (joint_fit(less.model, less.accepted) if less.accepted
                   else JointFit(start, [], []))
            continue
        own = weight[a.name]
        mine, degrees = next(t for t in results if t.name == a.name), a.degrees
        for t in near[:TRIES]:
            refitted = joint_fit_if_finite(less.model, [*less.accepted, Accepted.of(t)],
                                           t.nuisances)
            if refitted is None:
                weight[t.name] = -np.inf
                continue
            other = _shaped(refitted)
            instead = other.comparison()
            more = instead.null_evidence - log_evidence
            odds = more / temperature_of(results, missing) - PARSIMONY * (t.degrees - degrees)
            weight[t.name] = own + odds
            if odds > 0.0:
                now = _pruned(other)
                mine = t._replace(evidence=mine.evidence + more)
                degrees, own, log_evidence = t.degrees, weight[t.name], instead.null_evidence
                whole = instead
        names = {b.name for b in now.accepted}
        possible = {t.name for t in results if t.evidence > LEAST_GAIN}
        factors[mine.name] = mine.evidence
        acts[mine.name] = _acts(comparison, whole)
        alternatives[mine.name] = {name: float(value - own) for name, value in weight.items()
                                   if name in possible - names and np.isfinite(value)}
    return now, alternatives, factors, acts
