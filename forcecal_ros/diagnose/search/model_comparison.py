"""
Fits of explanations on all blocks.

Hypotheses are fitted as linear as their columns are beside what is explained already, and weighed;
accepted effects and nuisances are refitted together on simulations.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY, SCALES, Scales
from forcecal_ros.diagnose.model.evidence import Fit, fit, Gram, Prior
from forcecal_ros.diagnose.model.gates import Gate
from forcecal_ros.diagnose.model.hypotheses import (
    Atom,
    bounds_of,
    distinct_columns,
    effect_jacobian,
    EffectJacobian,
    fewer,
    Hypothesis,
    nominal_of,
    values_of,
)
from forcecal_ros.diagnose.model.jacobian import Column, combined
from forcecal_ros.diagnose.model.linearised import Diverged, EFFECT, FRACTIONS, LinearisedModel
from forcecal_ros.effects import Effect
import numpy as np
from numpy.typing import NDArray

MANY = 4
"""Parameters of an effect from which also fewer are tried, at most so many."""

WORTHWHILE = 3.0
"""
Log-evidence that each further parameter of an effect has to bring, an effect by the linear screen
to be fitted, and a fit about lines taken anew for them to be taken once more.
"""

CHANCE = 4.0
"""Standard deviations by which a sum of squares may exceed its mean by chance."""

COUNTED = 20.0
"""
Log-likelihood a channel of what a discrepancy gains that counts as missing, at most: it gains
also where noise is not quite what it is taken for. On 271 development cases the log score is
-0.75, -0.73, -0.74, -0.76 with 10, 20, 40, 80.
"""

SETTLED = 0.1
"""Log-posterior that a step has to bring for another one to follow: half a standard error."""

FURTHER = 4
"""
Steps that may follow the first of a fit while it is for the worse, before a part of it is tried.

From a cable of 0.3 N to one of 17 N elsewhere three are for the worse, and the fourth is there.
"""


def estimated(effect: Effect, atom: Atom) -> NDArray[np.intp]:
    """
    Return the parameters to estimate from an atom: those it moves, and those that shape.

    A shape that begins at its lowest value, where it is absent, stays absent.
    """
    return np.array([i for i, (q, start) in enumerate(zip(effect.parameters, atom.start))
                     if i in atom.free or (q.shapes and not q.low == q.nominal == start)],
                    dtype=np.intp)


class Accepted(NamedTuple):
    """
    An effect with its numbers.

    Attributes
    ----------
    theta, std : ndarray, shape (p,)
        Empty if the effect is a released nuisance.
    free : ndarray of int
        Which of them are estimated.
    """

    name: str
    theta: Array
    std: Array
    free: NDArray[np.intp]
    released: frozenset[str]


class Candidate(NamedTuple):
    """
    An effect as screened on the Jacobian.

    Attributes
    ----------
    evidence : float
        Log marginal likelihood of all data above that without it.
    ways : int
        Starts and subsets that were tried, which ``evidence`` allows for.
    nuisances : ndarray, shape (m,)
        Step of the nuisances that goes with it, in prior std.
    scales : tuple of float
        Of the discrepancy, at which it is likeliest.
    gate : Gate, optional
        When it acts, if not all the time.
    nested : tuple of Candidate
        The same effect with other shapes absent; which of them is likelier, the fits show.
    otherwise : Candidate, optional
        The same effect all the time, or in one recording, if no instant is located.
    """

    effect: Accepted
    evidence: float
    ways: int
    nuisances: Array
    scales: Scales
    gate: Gate | None = None
    nested: tuple['Candidate', ...] = ()
    otherwise: 'Candidate | None' = None


class _Level(NamedTuple):
    """What is explained already, with a discrepancy of one scale: its fit and its evidence."""

    scales: Scales
    every: Gram
    null: Fit


def _by_chance(n: float) -> float:
    return CHANCE * float(np.sqrt(0.5 * n))


class Explained:
    """
    What is explained already: columns of the nuisances and of accepted effects, and their prior.

    Parameters
    ----------
    jacobians : sequence of EffectJacobian
        Of the accepted effects.

    Attributes
    ----------
    extra : list of list of Column
        Of the effects, in each recording.
    base : int
        How many columns there are.
    """

    def __init__(self, model: LinearisedModel, jacobians: Sequence[EffectJacobian] = ()) -> None:
        self.model = model
        self.extra: list[list[Column]] = [
            [c for t in jacobians for c in t.columns[i]] for i in range(len(model.datasets))]
        self._away = np.concatenate([np.zeros(0), *(t.away for t in jacobians)])
        self._precision = np.concatenate([np.zeros(0), *(t.precision for t in jacobians)])
        self.base = len(model.nuisances) + len(self.extra[0])
        self.null_prior = self._prior(frozenset(), np.zeros(0))

    def _prior(self, released: frozenset[str], centre: Array) -> Prior:
        """Return the prior of nuisances, accepted effects, and an effect's parameters."""
        own = self.model.prior(released)
        away = np.concatenate([self._away, centre])
        endless = np.full(len(away), np.inf)
        return Prior(np.concatenate([own.centre, away]),
                     np.concatenate([own.precision, self._precision,
                                     np.full(len(centre), EFFECT)]),
                     np.concatenate([own.low, -endless]), np.concatenate([own.high, endless]))

    def by_training(self) -> list[Array]:
        """
        Return what a fit to the training blocks alone does otherwise than one to all blocks.

        What training blocks do not identify stays as all blocks have it.

        Returns
        -------
        list of ndarray, shape (n, channels)
            In each recording: the simulation by the training blocks less that by all.
        """
        p = self.null_prior
        about = Prior(np.zeros(self.base), p.precision, p.low - p.centre, p.high - p.centre)
        x = (fit(self.model.gram(self.extra, training=True), about).x
             - fit(self.model.gram(self.extra), about).x)
        return [combined([*own, *more], x, len(r)) * c.measured.present for own, more, r, c in zip(
            self.model.jacobian, self.extra, self.model.residuals, self.model.datasets)]


