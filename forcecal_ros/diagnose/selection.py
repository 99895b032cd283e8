"""Which effects: added one by one with joint refits, dropped again, exchanged, and weighed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose.bench import Bench
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.hypotheses import Hypothesis
from forcecal_ros.diagnose.joint import Accepted, joint, joint_if_finite, misfit, without
from forcecal_ros.diagnose.memory import slow_gain
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.ranking import (
    acceptable,
    LEAST_FRACTION,
    LEAST_GAIN,
    PARSIMONY,
    ranked,
    refined_or_rejected,
    SHORTLIST,
    tempered,
    weights,
    WORTH,
)
from forcecal_ros.diagnose.remainder import cells, STRONG
from forcecal_ros.diagnose.tangent import Tangent
from forcecal_ros.diagnose.trial import Trial
from forcecal_ros.effects import EFFECTS
from forcecal_ros.recording.noise.autoregression import at_standstill
import numpy as np

NEAR = 3.0
"""Log-odds within which a rival is fitted in full."""

ALIKE = 0.97
"""Part of an effect's evidence from which a rival is, whatever the odds: evidence is linear."""

TRIES = 2
"""Rivals that are, of each effect."""

LOUD = 2.0
"""Variance of a channel, in that of its rest, from which such an effect is sought."""

DEAFENING = 1000.0
"""Variance from which one is sought so even where another passes beside the fitted noise."""

MOST_GROSS = 2
"""Effects from which none is sought that way any more."""

LEAST_GROSS_GAIN = 100.0
"""Of an effect that the noise model held for noise."""

LEAST_SLOW_GAIN = 8.0
"""Log-likelihood that it has to bring on all data where the noise may have a long memory."""

FORM = 5e-3
"""Part of it that another form of the same effect may leave in each channel."""

LEAST_BEYOND = 25.0
"""Whitened energy that a further effect has to explain beyond that."""

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
    """

    problem: Problem
    accepted: tuple[Accepted, ...]
    tangents: tuple[Tangent, ...]
    rivals: dict[str, dict[str, float]]
    screened: tuple[Trial, ...]


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
            fitted = joint_if_finite(problem, [*accepted, Accepted.of(best)], best.nuisances)
            if fitted is not None and slow_gain(problem, fitted[0]) > LEAST_SLOW_GAIN \
                    and (not others or _beyond(bare, problem, fitted[0])):
                break
            out.add(best.name)
            fitted = None
        if len(accepted) < MOST_GROSS:
            gross = _gross(problem, accepted, tangents, left, fitted[0] if fitted else None)
            if gross is not None and (not others or _beyond(bare, problem, gross[0])):
                fitted = gross
        if fitted is None:
            break
        problem, accepted, tangents = fitted
        problem, accepted, tangents = _shaped(problem, accepted, tangents)
    if len(accepted) > 1:
        problem, accepted, tangents = _drop(start, bare, problem, accepted, tangents)
    problem, accepted, tangents, rivals = _exchange(start, problem, accepted, tangents, found)
    return Selection(problem, tuple(accepted), tuple(tangents), rivals, first)


def beyond_mismatch(first: Problem, before: Problem, after: Problem) -> float:
    """
    Energy that the last effect explains beyond what a wrong form of the others may leave.

    Parameters
    ----------
    first, before, after : Problem
        Without any effect, without the last one, with it.

    Returns
    -------
    float
    """
    total = 0.0
    for noise, r0, r1, r2 in zip(after.noise, first.blocks, before.blocks, after.blocks):
        for c in range(len(CHANNELS)):
            if noise.sigma[:, c].any():
                white = noise.whiten(np.stack([r0[:, c] - r1[:, c], r1[:, c] - r2[:, c]]), c)
                others, last = np.sum(white ** 2, axis=1)
                total += max(0.0, float(last) - FORM * float(others))
    return total


def _beyond(bare: Problem, before: Problem, after: Problem) -> bool:
    return beyond_mismatch(bare, before, after) > LEAST_BEYOND


def _loudest(quiet: Problem) -> float:
    """Largest variance of a channel in that of its rest, slower than a stretch of rest too."""
    return max((float(np.mean(n.whiten(b[:, c][np.newaxis], c)[0, n.rows[:, c]] ** 2))
                for n, b in zip(quiet.noise, quiet.blocks)
                for c in range(len(CHANNELS)) if n.rows[:, c].any()), default=0.0)


def _shaped(problem: Problem, accepted: list[Accepted], tangents: list[Tangent]
            ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Give the effect accepted last the shapes that it began without, if that is better."""
    last = accepted[-1]
    for i, q in enumerate(EFFECTS[last.name].parameters):
        if len(last.theta) and q.shapes and i not in last.free:
            theta = last.theta.copy()
            theta[i] = q.starts[-1]
            other = joint_if_finite(problem, [*accepted[:-1], last._replace(
                theta=theta, free=np.sort(np.append(last.free, i)))])
            if other is not None and slow_gain(problem, other[0]) > LEAST_SLOW_GAIN:
                problem, accepted, tangents = other
                last = accepted[-1]
    return problem, accepted, tangents


