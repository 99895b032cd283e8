"""Which effects: added one by one with joint refits, dropped again, exchanged, and weighed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.diagnose.model.effect_jacobian import Tangent
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import Problem
from forcecal_ros.diagnose.search.acceptance import (
    acceptable,
    explains_beyond,
    FORM,
    LEAST_FRACTION,
    LEAST_GAIN,
    LEAST_SLOW_GAIN,
    SHARE,
    slow_gain,
)
from forcecal_ros.diagnose.search.fitted import Accepted, Trial
from forcecal_ros.diagnose.search.joint_fit import joint, joint_if_finite, without
from forcecal_ros.diagnose.search.model_comparison import Bench
from forcecal_ros.diagnose.search.ranking import PARSIMONY, ranked, tempered, weights
from forcecal_ros.effects.nuisances import LIMIT, ROBOT
import numpy as np

NEAR = 3.0
"""Log-odds within which a rival is fitted in full."""

ALIKE = 0.8
"""
Part of an effect's evidence from which a rival is, whatever the odds.

Evidence is linear in the nuisances, taken where these stand in for the effect; so may its gain
be, which counts for nothing here. Delays of 4 and 6 ms had 0.95 and 0.91 of the evidence of the
low-pass that they were not, and a gain below 0.
"""

TRIES = 2
"""Rivals that are, of each effect."""

MOST_EFFECTS = 4
"""That are looked for at once."""


class Selection(NamedTuple):
    """
    Outcome of the search.

    Attributes
    ----------
    problem : Problem
        With the accepted effects, at the joint fit.
    accepted : tuple of Accepted
    tangents : tuple of Tangent
    rivals : dict of str to dict of str to float
        Log-odds of each hypothesis in the place of an accepted one against that one.
    screened : tuple of Trial
        The first round, best first.
    leads : dict of str to float
        Log-evidence of each accepted effect against a discrepancy in its place.
    unnamed : float
        Log-likelihood of a discrepancy, and of whatever else is left.
    wanting : float
        Log-evidence that a model without any flaw would have more.
    doubtful : dict of str to float
        The same as ``leads`` of effects that a discrepancy may only look like.
    """

    problem: Problem
    accepted: tuple[Accepted, ...]
    tangents: tuple[Tangent, ...]
    rivals: dict[str, dict[str, float]]
    screened: tuple[Trial, ...]
    leads: Mapping[str, float] = MappingProxyType({})
    unnamed: float = 0.0
    wanting: float = 0.0
    doubtful: Mapping[str, float] = MappingProxyType({})


def select(problem: Problem, found: Sequence[Hypothesis], bare: Problem) -> Selection:
    """
    Search for the effects that explain the recordings.

    Parameters
    ----------
    problem : Problem
        Recalibrated, no effect accepted.
    found : sequence of Hypothesis
    bare : Problem
        The same without what is known before any model, such as limits.

    Returns
    -------
    Selection
    """
    start = problem
    accepted: list[Accepted] = []
    tangents: list[Tangent] = []
    first: tuple[Trial, ...] = ()
    out: set[str] = set()
    while len(accepted) < MOST_EFFECTS:
        left = [h for h in found if h.name not in out | {a.name for a in accepted}]
        tested, others = sum(h.ways for h in left), accepted or problem.fixed
        trials = ranked(Bench(problem, tangents), left, tested)
        first = first or tuple(trials)
        fitted = None
        while (best := next((t for t in trials if t.name not in out
                             and acceptable(t, tested)), None)) is not None:
            fitted = joint_if_finite(replace(problem, allowed=best.discrepancy),
                                     [*accepted, Accepted.of(best)], best.nuisances)
            if fitted is not None and slow_gain(problem, fitted[0]) > LEAST_SLOW_GAIN \
                    and (not others or explains_beyond(bare, problem, fitted[0])):
                break
            out.add(best.name)
            fitted = None
        fitted = fitted or _in_full(problem, accepted, tangents, trials, out)
        if fitted is None:
            break
        problem, accepted, tangents = _settled(*_shaped(*fitted))
    if len(accepted) > 1:
        problem, accepted, tangents = _drop(start, bare, problem, accepted, tangents)
    problem, accepted, tangents, rivals, leads = _exchange(start, problem, accepted, tangents,
                                                           found)
    problem, accepted, tangents, last = _certain(start, problem, accepted, tangents, leads)
    sure = {a.name: leads[a.name] for a in accepted}
    doubtful = {name: lead for name, lead in leads.items() if name not in sure}
    return Selection(problem, tuple(accepted), tuple(tangents), rivals, first, sure,
                     last.unnamed, last.wanting, doubtful)


def _in_full(problem: Problem, accepted: list[Accepted], tangents: list[Tangent],
             trials: Sequence[Trial], out: set[str]
             ) -> tuple[Problem, list[Accepted], list[Tangent]] | None:
    """
    Fit the likeliest effect in full where the robot's own nuisances stand in for it.

    These have gone so far that what their columns say of it holds no more: its evidence shows,
    but neither what it brings on held-out data nor its share.
    """
    standing_in = any(n.key == ROBOT and abs(x) > 0.9 * LIMIT
                      for n, x in zip(problem.nuisances, problem.centre))
    best = max((t for t in trials if t.name not in out), key=lambda t: t.evidence, default=None)
    if best is None or not standing_in or best.evidence < LEAST_GAIN:
        return None
    before = Bench(problem, tangents)
    fitted = joint_if_finite(replace(problem, allowed=best.discrepancy),
                             [*accepted, Accepted.of(best)], best.nuisances)
    if fitted is None:
        return None
    after = Bench(fitted[0], fitted[2])
    explained = 1.0 - after.excess / before.excess
    return fitted if (after.null_predictive > before.null_predictive + LEAST_GAIN
                      and explained > LEAST_FRACTION) else None


def _certain(start: Problem, problem: Problem, accepted: list[Accepted],
             tangents: list[Tangent], leads: Mapping[str, float]
             ) -> tuple[Problem, list[Accepted], list[Tangent], Bench]:
    """Drop what a discrepancy as large as what is left could do as well."""
    while True:
        last = Bench(problem, tangents)
        problem, wanting = replace(problem, allowed=last.sizes), last.wanting
        # what the strongest effect leaves if its form is another is no effect of its own
        least = max([SHARE * wanting, *(FORM * leads[a.name] for a in accepted)])
        doubtful = [a for a in accepted if leads[a.name] < least]
        if not doubtful:
            return problem, accepted, tangents, last
        worst = min(doubtful, key=lambda a: leads[a.name])
        less, rest, few = without(start, problem, accepted, worst.name)
        problem, accepted, tangents = joint(less, rest) if rest else (less, [], few)


def _settled(problem: Problem, accepted: list[Accepted], tangents: list[Tangent]
             ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Fit the noise to what is left, and everything beside that noise."""
    problem.refit_noise(np.zeros(len(problem.nuisances)))
    return joint_if_finite(problem, accepted) or (problem, accepted, tangents)


