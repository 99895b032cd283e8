"""What a search found, weighed: numbers, probabilities, and what is unexplained."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import MeasuredBlocks
from forcecal_ros.diagnose.judge.gap import Gap, measured_gap
from forcecal_ros.diagnose.judge.named_effects import (
    at_limit,
    Checks,
    in_its_time,
    NamedEffect,
    Parameter,
    parameters_of,
)
from forcecal_ros.diagnose.judge.parameter_errors import Errors, with_taken
from forcecal_ros.diagnose.judge.residual_summary import (
    ResidualSummary,
    summarise_residual,
    unexplained,
)
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.calibration import Calibration, stored
from forcecal_ros.diagnose.search.posterior import Posterior
from forcecal_ros.diagnose.verdict import NAMED, UnexplainedPart, UNKNOWN

ALIAS_ODDS = 0.05
"""Odds of another effect in the place of an accepted one from which both are listed."""

SEPARATED_BY: Mapping[frozenset[str], str] = {
    frozenset(pair): words for *pair, words in (
        ('wrench_delay', 'wrench_lowpass', 'a faster recording, or a motion up to the corner'),
        ('accel_misalignment', 'wrench_crosstalk', 'the accelerometer at rest'),
        ('tool_com', 'wrench_crosstalk', 'contact at a known place'),
        ('tool_mass', 'wrench_gain', 'a known force'),
        ('base_tilt', 'cable_force', 'a level on the base'),
        ('accel_delay', 'accel_resonance', 'a sweep up to the resonance'),
        ('tool_stiffness', 'tool_damping', 'a sweep about the resonance of the tool'),
        ('contact_stiffness', 'wall_position', 'contacts of several depths'))}
"""Pair of effects, and what separates them."""


def ties_of(found: Posterior) -> tuple[str, ...]:
    """Note the likeliest alias of each accepted effect, if one is about as likely."""
    out = []
    for name, features in found.features.items() if found.closest is None else ():
        odds = stored().odds(features, found.alternatives[name])
        other = max(odds, key=lambda one: odds[one], default='')
        if other and odds[other] > ALIAS_ODDS:
            by = SEPARATED_BY.get(frozenset((name, other)), 'what forcecal plan writes')
            out.append(f'{name} and {other} are confounded in this recording; they are '
                       f'separated by {by}')
    return tuple(out)


CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""

CANDIDATES = 0.95
"""Probability that the candidate set covers."""


class Judged(NamedTuple):
    """
    What was found, weighed: each effect, the whole, and what is unexplained.

    ``numbers`` are those of accepted effects as the fit knows them; ``limits`` those of them that
    would be larger if the library let them.
    """

    summary: ResidualSummary
    part: UnexplainedPart
    gap: Gap
    errors: Errors
    noise: Array
    numbers: dict[str, dict[str, Parameter]]
    effects: tuple[NamedEffect, ...]
    ties: tuple[str, ...]
    candidates: list[tuple[str, float]]
    limits: list[str]


def judge(first: LinearisedModel, found: Posterior, checks: Checks,
          observed: list[MeasuredBlocks]) -> Judged:
    """Weigh what was found."""
    final = found.model
    summary = summarise_residual(final, found.discrepancy_evidence)
    part = unexplained(summary)
    gap, noise, errors = measured_gap(first, found, summary, observed)
    checked = tuple(NamedEffect(n, v, CHECKED) for n, v in checks.effects.items())
    numbers = {a.name: parameters_of(final, a) for a in found.accepted}
    limits = [x for name, values in numbers.items() for x in at_limit(name, values)]
    probabilities, candidates = weighed(found, part.ratio >= 1.0,
                                        gap.closed >= 0.0 and not limits)
    stated = with_taken(final, found.accepted, numbers, errors, gap.closed)
    named = [in_its_time(NamedEffect(name, values, probabilities[name]), final, found.instants)
             for name, values in stated.items()]
    candidates += [(e.name, e.probability) for e in checked]
    return Judged(summary, part, gap, errors, noise, numbers, (*named, *checked), ties_of(found),
                  listed_once(candidates), limits)


def weighed(found: Posterior, is_gap: bool, possible: bool, by: Calibration | None = None
            ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """
    Return the probability of each effect, and the candidates.

    What was not accepted, and what cannot be the cause as it was found, is a candidate, but never
    likelier than not.

    Parameters
    ----------
    is_gap : bool
        Whether something is unexplained.
    possible : bool
        Whether accepted effects can be the cause: the misfit of held-out data is no larger with
        them, and no number of theirs is at its limit.
    by : Calibration, optional
        Another than the one that diagnoses use.
    """
    by = by or stored()
    named: dict[str, float] = {}
    chosen: list[tuple[str, float]] = []
    accepted = found.closest is None
    most = 1.0 if accepted and possible else NAMED
    for name, features in found.features.items():
        whole = min(most, by.probability(features))
        weight = by.odds(features, found.alternatives[name])
        shares = {k: whole * w / (1.0 + sum(weight.values())) for k, w in weight.items()}
        named[name] = whole - sum(shares.values())
        if accepted or is_gap:
            chosen += _covering({name: named[name], UNKNOWN: 1.0 - whole, **shares})
    if not found.features and is_gap:
        chosen.append((UNKNOWN, 1.0))
    return named, chosen


def _covering(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    out, covered = [], 0.0
    for name, share in sorted(shares.items(), key=lambda pair: -pair[1]):
        if covered >= CANDIDATES:
            break
        out.append((name, share))
        covered += share
    return out


def listed_once(candidates: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    """List every name once, the most probable first."""
    highest: dict[str, float] = {}
    for name, p in candidates:
        highest[name] = max(p, highest.get(name, 0.0))
    return sorted(highest.items(), key=lambda pair: -pair[1])
