"""Fits hypotheses on training data beside what is explained already; judges on the rest."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.evidence import Fit, fit, Gram, Prior, score
from forcecal_ros.diagnose.model.hypotheses import (
    Atom,
    bounds_of,
    effect_jacobian,
    EffectJacobian,
    FAR,
    fewer,
    Hypothesis,
    nominal_of,
    values_of,
)
from forcecal_ros.diagnose.model.jacobian import Column, column, combined
from forcecal_ros.diagnose.model.linearised import Diverged, EFFECT, LinearisedModel
from forcecal_ros.diagnose.model.products import ascended, Products
from forcecal_ros.diagnose.model.scales import NO_DISCREPANCY, SCALES, Scales
from forcecal_ros.diagnose.search.fitted import HypothesisFit
from forcecal_ros.effects import Effect
import numpy as np
from numpy.typing import NDArray

MANY = 4
"""Parameters of an effect from which also fewer are tried, at most so many."""

WORTHWHILE = 3.0
"""Log-evidence that each further parameter of an effect has to bring."""

CHANCE = 4.0
"""Standard deviations by which a sum of squares may exceed its mean by chance."""

FLAWED = 80.0
"""
Log-likelihood a channel that a discrepancy may gain because noise is not quite what it is taken
for: on a real arm's wrench that was 30 to 110, on a rig with 1/f noise in all channels 26 to 76.
"""

ROUNDS = 4
"""Gauss-Newton steps of a refinement, at most."""


def estimated(effect: Effect, atom: Atom) -> NDArray[np.intp]:
    """
    Return the parameters to estimate from an atom: those it moves, and those that shape.

    A shape that begins at its lowest value, where it is absent, stays absent.
    """
    return np.array([i for i, (q, start) in enumerate(zip(effect.parameters, atom.start))
                     if i in atom.free or (q.shapes and not q.low == q.nominal == start)],
                    dtype=np.intp)


class _Level(NamedTuple):
    """What is explained already, with a discrepancy of one scale: its fit and its evidence."""

    scales: Scales
    train: Gram
    held: Gram
    null: Fit
    evidence: float

    @property
    def excess(self) -> float:
        """Held-out whitened energy above the noise and the discrepancy."""
        return self.held.residual_squares(self.null.x) - self.held.n


class _Screened(NamedTuple):
    """The best fit of a hypothesis, where it began, and how far it is from the null."""

    fit: HypothesisFit
    atom: Atom | None
    difference: Array


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
        self.base = len(model.nuisances) + len(self.extra[0])
        self.null_prior = self._prior(frozenset(), np.zeros(0))

    def _prior(self, released: frozenset[str], centre: Array) -> Prior:
        """Return the prior of nuisances, accepted effects, and an effect's parameters."""
        own = self.model.prior(released)
        away = np.concatenate([self._away, centre])
        endless = np.full(len(away), np.inf)
        return Prior(np.concatenate([own.centre, away]),
                     np.concatenate([own.precision, np.full(len(away), EFFECT)]),
                     np.concatenate([own.low, -endless]), np.concatenate([own.high, endless]))


