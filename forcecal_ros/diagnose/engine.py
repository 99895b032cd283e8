"""
The engine of every diagnosis: search for effects, judge them, localise, and say it.

The ways in (``by_*``) differ in the simulation that they bring, and go on alike from there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from forcecal_ros.diagnose.inputs.accelerometer import in_volts
from forcecal_ros.diagnose.inputs.channels import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.inputs.dataset import Dataset
from forcecal_ros.diagnose.inputs.requirements import missing_streams
from forcecal_ros.diagnose.inputs.residuals import MeasuredBlocks
from forcecal_ros.diagnose.inputs.stamps import Corrected
from forcecal_ros.diagnose.judge.coverage import (
    not_excited,
    refuse_unjudged,
    shares,
    signal_to_noise,
    unjudged,
)
from forcecal_ros.diagnose.judge.equivalents import equivalent, odds, why
from forcecal_ros.diagnose.judge.gap import (
    Errors,
    Gap,
    measured_gap,
    parameter_errors,
    sample_noise,
    unpredictable,
)
from forcecal_ros.diagnose.judge.named_effects import (
    at_limit,
    begun_or_ended,
    channel_affected_most,
    Checks,
    from_checks,
    in_time,
    named_steps,
    NamedEffect,
    parameters_of,
    untold,
)
from forcecal_ros.diagnose.judge.probabilities import nameless, probabilities, SURE, UNKNOWN
from forcecal_ros.diagnose.judge.residual_summary import (
    fitted_to_all,
    lines_of,
    predictable,
    ResidualSummary,
    summarise_residual,
    unexplained,
    UnexplainedPart,
    WANDERING,
)
from forcecal_ros.diagnose.judge.stated_errors import with_taken
from forcecal_ros.diagnose.judge.ties import note_of, tied, with_tie
from forcecal_ros.diagnose.localise.localisation import localise, Location, stage_of
from forcecal_ros.diagnose.localise.predictability import Predictability
from forcecal_ros.diagnose.localise.time_frequency import BANDS, Line
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.hypotheses import hypotheses, Hypothesis, releases
from forcecal_ros.diagnose.model.linearised import linearised_model, LinearisedModel
from forcecal_ros.diagnose.model.saturation import CLIPPING
from forcecal_ros.diagnose.say.patched import patched_rig
from forcecal_ros.diagnose.say.result import Diagnosis
from forcecal_ros.diagnose.say.verdict import verdict
from forcecal_ros.diagnose.search.acceptance import least_evidence
from forcecal_ros.diagnose.search.bias_steps import Event, with_steps
from forcecal_ros.diagnose.search.onset_selection import Found, with_onsets
from forcecal_ros.diagnose.search.onsets import Instant
from forcecal_ros.diagnose.search.selection import nearest, select, Selection
from forcecal_ros.diagnose.search.tolerances import narrowed
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import at_standstill
from forcecal_ros.recording.streams import Recording
import numpy as np

WITHOUT_MEAN = ('wrench_quantisation', 'dropouts')
"""Effects that move no signal's mean."""

CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""

FAINT = 1e-3
"""Probability below which an effect that a discrepancy may only look like is not listed."""

LINES = 2
"""Lines that a discrepancy may have: mains and a motor."""

UNTOLD = ('no_gap', 'unknown')
"""Verdicts that name no effect, although the motion could show one."""

ENOUGH = 3.0
"""Scatter of a simulated signal, in its noise, from which a recording can answer."""


@dataclass(frozen=True)
class Outcome:
    """
    A diagnosis and what it rests on.

    Attributes
    ----------
    rig : Rig
        Recalibrated, with the effects.
    recalibrations : dict of str to (float, float)
        Nuisance -> how far it moved, and its standard error; relative where its
        tolerance is.
    recalibrated, explained : tuple of ndarray, shape (n, channels)
        Measured less simulated, in block means, of each recording.
    noise : ndarray, shape (channels,)
        RMS of one sample of each channel.
    selection : Selection or None
        What was accepted, at its fit.
    checks : Checks or None
        What the data said before.
    """

    diagnosis: Diagnosis
    rig: Rig
    recalibrations: dict[str, tuple[float, float]] = field(default_factory=dict)
    recalibrated: tuple[Array, ...] = ()
    explained: tuple[Array, ...] = ()
    datasets: tuple[Dataset, ...] = ()
    noise: Array | None = None
    selection: Selection | None = None
    checks: Checks | None = None


