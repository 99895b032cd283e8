"""
The engine of every diagnosis: search for effects, judge them, localise, and say it.

The ways in (``by_*``) differ in the simulation that they bring, and go on alike from there.
"""

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, replace

from forcecal_ros.core.errors import DataError, with_id
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import at_standstill
from forcecal_ros.core.streams import Recording
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset, MeasuredBlocks
from forcecal_ros.diagnose.judge.coverage import (
    not_compared,
    not_excited,
    refuse_unjudged,
    shares,
    signal_to_noise,
)
from forcecal_ros.diagnose.judge.gap import measured_gap, sample_noise
from forcecal_ros.diagnose.judge.named_effects import (
    at_limit,
    at_tolerance,
    channel_affected_most,
    Checks,
    from_checks,
    in_its_time,
    in_time,
    NamedEffect,
    not_identified,
    parameters_of,
    readable,
)
from forcecal_ros.diagnose.judge.parameter_errors import (
    aliases,
    Errors,
    recalibrations,
    with_taken,
)
from forcecal_ros.diagnose.judge.residual_summary import (
    lines_of,
    summarise_residual,
    unexplained,
    WANDERING,
)
from forcecal_ros.diagnose.localise import BANDS, Line, localise, Location, stage_of
from forcecal_ros.diagnose.model.evidence import Earlier, FIRST_RECORDING
from forcecal_ros.diagnose.model.hypotheses import CLIPPING, hypotheses
from forcecal_ros.diagnose.model.linearised import linearised_model, LinearisedModel
from forcecal_ros.diagnose.recordings import convert_to_volts, Corrected
from forcecal_ros.diagnose.result import Diagnosis, patched_rig
from forcecal_ros.diagnose.search.posterior import listed_once, Posterior, search, ties_of, weighed
from forcecal_ros.diagnose.verdict import UNKNOWN, verdict
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import Rig
import numpy as np

report_stage: ContextVar[Callable[[str], None]] = ContextVar(
    'report_stage', default=lambda stage: None)
"""Takes the name of each stage as it begins."""

WITHOUT_MEAN = ('wrench_quantisation', 'dropouts')
"""Effects that move no signal's mean."""

ENOUGH = 3.0
"""Scatter of a simulated signal, in its noise, from which a recording can answer."""

CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""


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
    selection : Posterior or None
        What was accepted, at its fit.
    aliases : tuple of frozenset of str
        Nuisances of which the data tell little but a combination.
    closest : Rig or None
        With the effect that comes closest, if none was accepted.
    at_tolerance : tuple of str
        Nuisances that would be further off if their tolerances let them.
    """

    diagnosis: Diagnosis
    rig: Rig
    recalibrations: dict[str, tuple[float, float]] = field(default_factory=dict)
    recalibrated: tuple[Array, ...] = ()
    explained: tuple[Array, ...] = ()
    datasets: tuple[Dataset, ...] = ()
    noise: Array | None = None
    selection: Posterior | None = None
    aliases: tuple[frozenset[str], ...] = ()
    closest: Rig | None = None
    at_tolerance: tuple[str, ...] = ()


def diagnose_datasets(rig: Rig, datasets: tuple[Dataset, ...], stamps: Sequence[Corrected],
                      given: Sequence[Recording], tolerance: float | None = None,
                      earlier: Earlier = FIRST_RECORDING) -> Outcome:
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
    tolerance : float or None
        RMS of what is unexplained, in that of a channel's noise, that does not matter; None: as
        exact as the simulation is meant to be, TOLERANCE at least.
    earlier : Earlier
        What earlier recordings of the same robot found.
    """
    stage = report_stage.get()
    stage('re-estimating parameters within their tolerances')
    observed = [_observed(c, s.stamped, rig) if s.skew else c.measured
                for c, s in zip(datasets, stamps)]
    first = linearised_model(rig, datasets, tolerance, earlier)
    try:
        refuse_unjudged(first)
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', with_id(error)), rig)
    # recalibrated: a limit in volts is a specific force by the gain that the sensor has
    mounted = first.current().accelerometer.model(datasets[0].simulation.accelerometer)
    checks = from_checks(stamps, sample_noise(first, np.zeros(len(CHANNELS))), mounted)
    with np.errstate(over='ignore', invalid='ignore'):  # what diverges is rejected as such
        model = _with_known(first, checks)
        frequencies = _strongest(lines_of(model))
        if frequencies:
            model.allow_discrepancy(frequencies)
            model.refit_noise(np.zeros(len(model.nuisances)))
        tried = hypotheses(model, frequencies[0] if frequencies else None)
        stage('searching for effects')
        found = search(model, tried)
        stage('checking what was found')
        last = len(datasets) - 1
        if not all(gate.acts_in(last) for n, gate in found.model.gates.items()
                   if n in found.features):  # the last one alone would not show it
            first = first.split_by_second()
            found = found._replace(model=found.model.split_by_second())
        diagnosis, noise, errors = _judged(first, model, found, checks, observed)
        diagnosis = replace(diagnosis, not_excited=tuple(not_excited(model, tried)),
                            used=shares(model, given))
        return _outcome(first, model, found, diagnosis, noise, errors, checks, observed)


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
    return out[:2]  # mains and a motor


