"""What a fitted model leaves of the recordings, and whether that is more than noise."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.slow_noise import held_out_likelihood_ratio, of_slow_noise
from forcecal_ros.diagnose.localise import (
    BANDS,
    BIN_SIGMA,
    count_impulses,
    Line,
    LINE_RATIO,
    MIN_IMPULSES,
    Predictability,
    predictability_of,
    PREDICTABLE_SIGMA,
    spectral_lines,
    time_frequency_bins,
    TimeFrequencyBin,
)
from forcecal_ros.diagnose.model.evidence import fit
from forcecal_ros.diagnose.model.hypotheses import EffectJacobian, VIBRATION
from forcecal_ros.diagnose.model.jacobian import combined
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.model.scales import NO_DISCREPANCY
from forcecal_ros.diagnose.search.model_comparison import FLAWED, ModelComparison
from forcecal_ros.sim.signals import SMALL
import numpy as np

WANDERING = 0.03
"""Part of a vibration's frequency within which its speed may wander."""

WITHOUT_NAME = 10.0
"""Log-evidence of a discrepancy from which something is unexplained: odds of 20,000 to one."""

SLOW = 0.75
"""
Part of what a discrepancy brings for following slow noise that does not count. All of it would
take a small background for noise, for its past predicts it as well: this keeps the one of 93 (and
a real arm's of 175), and takes off what 1/f noise in all channels of a rig made, 66 and 24.
"""

MOSTLY = 0.5
"""Part of a discrepancy's evidence for following slow noise from which it has to be seen again."""

NOWHERE = TimeFrequencyBin(0, 'no phase', BANDS[0], 0.0, 0.0)
"""Stands for the bins of recordings whose phases are too short for any."""


class ResidualSummary(NamedTuple):
    """
    What a fitted model leaves of the recordings.

    Attributes
    ----------
    predictability : Predictability
        Of the discrepancy, where there is one.
    strongest : list of TimeFrequencyBin
        The strongest first.
    lines : tuple of Line
        Not those of a vibration that is explained.
    impulses : ndarray, shape (channels,)
        How many innovations of each channel noise does not make.
    discrepancy_evidence : float
        Log-evidence of the discrepancy.
    slow_noise : bool
        Whether slow noise is counted as noise that a discrepancy may be, too.
    """

    predictability: Predictability
    strongest: list[TimeFrequencyBin]
    lines: tuple[Line, ...]
    impulses: Array
    notes: tuple[str, ...]
    discrepancy_evidence: float = 0.0
    slow_noise: bool = False


class UnexplainedPart(NamedTuple):
    """
    What is unexplained, as a multiple of what noise would leave.

    Attributes
    ----------
    ratio : float
        Largest statistic over its threshold: more than noise from 1 on.
    words : str
        What it is.
    """

    ratio: float
    words: str


def summarise_residual(model: LinearisedModel,
                       discrepancy_evidence: float = 0.0) -> ResidualSummary:
    """
    Test the residual of a fitted model for what is more than noise.

    Parameters
    ----------
    discrepancy_evidence : float
        Log-evidence of its discrepancy.
    """
    found, seen = None, discrepancy_evidence
    if model.discrepancy_scales != NO_DISCREPANCY:
        found = discrepant(model)
        beyond = _without(model, found)
        if discrepancy_evidence > 0.0:
            discrepancy_evidence = _but_for_slow_noise(model, beyond, discrepancy_evidence)
        model = beyond
    bins = [c for dataset, n, b in zip(model.datasets, model.noise, model.residuals)
            for c in time_frequency_bins(dataset, n, b) if c.band[0] < dataset.simulation.band]
    lines, wanders = _other_lines(lines_of(model), model)
    impulses = np.asarray(sum(count_impulses(n, b) for n, b in zip(model.noise, model.residuals)))
    strongest = sorted(bins, key=lambda c: -c.z) or [NOWHERE]
    if found is None:
        return ResidualSummary(predictability_of(model), strongest,
                               lines, impulses, wanders)
    summary = ResidualSummary(_as_predictability(model, found, discrepancy_evidence), strongest,
                              lines, impulses, wanders, discrepancy_evidence)
    if discrepancy_evidence < WITHOUT_NAME <= seen:
        summary = summary._replace(notes=(*wanders, 'slow noise, or else ' + _discrepancy_in_words(
            summary) + ': the recording is too short to tell'), slow_noise=True)
    return summary


def _but_for_slow_noise(model: LinearisedModel, beyond: LinearisedModel, evidence: float
                        ) -> float:
    """
    Return a discrepancy's evidence but for what it brings for following slow noise.

    One that mostly does, and is no larger than noise that is not quite what it is taken for may
    make it, has to predict what it was not fitted to as well: noise does not repeat.

    Parameters
    ----------
    beyond : LinearisedModel
        With the discrepancy, as training blocks show it, taken off.
    """
    left = evidence - SLOW * of_slow_noise(model, beyond)
    if evidence < FLAWED * len(model.whitened_discrepancy().channels):
        every = _without(model, discrepant(model, trained=False))
        if SLOW * of_slow_noise(model, every) > MOSTLY * evidence:
            left = min(left, held_out_likelihood_ratio(model, beyond))
    return max(0.0, left)


def _without(model: LinearisedModel, found: Sequence[Array]) -> LinearisedModel:
    """Take a discrepancy off the residuals."""
    return replace(model, residuals=[b - x for b, x in zip(model.residuals, found)])