class _Judged(NamedTuple):
    """What the search found, weighed: of each effect, of the whole, and of what is unexplained."""

    summary: ResidualSummary
    part: UnexplainedPart
    gap: Gap
    noise: Array
    effects: tuple[NamedEffect, ...]
    candidates: list[tuple[str, float]]
    word: str
    sentence: str
    notes: tuple[str, ...]


def diagnose_datasets(rig: Rig, datasets: tuple[Dataset, ...], stamps: Sequence[Corrected],
                      given: Sequence[Recording]) -> Outcome:
    """
    Diagnose recordings that are ready.

    Parameters
    ----------
    datasets : tuple of Dataset
        To fit on and to judge on.
    stamps : sequence of Corrected
        What their stamps and values show.
    given : sequence of Recording
        As recorded.
    """
    observed = [_observed(c, s.stamped, rig) if s.skew else c.measured
                for c, s in zip(datasets, stamps)]
    first = linearised_model(rig, datasets)
    try:
        refuse_unjudged(first)
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rig)
    checks = Checks(*from_checks(stamps, sample_noise(first, np.zeros(len(CHANNELS))),
                                 rig.accelerometer.model(datasets[0].simulation.accelerometer)))
    outcome = _searched(first, checks, observed, given)
    if not _is_untold(outcome):
        return outcome
    closer = narrowed(first, releases(first))
    if closer is None:
        return outcome
    within = _searched(closer.model, checks, observed, given)
    told = within.diagnosis
    if _is_untold(within) or (told.remainder or {}).get('ratio', np.inf) > 1.0:
        return outcome
    return replace(within, diagnosis=replace(told, notes=(*told.notes, str(closer))))


def _is_untold(outcome: Outcome) -> bool:
    """Say whether nothing was named, neither before nor in the search."""
    effects = outcome.diagnosis.effects
    return outcome.diagnosis.verdict in UNTOLD and all(e.name == UNKNOWN for e in effects)


def _searched(first: LinearisedModel, checks: Checks, observed: list[MeasuredBlocks],
              given: Sequence[Recording]) -> Outcome:
    """Search for effects beside tolerances as a model has them, and judge them."""
    known = _with_known(first, checks)
    model, events = with_steps(known)
    frequencies = _strongest(lines_of(model))
    if frequencies:
        model.allow_discrepancy(frequencies)
        model.refit_noise(np.zeros(len(model.nuisances)))
    found = hypotheses(model, frequencies[0] if frequencies else None)
    model, selection, events, instants = with_onsets(
        first, known, Found(model, select(model, found, first), events, {}), found)
    judged = _judge(first, model, selection, found, checks, observed, events, instants)
    where = _localised(selection, judged.summary.predictability, checks)
    return _say(first, model, selection, judged, Diagnosis(
        judged.word, judged.sentence, judged.effects, tuple(judged.candidates), where, judged.gap,
        tuple(not_excited(model, found)), (*checks.notes, *judged.summary.notes, *judged.notes),
        {'ceiling_sigma': float(judged.summary.predictability.z.max()),
         'cell_sigma': judged.summary.strongest[0].z, 'ratio': judged.part.ratio},
        shares(model, given)), checks, observed)


def _with_known(first: LinearisedModel, checks: Checks) -> LinearisedModel:
    """Give a model the limits that samples show by themselves."""
    known = {name: {k: v.value for k, v in found.items()}
             for name, found in checks.effects.items() if name in CLIPPING}
    if not known:
        return first
    model = replace(first, fixed=known, centre=first.centre.copy())
    model.evaluate()
    model.recalibrate()
    return model


def _strongest(lines: Sequence[Line]) -> list[float]:
    """Return the frequencies of the strongest lines, those of one and the same line once."""
    out: list[float] = []
    for line in sorted(lines, key=lambda one: -one.power):
        if all(abs(line.frequency - f) > WANDERING * f for f in out):
            out.append(line.frequency)
    return out[:LINES]