class ModelComparison(Explained):
    """Compares hypotheses with what is explained already, by marginal likelihood."""

    def __init__(self, model: LinearisedModel, jacobians: Sequence[EffectJacobian] = ()) -> None:
        super().__init__(model, jacobians)
        self.m = len(model.nuisances)
        self._products = model.products(self.extra)
        self.levels = self._usual()
        self.scales, self.every, self.null = max(
            self.levels, key=lambda level: level.null.log_evidence)
        self.null_evidence = self.null.log_evidence

    def _usual(self) -> list['_Level']:
        """Return levels of one scale in all streams, and the likeliest of any."""
        levels = [self._level((size,) * len(STREAM_SLICES)) for size in SCALES]
        start = max(levels, key=lambda level: level.null.log_evidence)
        best = self._products.improve(
            lambda gram: fit(gram, self.null_prior, start.null).log_evidence, start.scales)
        return levels if best == start.scales else [*levels, self._level(best)]

    def _level(self, scales: Scales) -> '_Level':
        every = self._products.at(scales)
        return _Level(scales, every, fit(every, self.null_prior))

    def marginal_covariance(self, spread: Array) -> Array:
        """Return that of each parameter whatever the others are, shape (k, k)."""
        least = np.append(self.model.least(), np.full(self.base - self.m, -np.inf))
        return self.null.marginal_covariance(self.every, self.null_prior, least, spread)

    @property
    def discrepancy_evidence(self) -> float:
        """Log-likelihood of a discrepancy against none, and what is unexplained beyond it."""
        excess = self.every.residual_squares(self.null.x) - self.every.n
        return self._gained + max(0.0, 0.5 * excess - _by_chance(self.every.n))

    @property
    def missing_evidence(self) -> float:
        """Log-evidence that a model with nothing wrong would have more, noise allowed for."""
        n = self.every.n
        missed = -self.null_evidence - self.null.volume - 0.5 * n - _by_chance(n)
        return max(0.0, missed) + min(self._gained, COUNTED * len(self._products.parts))

    @property
    def _gained(self) -> float:
        none = next(one.null for one in self.levels if one.scales == NO_DISCREPANCY)
        return self.null_evidence - none.log_evidence

    def screen(self, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
        """Judge all hypotheses on the Jacobian, the best start of each, likeliest first."""
        shared = distinct_columns(hypotheses)
        places = {one: self.base + j for j, one in enumerate(shared)}
        products = self.model.products([[*own, *(c[i] for c in shared.values())]
                                        for i, own in enumerate(self.extra)])
        grams = [products.at(level.scales) for level in self.levels]
        likeliest = products.at(self.scales)
        best: dict[tuple[str, Gate | None], dict[frozenset[int], Candidate]] = {}

        def keep(h: Hypothesis, atom: Atom | None, released: frozenset[str],
                 columns: NDArray[np.intp]) -> None:
            index = np.concatenate([np.arange(self.base), columns])
            result = self._judge(h, atom, released, [one.of(index) for one in grams])
            nested = best.setdefault((h.name, h.gate), {})
            shapes = frozenset(i for i in result.effect.free if h.effect.parameters[i].shapes)
            if shapes not in nested or result.evidence > nested[shapes].evidence:
                nested[shapes] = result

        for h in hypotheses:
            for released in h.releases:
                keep(h, None, released, np.zeros(0, dtype=np.intp))
            for atom in h.atoms:
                place = np.array([places[id(c)] for c in atom.columns[0]])
                keep(h, atom, frozenset(), place)
                if len(atom.free) >= MANY:
                    part = self._grown(place, likeliest)
                    keep(h, fewer(h.effect, atom, part), frozenset(), place[part])
        ordered = [sorted(some.values(), key=lambda t: -t.evidence) for some in best.values()]
        return sorted((first._replace(nested=tuple(others)) for first, *others in ordered),
                      key=lambda t: -t.evidence)

    def _grown(self, place: NDArray[np.intp], data: Gram) -> NDArray[np.intp]:
        """Choose some columns, one after the other, as long as each is worth it."""
        k = len(place)
        chosen: list[int] = []
        value = -np.inf
        while len(chosen) < min(k - 1, MANY):
            remaining = [j for j in range(k) if j not in chosen]
            scores = []
            for j in remaining:
                index = np.concatenate([np.arange(self.base), place[[*chosen, j]]])
                prior = self._prior(frozenset(), np.zeros(len(chosen) + 1))
                scores.append(fit(data.of(index), prior, self.null).log_evidence)
            best = int(np.argmax(scores))
            if scores[best] < value + WORTHWHILE:
                break
            value = scores[best]
            chosen.append(remaining[best])
        return np.array(sorted(chosen), dtype=np.intp)

    def _judge(self, h: Hypothesis, atom: Atom | None, released: frozenset[str],
               grams: Sequence[Gram]) -> Candidate:
        """Fit a hypothesis as linear as its columns are, the discrepancy as large as likeliest."""
        k = len(grams[0].vector) - self.base
        prior = self._prior(released, np.zeros(k))
        found, level = max(((fit(one, prior, level.null), level)
                            for one, level in zip(grams, self.levels)),
                           key=lambda pair: pair[0].log_evidence)
        evidence = found.log_evidence - self.null_evidence - np.log(h.ways)
        theta = np.zeros(0)
        free = np.zeros(0, dtype=np.intp)
        if atom is not None:
            free = estimated(h.effect, atom)
            nominal, x = nominal_of(h.effect), found.x[self.base:]
            theta = atom.start.copy()
            theta[atom.free] = nominal[atom.free] + x * (atom.start - nominal)[atom.free]
            low, high = bounds_of(h.effect)
            if len(atom.free) == 1 and (theta < low - 1e-12 * np.abs(low)).any():
                evidence = -np.inf
            theta = np.clip(theta, low, high)
        effect = Accepted(h.name, theta, np.zeros(len(theta)), free, released)
        return Candidate(effect, float(evidence), h.ways, found.x[:self.m], level.scales, h.gate)


class JointFit(NamedTuple):
    """
    Accepted effects, nuisances and noise as fitted together.

    Attributes
    ----------
    model : LinearisedModel
        With the effects, evaluated there.
    jacobians : list of EffectJacobian
        Of the effects that have parameters of their own.
    """

    model: LinearisedModel
    accepted: list[Accepted]
    jacobians: list[EffectJacobian]

    def comparison(self) -> ModelComparison:
        """Weigh it, and further hypotheses beside it."""
        return ModelComparison(self.model, self.jacobians)


def joint_fit(model: LinearisedModel, accepted: Sequence[Accepted], step: Array | None = None,
              rounds: int = 10) -> JointFit:
    """
    Refit accepted effects and nuisances together, the discrepancy as large as is likeliest.

    Parameters
    ----------
    step : ndarray, shape (m,), optional
        Of the nuisances, to begin with.
    rounds : int
        Steps, at most.
    """
    released = frozenset(n for a in accepted for n in a.released)
    out = replace(model, released=released, effects=_effects(model, accepted),
                  centre=model.centre if step is None else model.moved(step))
    m, now, prior = len(model.nuisances), list(accepted), out.prior()
    out.centre = np.clip(out.centre, prior.low, prior.high)  # beside fewer effects, fewer released
    out.linearise(released)
    if released:
        out.settle()
    jacobians: list[EffectJacobian] = []
    further = FURTHER if step is not None else 0
    for _ in range(rounds):  # a resonance that starts an octave off takes 8
        jacobians = _jacobians(out, now)
        comparison = ModelComparison(out, jacobians)
        out.discrepancy_scales = comparison.scales
        before, gained, old = out.log_posterior(comparison.every.square), -np.inf, (out, now)
        for fraction in FRACTIONS:
            tried = _stepped(out, now, jacobians, comparison, fraction)
            gained = tried[0].log_posterior() - before if tried else -np.inf
            for _ in range(further):
                if not tried or gained > -SETTLED:
                    break
                # along a valley that bends a step leaves it: further ones lead back
                there = _jacobians(*tried)
                tried = _stepped(*tried, there, ModelComparison(tried[0], there), 1.0)
                gained = tried[0].log_posterior() - before if tried else -np.inf
            further = 0
            if tried and gained > -SETTLED:
                out, now = tried
                break
        if gained < SETTLED:
            out, now = (out, now) if gained > 0.0 else old
            break
        if out.is_far(comparison.null.x[:m]):
            out.linearise()
        elif released:
            out.linearise(released)
    return JointFit(out, now, jacobians)


def joint_fit_if_finite(model: LinearisedModel, accepted: Sequence[Accepted],
                        step: Array | None = None, rounds: int = 10) -> JointFit | None:
    """Refit as :func:`joint_fit` does; give nothing where a simulation diverges."""
    try:
        return joint_fit(model, accepted, step, rounds)
    except Diverged:
        return None


def _jacobians(model: LinearisedModel, accepted: Sequence[Accepted]) -> list[EffectJacobian]:
    """Take the columns of all effects that have parameters of their own."""
    return [effect_jacobian(model, a.name, a.theta, a.free) for a in accepted if len(a.theta)]


def _stepped(model: LinearisedModel, now: Sequence[Accepted], jacobians: Sequence[EffectJacobian],
             comparison: ModelComparison, fraction: float
             ) -> tuple[LinearisedModel, list[Accepted]] | None:
    """
    Evaluate a fraction of the way to the best; give nothing where that diverges.

    A simulator whose numbers are released is run there, as its lines may not hold so far.
    """
    moved = _moved(now, jacobians, comparison, fraction)
    step = fraction * comparison.null.x[:len(model.nuisances)]
    tried = model.evaluated(step, effects=_effects(model, moved))
    if tried and model.released:
        tried.settle()
    return (tried, moved) if tried else None


def _moved(accepted: Sequence[Accepted], jacobians: Sequence[EffectJacobian],
           comparison: ModelComparison, fraction: float) -> list[Accepted]:
    """Go a fraction of the way to the best parameters of all accepted effects."""
    by_name = {t.name: t for t in jacobians}
    x, variance = comparison.null.x, np.diag(comparison.null.covariance)
    position, out = len(comparison.model.nuisances), []
    for a in accepted:
        if len(a.theta):
            part, units = slice(position, position + len(a.free)), by_name[a.name].units
            low, high = bounds_of(comparison.model.library[a.name])
            theta, std = a.theta.copy(), np.zeros(len(a.theta))
            theta[a.free] += fraction * x[part] * units
            std[a.free] = units * np.sqrt(variance[part])
            a = a._replace(theta=np.clip(theta, low, high), std=std)
            position += len(a.free)
        out.append(a)
    return out


def _effects(model: LinearisedModel, accepted: Sequence[Accepted]) -> dict[str, dict[str, float]]:
    return {a.name: values_of(model.library[a.name], a.theta)
            for a in accepted if len(a.theta)}
