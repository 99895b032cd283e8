"""Which terms are needed: nested fits on training blocks, judged on held-out ones."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from forcecal_ros.diagnose.columns import Column, column, gram
from forcecal_ros.diagnose.evidence import Fit, fit, Gram, Prior, Score, score
from forcecal_ros.diagnose.motion.case import EVERY, MotionCase
from forcecal_ros.diagnose.motion.model import DELAYS, predict, Term
from forcecal_ros.diagnose.nuisances import LIMIT
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import Autoregression, ORDER
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

SIGNIFICANT = 3.0
"""Held-out sigmas that an effect needs."""

SMALL = 0.05
"""RMS of what it does in some channel, in noise RMS, below which it is negligible."""

PRICE = 16.0
"""Held-out energy that each parameter of it must remove. Of white noise ln(rows) would do; what
is left of a tool that is not quite rigid is correlated, and much in it is significant."""

AXIS_PRICE = 24.0
"""The same of one axis, which is chosen among many."""

SCAN = 1e-3 * np.arange(1, 21)
"""Delays that are looked at [s]."""

FEWEST = 12
"""Rows that a channel's noise takes."""

COLOUR = 1.5
"""Noise counts as so many times its RMS, for its colour."""

USUAL = ('tool_mass', 'tool_com', 'wrench_bias', 'inertial_force', 'accel_delay')
"""Effects that noise is told apart from: all that a rigid body on a sensor needs."""

VAGUE = 1e-4
"""Prior precision of a nuisance that an effect lifts, in its spreads."""

LARGE = 3.0
"""Spread of a term that is no nuisance, in typical sizes: no axis loses most of its gain."""

SLIGHT = 0.5
"""Size of an axis, in typical ones, below which it is none of its own."""

TEMPERATURE = 2.0
"""Of held-out log-likelihoods, when they become probabilities."""

RIVAL = 4.0
"""Held-out energy within which two axes cannot be told apart."""

ROUNDS = 8
TRIED = 3
"""Axes that are fitted in full each round."""
STEPS = 4


class Trial(NamedTuple):
    """An effect tried: where its fit ends, and what held-out blocks say of it."""

    effects: tuple[str, ...]
    values: dict[str, float]
    terms: tuple[Term, ...]
    score: Score
    size: float

    @property
    def possible(self) -> bool:
        """Whether it is significant and large enough to matter; nothing is early."""
        late = all(self.values.get(e, 1.0) > 0.0 for e in self.effects)
        slight = any(t.axis and self._typical(t) < SLIGHT for t in self.terms)
        return late and not slight and self.score.z > SIGNIFICANT and self.size > SMALL

    @property
    def needed(self) -> bool:
        """Whether it removes what its parameters cost besides."""
        return self.possible and self.score.removed > self._price

    @property
    def probability(self) -> float:
        """Of being there, by the held-out likelihood less the price of its parameters."""
        return float(expit(0.5 * (self.score.removed - self._price) / TEMPERATURE))

    @property
    def _price(self) -> float:
        """Held-out energy that it must remove: more where it is improbably large."""
        return sum(AXIS_PRICE + (self._typical(t) / LARGE) ** 2 if t.axis else PRICE
                   for t in self.terms)

    def _typical(self, term: Term) -> float:
        return abs(self.values.get(term.name, 0.0)) / term.typical