def _gross(problem: Problem, accepted: Sequence[Accepted], tangents: Sequence[Tangent],
           left: Sequence[Hypothesis], other: Problem | None
           ) -> tuple[Problem, list[Accepted], list[Tangent]] | None:
    """
    Find an effect whose gap is so strong that the noise model holds it for noise.

    With the noise of rest in its place the likeliest are fitted all the way and compared; the
    best has to leave less of the gap, less than what passes beside the fitted noise, too, and to
    hold beside noise that is fitted to what it leaves.
    """
    quiet = replace(problem, noise=[at_standstill(b, n) for b, n in zip(
        problem.blocks, problem.noise)])
    loud = _loudest(quiet)
    strongest = max((cell.z for case, n, b in zip(problem.cases, problem.noise, problem.blocks)
                     for cell in cells(case, n, b)[:1]), default=0.0)
    if loud < DEAFENING and (other or (strongest < STRONG and loud < LOUD)):
        return None
    bench, by_name = Bench(quiet, tangents), {h.name: h for h in left}
    best, least = None, (1.0 - LEAST_FRACTION) * misfit(problem, quiet.noise)
    if other:
        least = min(least, misfit(other, quiet.noise))
    for trial, atom in bench.screen(left)[:SHORTLIST]:
        if not np.isfinite(trial.evidence) or trial.evidence < WORTH:
            continue
        if atom is not None:
            trial = refined_or_rejected(bench, by_name[trial.name], trial)
        if not np.isfinite(trial.evidence):
            continue
        rough = joint_if_finite(quiet, [*accepted, Accepted.of(trial)], noise_known=True)
        final = rough and joint_if_finite(rough[0], rough[1])
        if not final:
            continue
        fitted = _shaped(*final)
        left_over = misfit(fitted[0], quiet.noise)
        if left_over < least and slow_gain(problem, fitted[0]) > LEAST_GROSS_GAIN:
            best, least = fitted, left_over
    return best


def _drop(start: Problem, bare: Problem, problem: Problem, accepted: list[Accepted],
          tangents: list[Tangent]) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Take out what the others, fitted anew, explain as well but for a wrong form of theirs."""
    for a in list(accepted):
        if len(accepted) == 1:
            break
        full = Bench(problem, tangents).null_predictive
        less, rest, few = without(start, problem, accepted, a.name)
        fitted = joint(less, rest)
        worse = misfit(fitted[0], problem.noise) - misfit(problem, problem.noise)
        if Bench(less, few).null_predictive > full - LEAST_GAIN or worse < 2.0 * LEAST_GAIN \
                or not _beyond(bare, fitted[0], problem):
            problem, accepted, tangents = fitted
    return problem, accepted, tangents


def _exchange(start: Problem, problem: Problem, accepted: list[Accepted],
              tangents: list[Tangent], found: Sequence[Hypothesis]) -> tuple[
        Problem, list[Accepted], list[Tangent], dict[str, dict[str, float]]]:
    """
    Try every other effect in the place of each accepted one; keep what is better.

    An effect that brings nothing any more beside noise that is fitted with it is dropped.
    """
    rivals: dict[str, dict[str, float]] = {}
    for a in list(accepted):
        less, rest, few = without(start, problem, accepted, a.name)
        taken = {b.name for b in rest}
        bench = Bench(less, few)
        trials = ranked(bench, [h for h in found if h.name not in taken], len(found))
        weight = weights(trials)
        if next(t.evidence for t in trials if t.name == a.name) < LEAST_GAIN:
            problem, accepted, tangents = joint(less, rest) if rest else (start, [], [])
            continue
        own = weight[a.name]
        mine = next(t for t in trials if t.name == a.name)
        near = [t for t in trials if t.name != a.name and acceptable(t, len(found))
                and (weight[t.name] > own - NEAR or t.evidence > ALIKE * mine.evidence)]
        for t in near[:TRIES]:
            refitted = joint_if_finite(less, [*rest, Accepted.of(t)], t.nuisances)
            if refitted is None:
                weight[t.name] = -np.inf
                continue
            other = _shaped(*refitted)
            lead = 0.5 * (misfit(problem, problem.noise) - misfit(other[0], problem.noise))
            odds = lead / tempered(trials) - PARSIMONY * (t.degrees - mine.degrees)
            weight[t.name] = own + odds
            if odds > 0.0:
                problem, accepted, tangents = other
                mine, own = t, weight[t.name]
        now = {b.name for b in accepted}
        rivals[mine.name] = {name: float(value - own) for name, value in weight.items()
                             if name not in now and np.isfinite(value)}
    return problem, accepted, tangents, rivals