class ModelComparison(Explained):
    """Compares hypotheses with what is explained already, by marginal likelihood."""

    def __init__(self, model: LinearisedModel, jacobians: Sequence[EffectJacobian] = ()) -> None:
        super().__init__(model, jacobians)
        self.m = len(model.nuisances)
        self._products = model.products(self.extra)
        self.levels = self._usual()
        best = max(self.levels, key=lambda level: level.evidence)
        self.scales, self.train, self.held, self.null, self.null_evidence = best
        self.null_predictive = self.null_evidence - self.null.log_evidence
        self.noise_rms = [np.stack([n.rms(g) for g in range(3)]) for n in model.noise]

    def _usual(self) -> list['_Level']:
        """Return levels of one scale in all streams, and the likeliest of any."""
        levels = [self._level((size,) * len(STREAM_SLICES)) for size in SCALES]
        start = max(levels, key=lambda level: level.evidence).scales
        best = ascended(self._products, lambda grams: fit(
            grams[0] + grams[1], self.null_prior).log_evidence, start)
        return levels if best == start else [*levels, self._level(best)]

    def _level(self, scales: Scales) -> '_Level':
        train, held = self._products.at(scales)
        null = fit(train, self.null_prior)
        return _Level(scales, train, held, null, fit(train + held, self.null_prior).log_evidence)

    @property
    def excess(self) -> float:
        """Held-out whitened energy above the noise, without a discrepancy."""
        return next(level.excess for level in self.levels if level.scales == NO_DISCREPANCY)

    @property
    def discrepancy_evidence(self) -> float:
        """Log-likelihood of a discrepancy against none, and what is unexplained beyond it."""
        every, found = self._all
        excess = every.residual_squares(found.x) - every.n
        return self._gained + max(0.0, 0.5 * excess - _by_chance(every.n))

    @property
    def missing_evidence(self) -> float:
        """Log-evidence that a model with nothing wrong would have more, noise allowed for."""
        every, found = self._all
        missed = -found.log_evidence - found.volume - 0.5 * every.n - _by_chance(every.n)
        return max(0.0, missed) + min(self._gained, FLAWED * float(self._products.channels.sum()))

    @cached_property
    def unexplained(self) -> Array:
        """Negative log-likelihood of each stream, beside the discrepancy, shape (streams,)."""
        return self._products.unexplained(self._all[1].x, self.scales)[0]

    @cached_property
    def missing_by_stream(self) -> Array:
        """Stream by stream, ``missing_evidence`` but for priors, shape (streams,)."""
        none = next(level for level in self.levels if level.scales == NO_DISCREPANCY)
        bare, n = self._products.unexplained(fit(none.train + none.held, self.null_prior).x,
                                             NO_DISCREPANCY)
        missed = self.unexplained - 0.5 * n - [_by_chance(each) for each in n]
        gained = np.clip(bare - self.unexplained, 0.0, FLAWED * self._products.channels)
        return np.maximum(missed, 0.0) + gained

    @cached_property
    def _all(self) -> tuple[Gram, Fit]:
        """All samples, and what explains them already."""
        every = self.train + self.held
        return every, fit(every, self.null_prior)

    @property
    def _gained(self) -> float:
        none = next(level.evidence for level in self.levels if level.scales == NO_DISCREPANCY)
        return self.null_evidence - none

    def screen(self, hypotheses: Sequence[Hypothesis]) -> list[tuple[HypothesisFit, Atom | None]]:
        """Judge all hypotheses on the Jacobian, the best start of each, likeliest first."""
        atoms = [(h, a) for h in hypotheses for a in h.atoms]
        # many starts of an effect share their columns
        shared = {id(c[0]): c for _, a in atoms for c in zip(*a.columns)}
        places = {one: self.base + j for j, one in enumerate(shared)}
        products = self.model.products([[*own, *(c[i] for c in shared.values())]
                                        for i, own in enumerate(self.extra)])
        grams = [products.at(level.scales) for level in self.levels]
        train, held = products.at(self.scales)
        both = train + held
        best: dict[str, _Screened] = {}

        def keep(h: Hypothesis, atom: Atom | None, released: frozenset[str],
                 columns: NDArray[np.intp]) -> None:
            index = np.concatenate([np.arange(self.base), columns])
            result, difference = self._judge(h, atom, released, _of(grams, index))
            if h.name not in best or result.evidence > best[h.name].fit.evidence:
                best[h.name] = _Screened(result, atom, difference)

        for h in hypotheses:
            for released in h.releases:
                keep(h, None, released, np.zeros(0, dtype=np.intp))
        for h, atom in atoms:
            place = np.array([places[id(c)] for c in atom.columns[0]])
            keep(h, atom, frozenset(), place)
            if len(atom.free) >= MANY:
                part = self._grown(place, both)
                keep(h, fewer(h.effect, atom, part), frozenset(), place[part])
        found = [(t._replace(size=self._size([] if atom is None else atom.columns, d)), atom)
                 for t, atom, d in best.values()]
        return sorted(found, key=lambda pair: -pair[0].evidence)

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
                scores.append(fit(data.of(index), prior).log_evidence)
            best = int(np.argmax(scores))
            if scores[best] < value + WORTHWHILE:
                break
            value = scores[best]
            chosen.append(remaining[best])
        return np.array(sorted(chosen), dtype=np.intp)

    def _judge(self, h: Hypothesis, atom: Atom | None, released: frozenset[str],
               grams: Sequence[tuple[Gram, Gram]]) -> tuple[HypothesisFit, Array]:
        """Return a fit, its size left open, and how far its parameters are from the null's."""
        k = len(grams[0][0].vector) - self.base
        prior = self._prior(released, np.zeros(k))
        level, (train, held), joint = self._likeliest(grams, prior)
        found = fit(train, prior)
        evidence = joint.log_evidence - self.null_evidence - np.log(h.ways)
        gain = joint.log_evidence - found.log_evidence - self.null_predictive
        null = np.concatenate([level.null.x, np.zeros(k)])
        s = score(held, null, found.x, np.arange(self.base), level.null.covariance)
        theta = std = np.zeros(0)
        free = np.zeros(0, dtype=np.intp)
        if atom is not None:
            free = estimated(h.effect, atom)
            nominal, x = nominal_of(h.effect), found.x[self.base:]
            unit = (atom.start - nominal)[atom.free]
            theta, std = atom.start.copy(), np.zeros(len(atom.start))
            limit = np.abs(nominal) > FAR * np.abs([q.typical for q in h.effect.parameters])
            theta[atom.free] = np.where(limit[atom.free], atom.start[atom.free],
                                        nominal[atom.free] + x * unit)
            if limit.any() and (x < 0.5).any():
                gain = evidence = -np.inf
            variance = np.diag(found.covariance)[self.base:]
            std[atom.free] = np.abs(unit) * np.sqrt(variance)
            low, high = bounds_of(h.effect)
            if (len(atom.free) == 1 and (theta < low - 1e-12 * np.abs(low)).any()):
                gain = evidence = -np.inf
            theta = np.clip(theta, low, high)
        return HypothesisFit(h.name, theta, std, free, found.x[:self.m], released, float(gain),
                             float(evidence), s, 0.0, level.excess, held.n, atom is None,
                             level.scales), found.x - null

    def _best_scales(self, products: Products, prior: Prior) -> Scales:
        """Return the scales that make a hypothesis likeliest whose columns end with its effect."""
        def evidence(grams: tuple[Gram, Gram]) -> float:
            return fit(_shifted(grams[0] + grams[1]), prior).log_evidence

        start = max((level.scales for level in self.levels),
                    key=lambda scales: evidence(products.at(scales)))
        return ascended(products, evidence, start)

    def _likeliest(self, grams: Sequence[tuple[Gram, Gram]], prior: Prior
                   ) -> tuple['_Level', tuple[Gram, Gram], Fit]:
        """Return the scale of the discrepancy that makes a hypothesis likeliest, and its fit."""
        fits = [fit(train + held, prior) for train, held in grams]
        i = max(range(len(fits)), key=lambda j: fits[j].log_evidence)
        return self.levels[i], grams[i], fits[i]

    def _size(self, columns: Sequence[list[Column]], d: Array) -> float:
        """Largest RMS of a difference, held out, in what a simulation may be off by."""
        largest = 0.0
        for i, dataset in enumerate(self.model.datasets):
            if not dataset.held.any():
                continue
            every = [*self.model.jacobian[i], *self.extra[i], *(columns[i] if columns else [])]
            difference = combined(every, d, len(dataset.groups))
            for g in range(3):
                rows = dataset.held & (dataset.groups == g)
                if rows.sum() >= 50:
                    rms = np.sqrt(np.mean(difference[rows] ** 2, axis=0))
                    there = self.model.noise[i].sigma[g] > 0.0
                    ratio = rms[there] / self.noise_rms[i][g][there]
                    largest = max(largest, float(ratio.max(initial=0.0))
                                  / dataset.simulation.exact)
        return largest

    def refine(self, h: Hypothesis, result: HypothesisFit) -> HypothesisFit:
        """Fit an effect's parameters on simulations, nuisances along; judge it again."""
        model, effect = self.model, h.effect
        low, high = bounds_of(effect)
        fitted = [i for i, c in enumerate(model.datasets) if c.train.any()]
        theta, free = result.theta.copy(), result.free
        best, step = (-np.inf, theta), np.zeros(len(free))
        for _ in range(ROUNDS):
            try:
                evidence, onward, units = self._stepped(h, theta, free, fitted)
            except Diverged:
                if not np.isfinite(best[0]):
                    raise
                evidence = -np.inf
            if evidence > best[0]:
                best, step = (evidence, theta), onward
            else:
                step = 0.3 * step
            moved = best[1].copy()
            moved[free] = np.clip(moved[free] + step, low[free], high[free])
            if np.abs((moved - theta)[free] / units).max() < 1e-3:
                break
            theta = moved
        return self._final(h, best[1], free)

    def _stepped(self, h: Hypothesis, theta: Array, free: NDArray[np.intp], fitted: list[int]
                 ) -> tuple[float, Array, Array]:
        """Return the evidence at an effect's parameters, the step from there, and its units."""
        model = self.model
        values = {**model.effects, h.name: values_of(h.effect, theta)}
        residuals = [model.simulate(values, i) for i in fitted]
        t = effect_jacobian(model, h.name, theta, free, residuals, fitted)
        full = [residuals[fitted.index(i)] if i in fitted else b
                for i, b in enumerate(model.residuals)]
        columns = [[*self.extra[i], *t.columns[i]] for i in range(len(model.datasets))]
        products = model.products(columns, full)
        grams = [products.at(level.scales)[0] for level in self.levels]
        prior = self._prior(frozenset(), t.away)
        # an effect that is not there yet in full leaves what looks like a discrepancy
        found = max((fit(train, prior) for train in grams), key=lambda one: one.log_evidence)
        own = np.arange(self.base)
        as_is = max(fit(train.of(own), self.null_prior).log_evidence for train in grams)
        return as_is, found.x[self.base:] * t.units, t.units

    def _final(self, h: Hypothesis, theta: Array, free: NDArray[np.intp]) -> HypothesisFit:
        model, datasets = self.model, range(len(self.model.datasets))
        values = {**model.effects, h.name: values_of(h.effect, theta)}
        residuals = [model.simulate(values, i) for i in datasets]
        t = effect_jacobian(model, h.name, theta, free, residuals, list(datasets))
        moved = [column(b - after, model.level) for b, after in zip(model.residuals, residuals)]
        own = [[*t.columns[i], moved[i]] for i in datasets]
        products = model.products([[*self.extra[i], *own[i]] for i in datasets])
        prior = self._prior(frozenset(), t.away)
        level = self._level(self._best_scales(products, prior))
        train, held = products.at(level.scales)
        found = fit(_shifted(train), prior)
        joint = fit(_shifted(train + held), prior)
        gain = joint.log_evidence - found.log_evidence - self.null_predictive
        evidence = joint.log_evidence - self.null_evidence - np.log(h.ways)
        null = np.concatenate([level.null.x, np.zeros(len(free) + 1)])
        alternative = np.append(found.x, 1.0)
        s = score(held, null, alternative, np.arange(self.base), level.null.covariance)
        low, high = bounds_of(h.effect)
        std, out = np.zeros(len(theta)), theta.copy()
        std[free] = t.units * np.sqrt(np.diag(found.covariance)[self.base:])
        out[free] = np.clip(theta[free] + found.x[self.base:] * t.units, low[free], high[free])
        return HypothesisFit(h.name, out, std, free, found.x[:self.m], frozenset(), float(gain),
                             float(evidence), s, self._size(own, alternative - null), level.excess,
                             held.n, True, level.scales)


def _shifted(gram: Gram) -> Gram:
    """Take the last column off the residual, with coefficient 1."""
    e = len(gram.vector) - 1
    return Gram(gram.matrix[:e, :e], (gram.vector - gram.matrix[:, e])[:e],
                float(gram.square - 2.0 * gram.vector[e] + gram.matrix[e, e]), gram.n,
                gram.log_det)


def _of(grams: Sequence[tuple[Gram, Gram]], index: NDArray[np.intp]) -> list[tuple[Gram, Gram]]:
    return [(train.of(index), held.of(index)) for train, held in grams]
