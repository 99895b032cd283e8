"""
What a simulator has no number for, but would look like one that was named: play like friction.

A drive with play leaves its joint where it is until the command has crossed the play, as friction
does; only the way back to the command differs. So where a number is named, the simulator is run
with what looks like it instead, and what is nearer to the robot counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import Dataset
from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.model.jacobian import combined
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.verdict import percent, UNKNOWN
from forcecal_ros.sim.protocol import Imitation
from forcecal_ros.sim.rerun import Rerun, SimulatedRobot
from forcecal_ros.sim.runs import Numbers
from forcecal_ros.sim.third_party import ThirdParty
import numpy as np

APART = 0.05
"""
Share of the misfit by which the one has to explain more than the other: the width of most
confidence intervals of that share.
"""

SIZES, LARGER = (0.6, 0.9, 1.2), (1.6, 2.1, 2.8)
"""
Of what is imitated, in the size at which it looks most alike by its effect at rest, and those
tried as long as the largest is the best; the best is that of the parabola through three of them.
"""


class Tried(NamedTuple):
    """
    An imitation, at its best size.

    Attributes
    ----------
    of : str
        The number that it looks like.
    numbers : tuple of float
        Of the simulator beside it: that one as it was.
    left : float
        Sum of squares of what it leaves on judged blocks, in noise RMS.
    """

    imitation: Imitation
    of: str
    numbers: Numbers
    value: float
    std: float
    left: float


def tried(simulations: Sequence[Rerun], judged: Sequence[Dataset], outcome: Outcome,
          simulator: ThirdParty) -> Tried | None:
    """
    Run the simulator with what looks like the first number named, in its place.

    Returns
    -------
    Tried or None
        None where nothing looks like it.
    """
    nominal = {p.name: (i, p.nominal) for i, p in enumerate(simulator.parameters)}
    first = next((e.name for e in outcome.diagnosis.effects if e.name in nominal), '')
    if not first or outcome.selection is None or not isinstance(outcome.rig, SimulatedRobot):
        return None
    i, before = nominal[first]
    imitation = simulator.imitation(first, outcome.rig.numbers[i] - before)
    if imitation is None:
        return None
    model = _without(outcome.selection.model, first)
    rig = model.current()
    assert isinstance(rig, SimulatedRobot)
    squares: list[float] = []
    for size in (*SIZES, *LARGER):
        if len(squares) >= len(SIZES) and squares[-1] > min(squares):
            break
        squares.append(_left(simulations, judged, replace(model), outcome.noise,
                             {imitation.name: size * imitation.value}))
    value, std, left = _best(np.array([*SIZES, *LARGER][:len(squares)]), np.array(squares))
    at = imitation.value
    return Tried(imitation, first, rig.numbers, value * at, std * abs(at), left)


def _without(model: LinearisedModel, name: str) -> LinearisedModel:
    """Put a number and all that was recalibrated beside it back to where they were."""
    stays = np.array([n.name in model.released - {name} for n in model.nuisances], dtype=bool)
    return replace(model, released=model.released - {name},
                   centre=np.where(stays, model.centre, 0.0))


def _left(simulations: Sequence[Rerun], judged: Sequence[Dataset], model: LinearisedModel,
          noise: Array | None, beside: Mapping[str, float]) -> float:
    """Return what is left on judged blocks with something beside, all others recalibrated."""
    rig = model.current()
    assert isinstance(rig, SimulatedRobot)
    assert noise is not None
    model.residuals = [d.measured.residual(one.otherwise(rig.numbers, beside).signals(rig))
                       for one, d in zip(simulations, model.datasets)]
    x, total = model.fit_nuisances().x, 0.0
    for residual, columns, dataset in zip(model.residuals, model.jacobian, judged):
        rows = residual - combined(columns, x, len(residual))
        rows = np.where(dataset.measured.present, rows, 0.0)[dataset.held]
        total += float(np.sum((rows / np.where(noise > 0.0, noise, np.inf)) ** 2))
    return total


def _best(sizes: Array, squares: Array) -> tuple[float, float, float]:
    """Return the size at which squares are least, its standard error, and what they are there."""
    least = int(np.argmin(squares))
    middle = min(max(least, 1), len(sizes) - 2)
    around = slice(middle - 1, middle + 2)
    a, b, c = np.polyfit(sizes[around], squares[around], 2)
    at = -b / (2.0 * a) if a > 0.0 else np.nan
    if not sizes[0] <= at <= sizes[-1]:
        return float(sizes[least]), float(sizes[1] - sizes[0]), float(squares[least])
    return float(at), float(1.0 / np.sqrt(a)), float(max(c - b ** 2 / (4.0 * a), 0.0))


def judged_beside(outcome: Outcome, other: Tried, squares: Array) -> Outcome:
    """
    Name what was tried, offer it beside the number that was named, or leave it.

    Parameters
    ----------
    squares : ndarray, shape (3,)
        On judged blocks: recalibrated, as predicted, and when run with the number named.
    """
    before, _, named = squares.tolist()
    d = outcome.diagnosis
    if d.gap is None or before <= 0.0:
        return outcome
    more = (named - other.left) / before
    if more < -APART:
        return outcome
    share = d.gap.closed * (before - other.left) / max(before - named, 1e-12)
    share, name = float(min(share, 1.0)), other.imitation.name
    sure = next((e.probability for e in d.effects if e.name == other.of), 0.5)
    if more <= APART:
        candidates = _with(d.candidates, name, sure)
        return replace(outcome, diagnosis=replace(
            d, verdict='ambiguous', candidates=candidates,
            reason=f'{d.reason}; or else {name} explains {percent(share)}, and '
                   f'{other.imitation.words}'))
    found = NamedEffect(name, {'value': Parameter(other.value, other.std, other.imitation.unit)},
                        sure)
    effects = (found, *(e for e in d.effects if e.name not in (other.of, UNKNOWN)))
    candidates = _with([c for c in d.candidates if c[0] not in (other.of, UNKNOWN)], name, sure)
    listed = ' and '.join(e.name for e in effects)
    assert isinstance(outcome.rig, SimulatedRobot)
    return replace(outcome, rig=replace(outcome.rig, numbers=other.numbers), diagnosis=replace(
        d, verdict='identified', effects=effects, candidates=candidates,
        gap=d.gap._replace(closed=share),
        reason=f'{listed} explain{"" if len(effects) > 1 else "s"} {percent(share)} of the '
               f'misfit, {other.of} in its place {percent(d.gap.closed)}; '
               f'{other.imitation.words}'))


def _with(candidates: Sequence[tuple[str, float]], name: str, probability: float
          ) -> tuple[tuple[str, float], ...]:
    return tuple(sorted([*candidates, (name, probability)], key=lambda pair: -pair[1]))
