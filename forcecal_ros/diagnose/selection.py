"""Which effects: added one by one with joint refits, dropped again, exchanged, and weighed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.columns import gram
from forcecal_ros.diagnose.hypotheses import bounds_of, Hypothesis, values_of
from forcecal_ros.diagnose.memory import slow_gain
from forcecal_ros.diagnose.noise import Noise, resting
from forcecal_ros.diagnose.nuisances import LIMIT
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.remainder import cells, STRONG
from forcecal_ros.diagnose.trial import Bench, Tangent, tangent, Trial
from forcecal_ros.geometry import Array
from forcecal_ros.sim.effects import EFFECTS
import numpy as np
from numpy.typing import NDArray

NEAR = 3.0
"""Log-odds within which a rival is fitted in full."""

ALIKE = 0.97
"""Part of an effect's evidence from which a rival is, whatever the odds: evidence is linear."""

TRIES = 2
"""Rivals that are, of each effect."""

SIGNIFICANT = 0.01
"""Family-wise error of a round (Holm's first step)."""

LEAST_GAIN = 3.0
"""Held-out log-likelihood that an effect has to bring."""

LOUD = 2.0
"""Variance of a channel, in that of its rest, from which such an effect is sought."""

MOST_GROSS = 2
"""Effects from which none is sought that way any more."""

LEAST_GROSS_GAIN = 100.0
"""Of an effect that the noise model held for noise."""

LEAST_SLOW_GAIN = 8.0
"""Log-likelihood that it has to bring on all data where the noise may have a long memory."""

MISMATCH = 1e-3
"""Part of the energy of an effect in which two sound models of it may differ."""

FORM = 5e-3
"""Part of it that another form of the same effect may leave in each channel."""

LEAST_BEYOND = 25.0
"""Whitened energy that a further effect has to explain beyond that."""

TEMPERATURE = 2.0
"""Of log-likelihoods."""

PARSIMONY = 0.5
"""Log-odds that each parameter costs besides."""

LEAST_FRACTION = 0.05
"""Of the above-noise energy, its lower bound."""

NEGLIGIBLE = 0.05
"""RMS of a difference, in noise RMS of every channel and kind of motion, that is no gap."""

MOST_EFFECTS = 4
"""That are looked for at once."""

SHORTLIST = 3
"""Hypotheses that are refined in each round."""

WORTH = 2.0
"""Evidence of the linear screen from which the best are refined whatever their rank."""

CLOSE = 0.5
"""Fraction of the best gain from which a hypothesis is refined as well."""


ROUNDS = 3
"""Gauss-Newton steps of a joint refit."""

FAR = 2.0
"""Step of the nuisances, in spreads, after which their columns are taken anew."""

SHORTEST = 0.02
"""Fraction of such a step below which it is given up."""


class Accepted(NamedTuple):
    """
    One accepted effect.

    Attributes
    ----------
    name : str
    theta, std : ndarray, shape (p,)
        Empty where the effect is a released nuisance.
    free : ndarray of int
        Which of them are estimated.
    released : frozenset of str
    trial : Trial
        At its acceptance.
    """

    name: str
    theta: Array
    std: Array
    free: NDArray[np.intp]
    released: frozenset[str]
    trial: Trial

    @classmethod
    def of(cls, trial: Trial) -> 'Accepted':
        """Accept a trial."""
        return cls(trial.name, trial.theta, trial.std, trial.free, trial.released, trial)


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


def acceptable(trial: Trial, tested: int) -> bool:
    """Say whether a trial passes significance, gain, fraction and size."""
    return (trial.gain > LEAST_GAIN and trial.p * tested < SIGNIFICANT
            and trial.fraction > LEAST_FRACTION and trial.size > NEGLIGIBLE)


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
            better = bench.refine(by_name[trial.name], trial)
            if better.evidence > trial.evidence or acceptable(better, tested):
                trial = better
        out.append(trial)
    weight = weights(out)
    return sorted(out, key=lambda t: -weight[t.name])


def tempered(trials: Sequence[Trial]) -> float:
    """Temperature of log-likelihoods beside the energy that is at stake."""
    return TEMPERATURE + MISMATCH * max((t.evidence for t in trials), default=0.0)


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