def _observed(dataset: Dataset, recording: Recording, rig: Rig) -> MeasuredBlocks:
    """Take a recording by the stamps that it came with."""
    if 'joints' not in dataset.measured.streams:
        recording = replace(recording, joints=None)
    return MeasuredBlocks(in_volts(recording, rig, dataset.simulation.accelerometer),
                          dataset.measured.start, dataset.measured.n_blocks)


def _judge(first: LinearisedModel, model: LinearisedModel, selection: Selection,
           found: Sequence[Hypothesis], checks: Checks, observed: list[MeasuredBlocks],
           events: tuple[Event, ...], instants: Mapping[str, Instant]) -> _Judged:
    """Weigh what was found: share of the misfit, probabilities, what is unexplained, verdict."""
    final = selection.model
    with_discrepancy = final.discrepancy_scales != NO_DISCREPANCY
    summary = summarise_residual(fitted_to_all(final, selection.jacobians),
                                 selection.discrepancy_evidence)
    part = unexplained(summary)
    gap, noise, errors = _measured(first, selection, summary, observed)
    in_wrench = float(selection.missing_by_stream[list(STREAM_SLICES).index('wrench')])
    steps = named_steps(final, events, least_evidence(
        in_wrench, list(selection.log_bayes_factors.values())))
    sudden = {e.name: e.probability for e in steps}
    known = len(model.fixed) + len(sudden)
    doubts = nameless(selection.log_bayes_factors, selection.missing_evidence, known)
    numbers = {a.name: parameters_of(final, a) for a in selection.accepted}
    period = _period(final)
    lags = {name: other for name, values in numbers.items()
            if (other := tied(name, values, period)) and other not in numbers}
    alike = {name: other for name, values in numbers.items()
             if (other := equivalent(final, name, values, selection.log_bayes_factors[name]))}
    ties = {**alike, **lags}
    probability, candidates = probabilities(
        [(a.name, with_tie(selection.alternatives.get(a.name, {}), ties.get(a.name, ''),
                           odds(a.name, ties.get(a.name, ''))))
         for a in selection.accepted], part,
        gap.closed, known, doubts if with_discrepancy else None, selection.log_bayes_factors,
        {} if selection.accepted or part.ratio < 1.0 else nearest(selection, found))
    candidates = _sorted([*candidates, *sudden.items(), *((n, CHECKED) for n in checks.effects)])
    named = list(numbers)
    word, sentence = verdict(
        [*named, *sudden, *checks.effects], candidates, part,
        gap.closed if named or model.fixed or sudden else None,
        signal_to_noise(model) > ENOUGH or bool(checks.effects) or bool(steps),
        whole=not unjudged(model), with_discrepancy=with_discrepancy,
        at_limit=[x for name, values in numbers.items() for x in at_limit(name, values)])
    less = nameless({**selection.log_bayes_factors, **selection.doubtful},
                    selection.missing_evidence, known)
    possible = {name: 1.0 - less[name] for name in selection.doubtful}
    candidates = _sorted([*candidates, *((n, p) for n, p in possible.items() if p > FAINT)])
    stated = with_taken(final, selection.accepted, numbers, errors, gap.closed)
    named_ones = [begun_or_ended(NamedEffect(name, values, probability[name]), final, instants)
                  for name, values in stated.items()]
    sentence += in_time([*named_ones, *steps]) + missing_streams(final.datasets[0].recording)
    effects = (*named_ones, *steps,
               *(NamedEffect(n, v, CHECKED) for n, v in checks.effects.items()))
    return _Judged(summary, part, gap, noise, effects, candidates, word,
                   sentence + unjudged(model),
                   (*(note for a in selection.accepted for note in untold(final, a)),
                    *(note_of(name, other, period) for name, other in lags.items()),
                    *(why(name, other) for name, other in alike.items())))


def _period(model: LinearisedModel) -> float:
    """Time between samples of the wrench, the longest of any recording [s]; 0 without one."""
    wrenches = [dataset.recording.wrench for dataset in model.datasets]
    return max((1.0 / w.rate for w in wrenches if w is not None and len(w) > 1), default=0.0)


