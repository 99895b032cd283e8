"""What a search found, weighed: numbers, ties, probabilities, and what is unexplained."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import MeasuredBlocks, STREAM_SLICES
from forcecal_ros.diagnose.judge.gap import Gap, measured_gap
from forcecal_ros.diagnose.judge.named_effects import (
    begun_or_ended,
    Checks,
    named_steps,
    NamedEffect,
    Parameter,
    parameters_of,
)
from forcecal_ros.diagnose.judge.probabilities import listed_once, nameless, probabilities, Slot
from forcecal_ros.diagnose.judge.residual_summary import (
    fitted_to_all,
    ResidualSummary,
    summarise_residual,
    unexplained,
    UnexplainedPart,
)
from forcecal_ros.diagnose.judge.stated_errors import with_taken
from forcecal_ros.diagnose.judge.ties import Tie, ties_of
from forcecal_ros.diagnose.model.hypotheses import Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.acceptance import least_evidence
from forcecal_ros.diagnose.search.onset_selection import Found
from forcecal_ros.diagnose.search.selection import nearest, Selection

CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""

FAINT = 1e-3
"""Probability below which an effect that a discrepancy may only look like is not listed."""


class Judged(NamedTuple):
    """
    What was found, weighed: each effect, the whole, and what is unexplained.

    ``numbers`` are those of accepted effects as the fit knows them, ``steps`` those of the bias
    among all ``effects``; what is ``doubtful`` may be a discrepancy that looks like an effect.
    """

    summary: ResidualSummary
    part: UnexplainedPart
    gap: Gap
    noise: Array
    numbers: dict[str, dict[str, Parameter]]
    effects: tuple[NamedEffect, ...]
    steps: tuple[NamedEffect, ...]
    ties: dict[str, Tie]
    candidates: list[tuple[str, float]]
    doubtful: list[tuple[str, float]]


def judge(first: LinearisedModel, found: Found, tried: Sequence[Hypothesis], checks: Checks,
          observed: list[MeasuredBlocks]) -> Judged:
    """Weigh what was found among all effects that were tried."""
    model, selection, events, instants = found
    final = selection.model
    summary = summarise_residual(fitted_to_all(final, selection.jacobians),
                                 selection.discrepancy_evidence)
    part = unexplained(summary)
    gap, noise, errors = measured_gap(first, selection, summary, observed)
    in_wrench = float(selection.missing_by_stream[list(STREAM_SLICES).index('wrench')])
    steps = tuple(named_steps(final, events, least_evidence(
        in_wrench, list(selection.log_bayes_factors.values())), selection.beside_discrepancy))
    checked = tuple(NamedEffect(n, v, CHECKED) for n, v in checks.effects.items())
    numbers = {a.name: parameters_of(final, a) for a in selection.accepted}
    ties = ties_of(final, numbers, selection.log_bayes_factors)
    known = len(model.fixed) + bool(steps)
    probability, candidates = _weighed(selection, tried, ties, part, gap.closed, known)
    stated = with_taken(final, selection.accepted, numbers, errors, gap.closed)
    named = [begun_or_ended(NamedEffect(name, values, probability[name]), final, instants)
             for name, values in stated.items()]
    candidates += [(e.name, e.probability) for e in (*steps, *checked)]
    return Judged(summary, part, gap, noise, numbers, (*named, *steps, *checked), steps, ties,
                  listed_once(candidates), _doubtful(selection, known))


def _weighed(selection: Selection, tried: Sequence[Hypothesis], ties: Mapping[str, Tie],
             part: UnexplainedPart, closed: float, known: int
             ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """Return the probability of each accepted effect, and the candidates."""
    factors = selection.log_bayes_factors
    doubts = (nameless(factors, selection.missing_evidence, known)
              if selection.beside_discrepancy else None)
    closest = {} if selection.accepted or part.ratio < 1.0 else nearest(selection, tried)
    return probabilities(
        [Slot(a.name, selection.alternatives.get(a.name, {}), ties.get(a.name))
         for a in selection.accepted], part, closed, known, doubts, factors, closest)


def _doubtful(selection: Selection, known: int) -> list[tuple[str, float]]:
    """List the effects that a discrepancy may only look like, but for the faintest."""
    less = nameless({**selection.log_bayes_factors, **selection.doubtful},
                    selection.missing_evidence, known)
    return [(name, 1.0 - less[name]) for name in selection.doubtful if 1.0 - less[name] > FAINT]