def select(problem: Problem, found: Sequence[Hypothesis]) -> Selection:
    """
    Search for the effects that explain the recordings.

    Parameters
    ----------
    problem : Problem
        Recalibrated, no effect accepted.
    found : sequence of Hypothesis

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
        tested = sum(h.ways for h in left)
        trials = ranked(Bench(problem, tangents), left, tested)
        first = first or tuple(trials)
        while (best := next((t for t in trials if t.name not in out
                             and acceptable(t, tested)), None)) is not None:
            fitted = joint(problem, [*accepted, Accepted.of(best)], best.nuisances)
            if slow_gain(problem, fitted[0]) > LEAST_SLOW_GAIN and (
                    not accepted or beyond_mismatch(start, problem, fitted[0]) > LEAST_BEYOND):
                problem, accepted, tangents = fitted
                break
            out.add(best.name)
        if best is None:
            gross = _gross(problem, accepted, tangents, left) \
                if len(accepted) < MOST_GROSS else None
            if gross is None or accepted \
                    and beyond_mismatch(start, problem, gross[0]) < LEAST_BEYOND:
                break
            problem, accepted, tangents = gross
        problem, accepted, tangents = _shaped(problem, accepted, tangents)
    if len(accepted) > 1:
        problem, accepted, tangents = _drop(start, problem, accepted, tangents)
    problem, accepted, tangents, rivals = _exchange(start, problem, accepted, tangents, found)
    return Selection(problem, tuple(accepted), tuple(tangents), rivals, first)


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
            other = joint(problem, [*accepted[:-1], last._replace(
                theta=theta, free=np.sort(np.append(last.free, i)))])
            if slow_gain(problem, other[0]) > LEAST_SLOW_GAIN:
                problem, accepted, tangents = other
                last = accepted[-1]
    return problem, accepted, tangents


def _gross(problem: Problem, accepted: Sequence[Accepted], tangents: Sequence[Tangent],
           left: Sequence[Hypothesis]
           ) -> tuple[Problem, list[Accepted], list[Tangent]] | None:
    """
    Find an effect whose gap is so strong that the noise model holds it for noise.

    With the noise of rest in its place the likeliest are fitted all the way and compared; the
    best has to leave less of the gap, and to hold beside noise that is fitted to what it leaves.
    """
    strongest = max(cells(case, n, b)[0].z for case, n, b in zip(
        problem.cases, problem.noise, problem.blocks))
    quiet = replace(problem, noise=[resting(b, n) for b, n in zip(
        problem.blocks, problem.noise)])
    if strongest < STRONG and _loudest(quiet) < LOUD:
        return None
    bench, by_name = Bench(quiet, tangents), {h.name: h for h in left}
    best, least = None, (1.0 - LEAST_FRACTION) * _misfit(problem, quiet.noise)
    for trial, atom in bench.screen(left)[:SHORTLIST]:
        if not np.isfinite(trial.evidence) or trial.evidence < WORTH:
            continue
        if atom is not None:
            trial = bench.refine(by_name[trial.name], trial)
        rough = joint(quiet, [*accepted, Accepted.of(trial)], noise_known=True)
        fitted = joint(rough[0], rough[1])
        misfit = _misfit(fitted[0], quiet.noise)
        if misfit < least and slow_gain(problem, fitted[0]) > LEAST_GROSS_GAIN:
            best, least = fitted, misfit
    return best


def joint(problem: Problem, accepted: Sequence[Accepted], step: Array | None = None,
          noise_known: bool = False) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """
    Refit accepted effects, nuisances and noise together.

    Parameters
    ----------
    problem : Problem
    accepted : sequence of Accepted
    step : ndarray, shape (m,), optional
        Of the nuisances, to begin with.
    noise_known : bool
        Whether the noise stays as it is until the end, for more rounds.

    Returns
    -------
    problem : Problem
    accepted : list of Accepted
    tangents : list of Tangent
    """
    released = frozenset(n for a in accepted for n in a.released)
    out = replace(problem, released=released, effects=_effects(accepted),
                  centre=problem.centre + (0.0 if step is None else step))
    m, now = len(problem.nuisances), list(accepted)
    if released != problem.released:
        out.linearise()
    else:
        out.settle()
    tangents: list[Tangent] = []
    for _ in range(3 * ROUNDS if noise_known else ROUNDS):
        tangents = [_tangent(out, a) for a in now if len(a.theta)]
        if not noise_known:
            out.refit_noise(np.zeros(m))
        bench = Bench(out, tangents)
        before, fraction = out.standing(), 1.0
        while fraction > SHORTEST:
            moved = _moved(now, tangents, bench, fraction)
            tried = replace(out, centre=out.centre + fraction * bench.null.x[:m],
                            effects=_effects(moved))
            tried.settle()
            if tried.standing() > before - 0.1:
                out, now = tried, moved
                break
            fraction *= 0.3
        step = np.abs(bench.null.x)
        if fraction <= SHORTEST \
                or step[m:].max(initial=0.0) < 1e-3 and step[:m].max(initial=0.0) < 0.1:
            break
        if released and step[:m].max() > FAR:
            out.linearise()
    out.refit_noise(np.zeros(m))
    return out, now, tangents


def _moved(accepted: Sequence[Accepted], tangents: Sequence[Tangent], bench: Bench,
           fraction: float) -> list[Accepted]:
    """Go a fraction of the way to the best parameters of all accepted effects."""
    by_name = {t.name: t for t in tangents}
    x, variance = bench.null.x, np.diag(bench.null.covariance)
    position, out = len(bench.problem.nuisances), []
    for a in accepted:
        if len(a.theta):
            part, units = slice(position, position + len(a.free)), by_name[a.name].units
            low, high = bounds_of(EFFECTS[a.name])
            theta, std = a.theta.copy(), np.zeros(len(a.theta))
            theta[a.free] += fraction * x[part] * units
            std[a.free] = units * np.sqrt(variance[part])
            a = a._replace(theta=np.clip(theta, low, high), std=std)
            position += len(a.free)
        out.append(a)
    return out


def _effects(accepted: Sequence[Accepted]) -> dict[str, dict[str, float]]:
    return {a.name: values_of(EFFECTS[a.name], a.theta) for a in accepted if len(a.theta)}


def _tangent(problem: Problem, a: Accepted) -> Tangent:
    return tangent(problem, a.name, a.theta, a.free, problem.blocks,
                   range(len(problem.cases)))


def _without(start: Problem, problem: Problem, accepted: Sequence[Accepted], name: str
             ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """Take one effect out; noise stays as it is, nuisances are fitted anew."""
    rest = [a for a in accepted if a.name != name]
    if not rest:
        return replace(start, noise=problem.noise), [], []
    released = frozenset(n for a in rest for n in a.released)
    bound = np.array([np.inf if n.name in released else LIMIT for n in problem.nuisances])
    out = replace(problem, released=released, effects=_effects(rest),
                  centre=np.clip(problem.centre, -bound, bound))
    if released != problem.released:
        out.linearise()
    else:
        out.settle()
    out.centre = out.centre + out.fit_nuisances().x
    out.settle()
    return out, rest, [_tangent(out, a) for a in rest if len(a.theta)]


def _misfit(problem: Problem, noise: list[Noise]) -> float:
    """Whitened squares of what a problem leaves, on all blocks, and what its priors cost."""
    prior = problem.prior()
    return float((prior.centre * prior.precision) @ prior.centre) + sum(
        gram(n, [], blocks, [np.ones(len(blocks), dtype=bool)])[0].square
        for n, blocks in zip(noise, problem.blocks))


def _drop(start: Problem, problem: Problem, accepted: list[Accepted],
          tangents: list[Tangent]) -> tuple[Problem, list[Accepted], list[Tangent]]:
    for a in list(accepted):
        if len(accepted) == 1:
            break
        full = Bench(problem, tangents).null_predictive
        less, rest, few = _without(start, problem, accepted, a.name)
        if Bench(less, few).null_predictive > full - LEAST_GAIN:
            problem, accepted, tangents = joint(less, rest)
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
        less, rest, few = _without(start, problem, accepted, a.name)
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
            other = joint(less, [*rest, Accepted.of(t)], t.nuisances)
            lead = 0.5 * (_misfit(problem, problem.noise) - _misfit(other[0], problem.noise))
            odds = lead / tempered(trials) - PARSIMONY * (t.degrees - mine.degrees)
            weight[t.name] = own + odds
            if odds > 0.0:
                problem, accepted, tangents = other
                mine, own = t, weight[t.name]
        now = {b.name for b in accepted}
        rivals[a.name] = {name: float(value - own) for name, value in weight.items()
                          if name not in now and np.isfinite(value)}
    return problem, accepted, tangents, rivals
