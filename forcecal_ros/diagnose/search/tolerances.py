"""
How far tolerances go in a recording, where one number alone goes beyond its own.

Tolerances say how far each number may be off. Where all of them are wider than the robot's numbers
are off, a few can share what one of them has, each within its tolerance, and nothing is left to be
named. So two explanations are weighed by their marginal likelihood: all numbers are off as
tolerances say, or by one common part of that; or one of them is beyond its tolerance, and the
others are off by such a part. Where the latter wins, the search begins anew within it.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.model.evidence import Fit, fit, Gram, Prior
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel, RELEASED
from forcecal_ros.diagnose.search.acceptance import LEAST_GAIN
from forcecal_ros.effects.nuisances import LIMIT
import numpy as np
from numpy.typing import NDArray

PARTS = (0.5, 1.0)
"""
Parts of their tolerances by which numbers may be off, all alike: a table of usual ones may be
twice as wide as a robot needs. Less would take a tool's mass for exact where a gain goes with it.
"""

SURE = 3.0
"""Standard errors that a number has to be beyond its tolerance, and that others are given."""


class Narrowed(NamedTuple):
    """
    A model with narrower tolerances.

    Attributes
    ----------
    model : LinearisedModel
        Recalibrated within them.
    part : float
        Of their tolerances, by which numbers are off.
    beyond : tuple of (str, float)
        Numbers beyond their tolerance, and how many of their prior standard deviations.
    """

    model: LinearisedModel
    part: float
    beyond: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        far = ' and '.join(f'{name} is {abs(x):.2g} sigma off' for name, x in self.beyond)
        within = 'half their' if self.part < 1.0 else 'their'
        return (f'{far}; the others are likelier to be within {within} tolerances than to share '
                'that, and were given as much')


class _Way(NamedTuple):
    """One explanation: its log-evidence, and what it releases and finds."""

    evidence: float
    part: float
    released: NDArray[np.bool_]
    x: Array
    std: Array


def narrowed(model: LinearisedModel, releases: Sequence[Hypothesis]) -> Narrowed | None:
    """
    Narrow the tolerances where the recording itself says that one number is beyond its own.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated, no effect accepted.
    releases : sequence of Hypothesis
        Those that lift the prior of nuisances.

    Returns
    -------
    Narrowed or None
        None where numbers within their tolerances are as likely, and of rigs whose files state
        tolerances: those of a simulator's numbers are usual ones.
    """
    if not model.datasets[0].simulation.usual_tolerances:
        return None
    names = [n.name for n in model.nuisances]
    own = np.isin(names, [n for h in releases for way in h.releases for n in way])
    train, held = model.grams([[] for _ in model.datasets])
    gram = train + held
    usual = max(_tried(model, gram, own, np.zeros(len(names), bool), part).evidence
                for part in PARTS)
    ways = [(np.isin(names, list(way)), np.log(h.ways)) for h in releases for way in h.releases]
    tried = [_tried(model, gram, own, way, part, cost) for way, cost in ways for part in PARTS]
    best = max(tried, key=lambda one: one.evidence)
    beyond = best.released & (np.abs(best.x) - SURE * best.std > LIMIT)
    if best.evidence - usual < LEAST_GAIN + np.log(len(releases)) or not beyond.any():
        return None
    # the others as wide as the fit with it has them, or they would be found beyond theirs
    needed = np.where(best.released, 0.0, (np.abs(best.x) + SURE * best.std) / LIMIT)
    widths = np.where(own, np.clip(needed, best.part, 1.0), 1.0)
    out = replace(model, widths=widths)
    prior = out.prior()
    out.centre = np.clip(model.centre, prior.low, prior.high)
    out.evaluate()
    out.recalibrate()
    return Narrowed(out, best.part, tuple(
        (name, float(x)) for name, x, there in zip(names, best.x, beyond) if there))


def _tried(model: LinearisedModel, gram: Gram, own: NDArray[np.bool_],
           released: NDArray[np.bool_], part: float, cost: float = 0.0) -> _Way:
    """Fit all numbers without bounds, some of them free of their tolerance."""
    precision = np.where(released, RELEASED, np.where(own, part ** -2.0, 1.0))
    endless = np.full(len(own), np.inf)
    found: Fit = fit(gram, Prior(model.centre, precision, -endless, endless))
    return _Way(found.log_evidence - cost, part, released, model.centre + found.x,
                np.sqrt(np.diag(found.covariance)))