def _observed(dataset: Dataset, recording: Recording, rig: Rig) -> MeasuredBlocks:
    """Take a recording by the stamps that it came with."""
    if 'joints' not in dataset.measured.streams:
        recording = replace(recording, joints=None)
    return MeasuredBlocks(convert_to_volts(recording, rig, dataset.simulation.accelerometer),
                          dataset.measured.start, dataset.measured.n_blocks)


def _localised(selection: Posterior, predicted: Sequence[Array], checks: Checks
               ) -> tuple[Location, ...]:
    """Say where the effects change the simulation, and where else the residual is no noise."""
    final = selection.model
    before = final.without_effects().residuals
    differences = [b - a + more for b, a, more in zip(
        before, final.residuals, predicted)]
    stages = {final.library[n].stage
              for n in (*(a.name for a in selection.accepted), *checks.effects)}

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


def _judged(first: LinearisedModel, model: LinearisedModel, found: Posterior, checks: Checks,
            observed: list[MeasuredBlocks]) -> tuple[Diagnosis, Array, Errors]:
    """
    Weigh what was found, and state it in one word, one sentence, and notes.

    Returns
    -------
    diagnosis : Diagnosis
    noise : ndarray, shape (channels,)
        RMS of one sample.
    errors : Errors
    """
    final = found.model
    summary = summarise_residual(final, found.discrepancy_evidence)
    part = unexplained(summary)
    gap, noise, errors = measured_gap(first, found, summary, observed)
    numbers = {a.name: parameters_of(final, a) for a in found.accepted}
    limits = [x for name, values in numbers.items() for x in at_limit(name, values)]
    probabilities, candidates = weighed(found, part.ratio >= 1.0, gap.closed >= 0.0 and not limits)
    stated = with_taken(final, found.accepted, numbers, errors, gap.closed)
    effects = (*(in_its_time(NamedEffect(name, values, probabilities[name]), final, found.instants)
                 for name, values in stated.items()),
               *(NamedEffect(name, values, CHECKED) for name, values in checks.effects.items()))
    candidates = listed_once([*candidates, *((name, CHECKED) for name in checks.effects)])
    names = list(dict.fromkeys(final.library[n].name for n in numbers))
    missing = not_compared(model)
    # those of a simulator, which are what is looked for, are reported by its source
    limited = [readable(n.name) for n in at_tolerance(final) if n.prior_std is None]
    word, sentence = verdict(
        [*names, *checks.effects], candidates, part, gap.closed if names or model.fixed else None,
        bool(checks.effects) or signal_to_noise(model) > ENOUGH, whole=not missing,
        with_discrepancy=found.beside_discrepancy, slow_noise=summary.slow_noise,
        band=model.datasets[0].simulation.band, certain=tuple(checks.effects), at_limit=limits,
        at_tolerance=limited)
    sentence += in_time(effects) + missing
    notes = (*checks.notes, *summary.notes,
             *((part.within,) if part.within and word != 'no_gap' else ()),
             *(note for a in found.accepted for note in not_identified(final, a)),
             *ties_of(found))
    return Diagnosis(word, sentence, effects, tuple(candidates),
                     _localised(found, summary.predicted, checks), gap, notes=notes,
                     at_tolerance=tuple(limited), earlier=found.earlier()), noise, errors


def _outcome(first: LinearisedModel, model: LinearisedModel, found: Posterior,
             diagnosis: Diagnosis, noise: Array, errors: Errors, checks: Checks,
             observed: list[MeasuredBlocks]) -> Outcome:
    """Return the diagnosis with the rig that it leads to; what is not named is not added to it."""
    selection, final = found, found.model
    if diagnosis.verdict in ('unknown', 'not_excited'):
        # a gap without a name looks like noise
        final = replace(model, noise=[at_standstill(b, n)
                                      for b, n in zip(model.residuals, model.noise)])
        selection = Posterior(final, (), ())
        gap, noise, _ = measured_gap(first, selection, summarise_residual(final), observed)
        unknown = NamedEffect(UNKNOWN, {}, dict(diagnosis.candidates).get(UNKNOWN, 1.0))
        diagnosis = replace(diagnosis, gap=gap, effects=(unknown,))
    if diagnosis.verdict == 'not_excited':
        diagnosis = replace(diagnosis, effects=(), candidates=())
    closest = found.closest and patched_rig(
        found.closest.model, found._replace(accepted=tuple(found.closest.accepted)), checks)
    return Outcome(diagnosis, patched_rig(final, selection, checks),
                   recalibrations(final, errors), tuple(first.residuals), tuple(final.residuals),
                   final.datasets, noise, selection, aliases(final, errors), closest,
                   tuple(n.name for n in at_tolerance(final)))
