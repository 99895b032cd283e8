"""Whether another effect does as well in the place of one that was accepted, or better."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.model.hypotheses import for_a_part, Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.acceptance import (
    acceptable,
    LEAST_GAIN,
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
    shaped,
    without_effect,
)
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.diagnose.search.odds import prior_log_odds
import numpy as np

NEAR = 3.0
"""Log-odds within which an alternative is fitted in full."""

TRIES = 2
"""Alternatives of each effect that are fitted in full."""


class Exchanged(NamedTuple):
    """
    Effects, each the best in its place.

    Attributes
    ----------
    alternatives : dict of str to dict of str to float
        Log-odds of each hypothesis in the place of an effect against that one.
    log_bayes_factors : dict of str to float
        Of each effect against a discrepancy in its place.
    acts : dict of str to ndarray, shape (streams,)
        How much each explains in each stream, in the most of any.
    """

    fit: JointFit
    alternatives: dict[str, dict[str, float]]
    log_bayes_factors: dict[str, float]
    acts: dict[str, Array]


def exchange(start: LinearisedModel, now: JointFit, found: Sequence[Hypothesis],
             free: Sequence[Hypothesis]) -> Exchanged:
    """
    Try every other effect in the place of each accepted one; keep what is better.

    What has to stand at the end of its range to be better does not take the place of what has not.

    An effect that brings nothing any more beside noise that is fitted with it is dropped.

    Parameters
    ----------
    start : LinearisedModel
        Without any effect.
    found, free : sequence of Hypothesis
        What acts all the time; what may begin or end in the place of an effect that does.
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
        limited = _stands_at_bound(now.model, a)
        for t in near[:TRIES]:
            refitted = joint_fit_if_finite(less.model, [*less.accepted, Accepted.of(t)],
                                           t.nuisances)
            if refitted is None:
                weight[t.name] = -np.inf
                continue
            other = shaped(refitted)
            instead = other.comparison()
            more = instead.null_evidence - log_evidence
            odds = (more / temperature_of(results, missing) - PARSIMONY * (t.degrees - degrees)
                    + prior_log_odds(t.name, missing) - prior_log_odds(mine.name, missing))
            weight[t.name] = own + odds
            at_bound = _stands_at_bound(other.model, other.accepted[-1])
            if odds > 0.0 and (limited or not at_bound):
                now, limited = _pruned(other), at_bound
                mine = t._replace(evidence=mine.evidence + more)
                degrees, own, log_evidence = t.degrees, weight[t.name], instead.null_evidence
                whole = instead
        names = {b.name for b in now.accepted}
        possible = {t.name for t in results if t.evidence > LEAST_GAIN}
        factors[mine.name] = mine.evidence
        acts[mine.name] = _acts(comparison, whole)
        alternatives[mine.name] = {name: float(value - own) for name, value in weight.items()
                                   if name in possible - names and np.isfinite(value)}
    return Exchanged(now, alternatives, factors, acts)


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


def _stands_at_bound(model: LinearisedModel, a: Accepted) -> bool:
    """Say whether a size of an effect is as large as it can be."""
    return any(not q.shapes and value != q.nominal and value in (q.low, q.high)
               for q, value in zip(model.library[a.name].parameters, a.theta))


def _pruned(now: JointFit) -> JointFit:
    """Forget when effects would act that are not there."""
    gates = {n: g for n, g in now.model.gates.items() if n in now.model.effects}
    return now._replace(model=replace(now.model, gates=gates))


def _acts(without: ModelComparison, whole: ModelComparison) -> Array:
    """Return how much an effect explains in each stream, in the most of any."""
    gained = np.maximum(without.unexplained - whole.unexplained, 0.0)
    return gained / gained.max() if gained.any() else np.ones(len(gained))