@dataclass
class Fitting:
    """
    The state of a diagnosis.

    Attributes
    ----------
    cases : sequence of MotionCase
    terms : tuple of Term
    accepted : list of str
        Effects found so far, or axes of them, see :attr:`Term.part`.
    rivals : dict of str to str
        Effects of one axis that explained what another one, accepted instead, explains.
    values : dict of str to float
        Of every term that departs.
    usual : dict of str to float
        The same where all usual effects are there, from which noise is learned.
    noise : list of Autoregression
    residual : list of ndarray, shape (n, 16)
    """

    cases: Sequence[MotionCase]
    terms: tuple[Term, ...]
    accepted: list[str] = field(default_factory=list)
    rivals: dict[str, str] = field(default_factory=dict)
    values: dict[str, float] = field(default_factory=dict)
    usual: dict[str, float] = field(default_factory=dict)
    noise: list[Autoregression] = field(default_factory=list)
    residual: list[Array] = field(default_factory=list)

    def settle(self) -> None:
        """Predict at the present values."""
        self.residual = self.residuals(self.values)

    def learn_noise(self) -> None:
        """
        Fit the noise of what remains where all usual effects are there.

        A noise model of residuals that still hold the gap would take the gap for noise.
        """
        there = {t.effect for t in self.terms}
        moving = {'inertial': 1.0} if 'inertial_force' in there else {}
        delays = SCAN if 'accel_delay' in there else ()
        starts = [{**moving, 'accel_delay': float(d)} for d in (0.0, *delays)]
        self.settle()
        self.noise = [_noise(c, r) for c, r in zip(self.cases, self.residual)]
        self.usual = min(starts, key=self._train_cost)
        self.relearn_noise()

    def relearn_noise(self) -> None:
        """Fit the noise of what the usual effects and the accepted ones leave."""
        for _ in range(2):
            self.usual, _ = self.refine([*USUAL, *self.accepted], self.usual)
            self.noise = [_noise(c, r) for c, r in zip(self.cases, self.residuals(self.usual))]

    def residuals(self, values: dict[str, float]) -> list[Array]:
        """Measured less predicted of every recording, slow rows."""
        return [c.slow(c.measured - predict(c, values)) for c in self.cases]

    def free(self, effects: Sequence[str]) -> list[Term]:
        """Return nuisances, and the terms of effects."""
        return [t for t in self.terms if t.spread > 0.0 or t.part in effects]

    def axes(self) -> list[str]:
        """Return parts that are one axis of an effect."""
        return [t.part for t in self.terms if t.axis]

    def promising(self) -> list[str]:
        """Return the axes that would explain most of the training blocks if all were linear."""
        terms = self.free([*self.accepted, *self.axes()])
        train, _ = self._grams(terms, self.values)
        prior = self.prior(terms, [*self.accepted, *self.axes()], self.values)
        base = [i for i, t in enumerate(terms) if not t.axis or t.part in self.accepted]

        def gain(i: int) -> float:
            chosen = np.array([*base, i], dtype=np.intp)
            return fit(train.of(chosen), prior.of(chosen)).log_evidence

        left = [i for i in range(len(terms)) if i not in base]
        return [terms[i].part for i in sorted(left, key=gain, reverse=True)[:TRIED]]

    def refine(self, effects: Sequence[str], values: dict[str, float], steps: int = STEPS
               ) -> tuple[dict[str, float], Fit]:
        """Fit nuisances and effects on the training blocks from given values on."""
        terms = self.free(effects)
        for _ in range(steps):
            train, _ = self._grams(terms, values)
            found = fit(train, self.prior(terms, effects, values))
            values = dict(values)
            for term, x in zip(terms, found.x):
                values[term.name] = values.get(term.name, 0.0) + float(x) * term.unit_size
            if np.abs(found.x).max(initial=0.0) < 1e-3:
                break
        return values, found

    def prior(self, terms: Sequence[Term], effects: Sequence[str], values: dict[str, float]
              ) -> Prior:
        """Spreads of the nuisances; an effect lifts those of its own terms."""
        lifted = np.array([t.part in effects for t in terms], dtype=bool)
        centre = np.array([values.get(t.name, 0.0) / t.unit_size for t in terms])
        loose = np.where([t.spread > 0.0 for t in terms], VAGUE, LARGE ** -2)
        return Prior(centre, np.where(lifted, loose, 1.0), np.where(lifted, np.inf, LIMIT))

    def energies(self, terms: Sequence[Term]) -> Array:
        """Whitened energy of a typical size of each term, shape (k,)."""
        train, held = self._grams(terms, self.values, [t.typical for t in terms])
        return np.asarray(np.diag(train.matrix) + np.diag(held.matrix))

    def trial(self, effects: tuple[str, ...], starts: Sequence[dict[str, float]]) -> Trial:
        """Fit further effects jointly with what is accepted, and judge them on held-out blocks."""
        wanted = [*self.accepted, *effects]
        start = min(starts, key=lambda s: self._train_cost({**self.values, **s}))
        values, _ = self.refine(wanted, {**self.values, **start}, steps=2)
        return Trial(effects, values, self.terms_in(effects), *self.judged(values))

    def wanting(self) -> float:
        """Return the log-likelihood that held-out blocks would gain if nothing were left."""
        return sum(0.5 * gram(n, [], r, [c.held[::EVERY]])[0].square for n, r, c in zip(
            self.noise, self.residual, self.cases))

    def _train_cost(self, values: dict[str, float]) -> float:
        return sum(gram(n, [], r, [c.train[::EVERY]])[0].square for n, r, c in zip(
            self.noise, self.residuals(values), self.cases))

    def terms_in(self, parts: Sequence[str]) -> tuple[Term, ...]:
        """Return the terms of some effects, or of axes of them."""
        return tuple(t for t in self.terms if t.part in parts)

    def judged(self, values: dict[str, float]) -> tuple[Score, float]:
        """Score and size of what other values explain on held-out blocks."""
        total, size = Gram(np.zeros((1, 1)), np.zeros(1), 0.0, 0), 0.0
        for case, noise, before, after in zip(
                self.cases, self.noise, self.residual, self.residuals(values)):
            difference = before - after
            total = total + gram(noise, [_column(difference)], before, [case.held[::EVERY]])[0]
            for rows in ((case.held & (case.groups == g))[::EVERY] for g in range(2)):
                level = np.maximum(noise.sigma[0] / COLOUR, 1e-12)
                if rows.sum() > 12:
                    share = np.sqrt(np.mean(difference[rows] ** 2, axis=0)) / level
                    size = max(size, float(share[noise.sigma.any(axis=0)].max(initial=0.0)))
        none: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        return score(total, np.zeros(1), np.ones(1), none, np.zeros((0, 0))), size

    def _grams(self, terms: Sequence[Term], values: dict[str, float],
               units: Sequence[float] | None = None) -> tuple[Gram, Gram]:
        k = len(terms)
        train = held = Gram(np.zeros((k, k)), np.zeros(k), 0.0, 0)
        for case, noise in zip(self.cases, self.noise):
            here = predict(case, values)
            columns = []
            for i, term in enumerate(terms):
                unit = term.unit_size if units is None else units[i]
                step = min(unit, 5e-4) if term.name in DELAYS else unit
                moved = {**values, term.name: values.get(term.name, 0.0) + step}
                columns.append(_column(case.slow(predict(case, moved) - here) * (unit / step)))
            a, b = gram(noise, columns, case.slow(case.measured - here),
                        [case.train[::EVERY], case.held[::EVERY]])
            train, held = train + a, held + b
        return train, held


def _noise(case: MotionCase, residual: Array) -> Autoregression:
    """
    Take what remains for white noise, somewhat stronger than it is since it is not white.

    An autoregression of so few rows, smoothed ones, would have a root near 1, to which a constant
    is nothing.
    """
    there = [residual[case.present_slow[:, c], c] for c in range(residual.shape[1])]
    sigma = np.array([COLOUR * np.std(r) if len(r) >= FEWEST else 0.0 for r in there])
    groups: NDArray[np.intp] = np.zeros(len(residual), dtype=np.intp)
    return Autoregression(np.zeros((1, len(sigma), ORDER)), sigma[np.newaxis],
                          case.present_slow & (sigma > 0.0), case.present_slow, groups)


def _column(difference: Array) -> Column:
    return column(difference, np.full(difference.shape[1], 1e-6))