def _shaped(problem: Problem, accepted: list[Accepted], tangents: list[Tangent]
            ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Give the effect accepted last the shapes that it began without, if that is better."""
    last = accepted[-1]
    for i, q in enumerate(problem.library[last.name].parameters):
        if len(last.theta) and q.shapes and i not in last.free:
            theta = last.theta.copy()
            theta[i] = q.starts[-1]
            other = joint_if_finite(problem, [*accepted[:-1], last._replace(
                theta=theta, free=np.sort(np.append(last.free, i)))])
            if other is not None and slow_gain(problem, other[0]) > LEAST_SLOW_GAIN:
                problem, accepted, tangents = other
                last = accepted[-1]
    return problem, accepted, tangents


def _drop(start: Problem, bare: Problem, problem: Problem, accepted: list[Accepted],
          tangents: list[Tangent]) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Take out what the others, fitted anew, explain as well but for a wrong form of theirs."""
    for a in list(accepted):
        if len(accepted) == 1:
            break
        full = Bench(problem, tangents).null_predictive
        less, rest, few = without(start, problem, accepted, a.name)
        fitted = joint(less, rest)
        worse = fitted[0].misfit() - problem.misfit()
        if Bench(less, few).null_predictive > full - LEAST_GAIN or worse < 2.0 * LEAST_GAIN \
                or not explains_beyond(bare, fitted[0], problem):
            problem, accepted, tangents = fitted
    return problem, accepted, tangents


def _near(trials: Sequence[Trial], name: str, tested: int) -> list[Trial]:
    """List what may do as well as an effect, both as screened and refined."""
    weight, own = weights(trials), next(t for t in trials if t.name == name)
    return [t for t in trials if t.name != name and (
        t.evidence > ALIKE * own.evidence > 0.0
        or (weight[t.name] > weight[name] - NEAR and acceptable(t, tested)))]


def _exchange(start: Problem, problem: Problem, accepted: list[Accepted],
              tangents: list[Tangent], found: Sequence[Hypothesis]) -> tuple[
        Problem, list[Accepted], list[Tangent], dict[str, dict[str, float]], dict[str, float]]:
    """
    Try every other effect in the place of each accepted one; keep what is better.

    An effect that brings nothing any more beside noise that is fitted with it is dropped.
    """
    rivals: dict[str, dict[str, float]] = {}
    leads: dict[str, float] = {}
    for a in list(accepted):
        less, rest, few = without(start, problem, accepted, a.name)
        taken = {b.name for b in rest}
        bench, standing = Bench(less, few), Bench(problem, tangents).null_evidence
        # screened anew an effect may lie far from where it was fitted to
        fitted = standing - bench.null_evidence
        anew = ranked(bench, [h for h in found if h.name not in taken], len(found))
        near = _near(anew, a.name, len(found))
        trials = [t._replace(evidence=max(t.evidence, fitted)) if t.name == a.name else t
                  for t in anew]
        weight = weights(trials)
        if next(t.evidence for t in trials if t.name == a.name) < LEAST_GAIN:
            problem, accepted, tangents = joint(less, rest) if rest else (start, [], [])
            continue
        own = weight[a.name]
        mine, degrees = next(t for t in trials if t.name == a.name), a.degrees
        for t in near[:TRIES]:
            refitted = joint_if_finite(less, [*rest, Accepted.of(t)], t.nuisances)
            if refitted is None:
                weight[t.name] = -np.inf
                continue
            other = _shaped(*refitted)
            evidence = Bench(other[0], other[2]).null_evidence
            lead = evidence - standing
            odds = lead / tempered(trials) - PARSIMONY * (t.degrees - degrees)
            weight[t.name] = own + odds
            if odds > 0.0:
                problem, accepted, tangents = other
                mine = t._replace(evidence=mine.evidence + lead)
                degrees, own, standing = t.degrees, weight[t.name], evidence
        now = {b.name for b in accepted}
        possible = {t.name for t in trials if t.evidence > LEAST_GAIN}
        leads[mine.name] = mine.evidence
        rivals[mine.name] = {name: float(value - own) for name, value in weight.items()
                             if name in possible - now and np.isfinite(value)}
    return problem, accepted, tangents, rivals, leads
