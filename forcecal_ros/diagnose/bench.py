"""Fits hypotheses on training data beside what is explained already; judges on the rest."""

from collections.abc import Sequence

from forcecal_ros.diagnose.columns import Column, column, combined
from forcecal_ros.diagnose.evidence import fit, Gram, Prior, score
from forcecal_ros.diagnose.hypotheses import (
    Atom,
    bounds_of,
    fewer,
    Hypothesis,
    nominal_of,
    values_of,
)
from forcecal_ros.diagnose.problem import Diverged, EFFECT, Problem
from forcecal_ros.diagnose.tangent import FAR, Tangent, tangent
from forcecal_ros.diagnose.trial import Trial
from forcecal_ros.effects import Effect
from forcecal_ros.geometry import Array
import numpy as np
from numpy.typing import NDArray

MANY = 4
"""Parameters from which a few are chosen among them as well, at most so many."""

WORTHWHILE = 3.0
"""Evidence that each further one has to bring."""

ROUNDS = 4
"""Gauss-Newton steps of a refinement."""


def estimated(effect: Effect, atom: Atom) -> NDArray[np.intp]:
    """
    Return the parameters to estimate from an atom: those it moves, and those that shape.

    A shape that begins at its lowest value, where it is absent, stays absent.
    """
    return np.array([i for i, (q, start) in enumerate(zip(effect.parameters, atom.start))
                     if i in atom.free or (q.shapes and not q.low == q.nominal == start)],
                    dtype=np.intp)