def discrepant(model: LinearisedModel, trained: bool = True) -> list[Array]:
    """
    Return the discrepancy that training blocks, or all, show.

    Parameters
    ----------
    model : LinearisedModel
        At a fit, its discrepancy not 0.

    Returns
    -------
    list of ndarray, shape (n, channels)
        In each recording.
    """
    weights = model.residual_products().weights(model.discrepancy_scales, trained)
    return model.whitened_discrepancy().of_weights(weights, [b.shape for b in model.residuals])


def _as_predictability(model: LinearisedModel, found: list[Array],
                       discrepancy_evidence: float) -> Predictability:
    """Say of each channel that shows a discrepancy how significant all of it is."""
    size = np.zeros(len(CHANNELS))
    for one, noise, dataset in zip(found, model.noise, model.datasets):
        for g in range(3):
            rows = dataset.groups == g
            if rows.any():
                rms = noise.rms(g)
                size = np.maximum(size, np.sqrt(np.mean(one[rows] ** 2, axis=0))
                                  / np.where(rms > 0.0, rms, np.inf))
    sigmas = float(np.sqrt(2.0 * max(0.0, discrepancy_evidence)))
    seen = size > model.datasets[0].simulation.exact
    return Predictability(np.where(seen, sigmas, 0.0), size, tuple(found))


def fitted_to_all(model: LinearisedModel,
                  jacobians: Sequence[EffectJacobian] = ()) -> LinearisedModel:
    """
    Take off what nuisances and effects explain when they are fitted to all blocks.

    What training blocks hardly show (an inertia, where they hold no turn about its axis) is known
    poorly from them, and shows on the others: that is no gap, but an error of the fit.

    Parameters
    ----------
    model : LinearisedModel
        At a fit to its training blocks.
    jacobians : sequence of EffectJacobian
        Of its effects.

    Returns
    -------
    LinearisedModel
        With the residuals, and their noise, of the fit to all; all else as it was.
    """
    out = replace(model, residuals=_left_by_all(ModelComparison(model, jacobians)))
    out.refit_noise(np.zeros(len(model.nuisances)))
    return out


def _left_by_all(comparison: ModelComparison) -> list[Array]:
    """Return what nuisances and effects leave if they are fitted to all blocks."""
    model = comparison.model
    x = fit(comparison.train + comparison.held, comparison.null_prior).x
    return [b - combined([*columns, *extra], x, len(b)) * c.measured.present
            for b, columns, extra, c in zip(model.residuals, model.jacobian, comparison.extra,
                                            model.datasets)]


def lines_of(model: LinearisedModel) -> tuple[Line, ...]:
    """Find spectral lines in the residual, at the full sampling rate."""
    lines: list[Line] = []
    for i, dataset in enumerate(model.datasets):
        signals = model.signals(i)
        for name in ('wrench', 'accelerometer', 'optidrive'):
            if name in dataset.measured.streams:
                rows = dataset.measured.samples(name, signals)
                lines += spectral_lines(rows, getattr(dataset.recording, name).rate, name)
    band = model.datasets[0].simulation.band
    return tuple(line for line in lines if line.frequency < band)


def unexplained(summary: ResidualSummary) -> UnexplainedPart:
    """Find the strongest of the tests of a residual, as a multiple of its threshold."""
    predictability, strongest = summary.predictability, summary.strongest[0]
    impulses = summary.impulses
    z = np.where(predictability.size > SMALL, predictability.z, 0.0)
    c = int(z.argmax())
    several = int(impulses.max())
    line = max(summary.lines, key=lambda one: one.power, default=None)
    low, high = strongest.band
    options = [
        (summary.discrepancy_evidence / WITHOUT_NAME * (z[c] > 0.0),
         _discrepancy_in_words(summary)) if summary.discrepancy_evidence else
        (float(z[c]) / PREDICTABLE_SIGMA,
         f'{CHANNELS[c].name}, predictable from the motion ({z[c]:.1f} sigma)'),
        (strongest.z / BIN_SIGMA,
         (f'{CHANNELS[strongest.channel].name} in {strongest.phase}, {low:g} to {high:g} Hz '
          f'({strongest.z:.1f} sigma)')),
        (several / MIN_IMPULSES,
         f'{several} impulses in {CHANNELS[int(impulses.argmax())].name}')]
    if line is not None:
        options.append((line.power / LINE_RATIO,
                        f'a line at {line.frequency:.2f} Hz in {line.channel}'))
    return UnexplainedPart(*max(options))


def _discrepancy_in_words(summary: ResidualSummary) -> str:
    """Say where a discrepancy is strongest beside the noise, and how large it is there."""
    c = int(summary.predictability.size.argmax())
    total = np.concatenate([one[:, c] for one in summary.predictability.prediction])
    rms = float(np.sqrt(np.mean(total ** 2)))
    return (f'a part that follows the motion but matches no effect of the library, '
            f'{rms:.2g} {CHANNELS[c].unit} RMS in {CHANNELS[c].name}')


def _other_lines(lines: tuple[Line, ...], model: LinearisedModel
                 ) -> tuple[tuple[Line, ...], tuple[str, ...]]:
    """Take off the lines beside that of a vibration that is explained, and note them."""
    if VIBRATION not in model.effects:
        return lines, ()
    speed = model.effects[VIBRATION]['frequency']
    others = tuple(x for x in lines if abs(x.frequency - speed) > WANDERING * speed)
    note = f'{VIBRATION}: its speed wanders about {speed:.2f} Hz; one speed explains a part of it'
    return others, (note,) if len(others) < len(lines) else ()


def predictions(predictability: Predictability) -> list[Array]:
    """Return what motion predicts of each residual, where significant, shape (n, channels)."""
    real = (predictability.z > PREDICTABLE_SIGMA) & (predictability.size > SMALL)
    return [np.where(real, one, 0.0) for one in predictability.prediction]