def _sorted(candidates: list[tuple[str, float]]) -> list[tuple[str, float]]:
    """List every name once, the most probable first."""
    highest: dict[str, float] = {}
    for name, p in candidates:
        highest[name] = max(p, highest.get(name, 0.0))
    return sorted(highest.items(), key=lambda pair: -pair[1])


def _say(first: LinearisedModel, model: LinearisedModel, selection: Selection, judged: _Judged,
         diagnosis: Diagnosis, checks: Checks, observed: list[MeasuredBlocks]) -> Outcome:
    """Return the diagnosis with the rig that it leads to; what is not named is not added to it."""
    final, noise = selection.model, judged.noise
    if judged.word in ('unknown', 'not_excited'):
        # a gap without a name looks like noise
        final = replace(model, noise=[at_standstill(b, n)
                                      for b, n in zip(model.residuals, model.noise)])
        selection = Selection(final, (), (), {})
        gap, noise, _ = _measured(first, selection, summarise_residual(final), observed)
        unknown = NamedEffect(UNKNOWN, {}, dict(judged.candidates).get(UNKNOWN, SURE))
        diagnosis = replace(diagnosis, gap=gap, effects=(unknown,))
    if judged.word == 'not_excited':
        diagnosis = replace(diagnosis, effects=(), candidates=())
    return Outcome(diagnosis, patched_rig(final, selection, checks), _moved(final),
                   tuple(first.residuals), tuple(final.residuals), final.datasets, noise,
                   selection, checks)


def _measured(first: LinearisedModel, selection: Selection, summary: ResidualSummary,
              observed: list[MeasuredBlocks]) -> tuple[Gap, Array, Errors]:
    """Return the gap in its three arms, the noise of one sample of every channel, and errors."""
    final = selection.model
    moved = [predictable(summary.predictability, i) for i in range(len(final.datasets))]
    errors = parameter_errors(final, selection.jacobians)
    energy = unpredictable(final, summary.strongest, moved)
    nameless = energy if not selection.accepted else 0.0
    noise = sample_noise(final, errors.expected() + nameless, moved)
    before = [o.residual(first.signals(i)) for i, o in enumerate(observed)]
    nominal = [o.residual(c.nominal) for o, c in zip(observed, first.datasets)]
    beside = moved if errors.predicted is None else errors.predicted.rows
    return (measured_gap(first, final, (nominal, before, beside), noise, energy, errors), noise,
            errors)


def _moved(model: LinearisedModel) -> dict[str, tuple[float, float]]:
    std = np.sqrt(np.diag(model.fit_nuisances().covariance))
    return {n.name: (float(x * size), float(s * size)) for n, x, s, size in zip(
        model.nuisances, model.centre, std, model.prior_std)}


def _localised(selection: Selection, predictability: Predictability, checks: Checks
               ) -> tuple[Location, ...]:
    """Say where the effects change the simulation, and where else the residual is no noise."""
    final = selection.model
    before = final.without_effects().residuals
    differences = [b - a + predictable(predictability, i)
                   for i, (b, a) in enumerate(zip(before, final.residuals))]
    stages = {final.library[n].stage
              for n in (*(a.name for a in selection.accepted), *checks.effects)}
    if any(n.acts_on == 'step' for n in final.nuisances):
        stages.add('wrench_sensor')

    def stage(channel: str, phase: str, touched: set[str]) -> str:
        return next(iter(stages)) if len(stages) == 1 else stage_of(channel, phase, touched)

    sensors = [[c for n, c in zip(final.nuisances, columns) if n.acts_on in ('wrench', 'volts')]
               for columns in final.jacobian]
    found = localise(final.datasets, final.noise, before, differences, stage, sensors)
    phase = max(final.datasets[-1].phases, key=lambda one: one.end - one.start).name
    shown = tuple(Location(EFFECTS[n].stage, channel_affected_most(n, v), phase, BANDS[-1],
                           max(q.value for q in v.values()), 0.0)
                  for n, v in checks.effects.items() if n in WITHOUT_MEAN)
    return (*shown, *found)