class Bench:
    """
    Judges hypotheses against what is explained already.

    Parameters
    ----------
    problem : Problem
    tangents : sequence of Tangent
        Of the accepted effects.
    """

    def __init__(self, problem: Problem, tangents: Sequence[Tangent] = ()) -> None:
        self.problem = problem
        self.extra: list[list[Column]] = [
            [c for t in tangents for c in t.columns[i]] for i in range(len(problem.cases))]
        self.m = len(problem.nuisances)
        self._away = np.concatenate([np.zeros(0), *(t.away for t in tangents)])
        self.base = self.m + len(self.extra[0])
        self.train, self.held = problem.grams(self.extra)
        self.null_prior = self._prior(frozenset(), np.zeros(0))
        self.null = fit(self.train, self.null_prior)
        self.null_evidence = fit(self.train + self.held, self.null_prior).log_evidence
        self.null_predictive = self.null_evidence - self.null.log_evidence
        self.noise_rms = [np.stack([n.rms(g) for g in range(3)]) for n in problem.noise]
        d = self.null.x
        self.excess = float(self.held.square - 2.0 * self.held.vector @ d
                            + d @ self.held.matrix @ d - self.held.n)

    def _prior(self, released: frozenset[str], centre: Array) -> Prior:
        """Return the prior of nuisances, accepted effects, and an effect's parameters."""
        own = self.problem.prior(released)
        away = np.concatenate([self._away, centre])
        return Prior(np.concatenate([own.centre, away]),
                     np.concatenate([own.precision, np.full(len(away), EFFECT)]),
                     np.concatenate([own.bound, np.full(len(away), np.inf)]))

    def screen(self, hypotheses: Sequence[Hypothesis]) -> list[tuple[Trial, Atom | None]]:
        """Judge all hypotheses on linear columns, the best start of each, likeliest first."""
        cases = range(len(self.problem.cases))
        atoms = [(h, a) for h in hypotheses for a in h.atoms]
        all_columns = [
            [*self.extra[i], *(c for _, a in atoms for c in a.columns[i])] for i in cases]
        train, held = self.problem.grams(all_columns)
        best: dict[str, tuple[Trial, Atom | None]] = {}

        def keep(h: Hypothesis, trial: Trial, atom: Atom | None) -> None:
            if h.name not in best or trial.evidence > best[h.name][0].evidence:
                best[h.name] = (trial, atom)

        for h in hypotheses:
            for released in h.releases:
                index = np.arange(self.base)
                keep(h, self._judge(h, None, released, train.of(index), held.of(index), []), None)
        position = self.base
        for h, atom in atoms:
            chosen = [np.arange(len(atom.free))]
            if len(atom.free) >= MANY:
                chosen.append(self._grown(position, len(atom.free), train + held))
            for part in chosen:
                index = np.concatenate([np.arange(self.base), position + part])
                own = fewer(h.effect, atom, part)
                keep(h, self._judge(h, own, frozenset(), train.of(index), held.of(index),
                                    [list(own.columns[i]) for i in cases]), own)
            position += len(atom.free)
        return sorted(best.values(), key=lambda pair: -pair[0].evidence)

    def _grown(self, position: int, k: int, data: Gram) -> NDArray[np.intp]:
        """Choose some of k columns, one after the other, as long as each is worth it."""
        chosen: list[int] = []
        value = -np.inf
        while len(chosen) < min(k - 1, MANY):
            left = [j for j in range(k) if j not in chosen]
            scores = []
            for j in left:
                index = np.concatenate([np.arange(self.base),
                                        position + np.array([*chosen, j], dtype=np.intp)])
                prior = self._prior(frozenset(), np.zeros(len(chosen) + 1))
                scores.append(fit(data.of(index), prior).log_evidence)
            best = int(np.argmax(scores))
            if scores[best] < value + WORTHWHILE:
                break
            value = scores[best]
            chosen.append(left[best])
        return np.array(sorted(chosen), dtype=np.intp)

    def _judge(self, h: Hypothesis, atom: Atom | None, released: frozenset[str], train: Gram,
               held: Gram, columns: list[list[Column]]) -> Trial:
        k = len(train.vector) - self.base
        prior = self._prior(released, np.zeros(k))
        found, joint = fit(train, prior), fit(train + held, prior)
        evidence = joint.log_evidence - self.null_evidence - np.log(h.ways)
        gain = joint.log_evidence - found.log_evidence - self.null_predictive
        null = np.concatenate([self.null.x, np.zeros(k)])
        s = score(held, null, found.x, np.arange(self.base), self.null.covariance)
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
        return Trial(h.name, theta, std, free, found.x[:self.m], released, float(gain),
                     float(evidence), s, self._size(columns, found.x - null), self.excess,
                     held.n, atom is None)

    def _size(self, columns: list[list[Column]], d: Array) -> float:
        """Largest RMS of a difference, held out, in noise RMS of a channel and kind of motion."""
        largest = 0.0
        for i, case in enumerate(self.problem.cases):
            if not case.held.any():
                continue
            every = [*self.problem.columns[i], *self.extra[i], *(columns[i] if columns else [])]
            difference = combined(every, d, len(case.groups))
            for g in range(3):
                rows = case.held & (case.groups == g)
                if rows.sum() >= 50:
                    rms = np.sqrt(np.mean(difference[rows] ** 2, axis=0))
                    there = self.problem.noise[i].sigma[g] > 0.0
                    ratio = rms[there] / self.noise_rms[i][g][there]
                    largest = max(largest, float(ratio.max(initial=0.0)))
        return largest

    def refine(self, h: Hypothesis, trial: Trial) -> Trial:
        """Fit an effect's parameters on simulations, nuisances along; judge it again."""
        problem, effect = self.problem, h.effect
        low, high = bounds_of(effect)
        fitted = [i for i, c in enumerate(problem.cases) if c.train.any()]
        theta, free = trial.theta.copy(), trial.free
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
        problem = self.problem
        values = {**problem.effects, h.name: values_of(h.effect, theta)}
        blocks = [problem.simulate(values, i) for i in fitted]
        t = tangent(problem, h.name, theta, free, blocks, fitted)
        full = [blocks[fitted.index(i)] if i in fitted else b
                for i, b in enumerate(problem.blocks)]
        columns = [[*self.extra[i], *t.columns[i]] for i in range(len(problem.cases))]
        train, _ = problem.grams(columns, full)
        found = fit(train, self._prior(frozenset(), t.away))
        return self._at(train), found.x[self.base:] * t.units, t.units

    def _at(self, train: Gram) -> float:
        """Evidence with the effect's parameters as they are."""
        return fit(train.of(np.arange(self.base)), self.null_prior).log_evidence

    def _final(self, h: Hypothesis, theta: Array, free: NDArray[np.intp]) -> Trial:
        problem, cases = self.problem, range(len(self.problem.cases))
        values = {**problem.effects, h.name: values_of(h.effect, theta)}
        blocks = [problem.simulate(values, i) for i in cases]
        t = tangent(problem, h.name, theta, free, blocks, list(cases))
        moved = [column(b - after, problem.level) for b, after in zip(problem.blocks, blocks)]
        own = [[*t.columns[i], moved[i]] for i in cases]
        grams = problem.grams([[*self.extra[i], *own[i]] for i in cases])
        train, held = map(_shifted, grams)
        prior = self._prior(frozenset(), t.away)
        found, joint = fit(train, prior), fit(train + held, prior)
        gain = joint.log_evidence - found.log_evidence - self.null_predictive
        evidence = joint.log_evidence - self.null_evidence - np.log(h.ways)
        null = np.concatenate([self.null.x, np.zeros(len(free) + 1)])
        alternative = np.append(found.x, 1.0)
        s = score(grams[1], null, alternative, np.arange(self.base), self.null.covariance)
        low, high = bounds_of(h.effect)
        std, out = np.zeros(len(theta)), theta.copy()
        std[free] = t.units * np.sqrt(np.diag(found.covariance)[self.base:])
        out[free] = np.clip(theta[free] + found.x[self.base:] * t.units, low[free], high[free])
        return Trial(h.name, out, std, free, found.x[:self.m], frozenset(), float(gain),
                     float(evidence), s, self._size(own, alternative - null), self.excess,
                     held.n, True)


def _shifted(gram: Gram) -> Gram:
    """Take the last column off the residual, with coefficient 1."""
    e = len(gram.vector) - 1
    return Gram(gram.matrix[:e, :e], (gram.vector - gram.matrix[:, e])[:e],
                float(gram.square - 2.0 * gram.vector[e] + gram.matrix[e, e]), gram.n)
