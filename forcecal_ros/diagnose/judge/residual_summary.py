"""What a fitted model leaves of the recordings, and whether that is more than noise."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import unpredicted
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.localise import (
    BIN_SIGMA,
    count_impulses,
    Line,
    LINE_RATIO,
    MIN_IMPULSES,
    spectral_lines,
    time_frequency_bins,
    TimeFrequencyBin,
)
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY, STREAM
from forcecal_ros.diagnose.model.hypotheses import VIBRATION
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.verdict import UnexplainedPart
import numpy as np


def of_slow_noise(before: LinearisedModel, after: LinearisedModel) -> float:
    """
    Log-likelihood that is gained by following noise whose memory is long, and by that alone.

    A drift, a cable and the like look as 1/f noise does. What they bring is compared with what
    they bring where both residuals, whitened by the same filter, may be predicted from the means
    of their own past (a heterogeneous autoregression).

    Parameters
    ----------
    before, after : LinearisedModel
        Without and with what follows it, each at its best fit.
    """
    total = 0.0
    for noise, *own in zip(after.noise, before.residuals, after.residuals):
        for c in range(len(CHANNELS)):
            rows = noise.rows[:, c] & noise.sigma[noise.groups, c].astype(bool)
            both = np.stack([one[:, c] for one in own])
            if rows.any() and (both[0] != both[1]).any():
                white = noise.whiten(both, c)
                squares = np.sum(white[:, rows] ** 2, axis=1)
                left = [unpredicted(w, rows) for w in white]
                total += 0.5 * int(rows.sum()) * float(
                    np.log(squares[0] / squares[1]) - np.log(left[0] / left[1]))
    return max(0.0, total)


_INDEX = {c.name: i for i, c in enumerate(CHANNELS)}

WANDERING = 0.03
"""Part of a vibration's frequency within which its speed may wander."""

WITHOUT_NAME = 10.0
"""Log-evidence of a discrepancy from which something is unexplained: odds of 20,000 to one."""

SLOW = 0.75
"""
Part of what a discrepancy brings for following slow noise that does not count. All of it would
take a small background for noise, for its past predicts it as well: this leaves 41 of one of 101
and 56 of a real arm's of 175, and nothing of the 33 to 177 that 1/f noise in all channels makes.
"""


class ResidualSummary(NamedTuple):
    """
    What a fitted model leaves of the recordings.

    Attributes
    ----------
    discrepancy : tuple of ndarray, shape (n, channels)
        What follows the motion without a name, in each recording.
    size : ndarray, shape (channels,)
        Its RMS in that of the noise, in the worst kind of motion.
    bins : list of TimeFrequencyBin
        Within the band up to which the simulation is meant to hold.
    lines : tuple of Line
        Not those of a vibration that is explained.
    impulses : ndarray, shape (channels,)
        How many innovations of each channel noise does not make.
    discrepancy_evidence : float
        Log-evidence of the discrepancy.
    slow_noise : bool
        Whether slow noise is counted as noise that a discrepancy may be, too.
    level : ndarray, shape (channels,)
        RMS of the noise at rest.
    tolerance : float
        RMS of what is unexplained, in that of a channel's noise, that does not matter.
    exact : float
        The same, up to which the simulation is meant to be right, or tolerated to be wrong.
    """

    discrepancy: tuple[Array, ...]
    size: Array
    bins: list[TimeFrequencyBin]
    lines: tuple[Line, ...]
    impulses: Array
    notes: tuple[str, ...]
    discrepancy_evidence: float = 0.0
    slow_noise: bool = False
    level: Array = np.ones(len(CHANNELS))
    tolerance: float = 0.0
    exact: float = 0.0

    @property
    def predicted(self) -> list[Array]:
        """What of each residual is no noise; 0 where a simulation is not that exact."""
        seen = (self.size > self.exact) & (self.discrepancy_evidence >= WITHOUT_NAME)
        return [np.where(seen, one, 0.0) for one in self.discrepancy]


def summarise_residual(model: LinearisedModel,
                       discrepancy_evidence: float = 0.0) -> ResidualSummary:
    """
    Test the residual of a fitted model for what is more than noise.

    Parameters
    ----------
    discrepancy_evidence : float
        Log-evidence of its discrepancy.
    """
    found, seen = discrepant(model), discrepancy_evidence
    if model.discrepancy_scales == NO_DISCREPANCY:
        discrepancy_evidence = seen = 0.0
    beyond = _without(model, found)
    if discrepancy_evidence > 0.0:
        every = _without(model, discrepant(model, trained=False))
        discrepancy_evidence = max(0.0, seen - SLOW * of_slow_noise(model, every))
    bins = [c for dataset, n, b in zip(beyond.datasets, beyond.noise, beyond.residuals)
            for c in time_frequency_bins(dataset, n, b) if c.band[1] <= dataset.simulation.band]
    lines, wanders = _other_lines(lines_of(beyond), beyond)
    summary = ResidualSummary(
        tuple(found), _sizes(model, found), bins, lines,
        np.asarray(sum(count_impulses(n, b) for n, b in zip(model.noise, beyond.residuals))),
        wanders, discrepancy_evidence, level=np.asarray(np.max(
            [n.rms() for n in model.noise], axis=0)), tolerance=model.tolerance,
        exact=min(model.tolerance, model.datasets[0].simulation.exact))
    if discrepancy_evidence < WITHOUT_NAME <= seen:
        summary = summary._replace(notes=(*wanders, 'slow noise or ' + _discrepancy_in_words(
            summary) + ': the recording is too short to decide'), slow_noise=True)
    return summary


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
    return model.predicted({c: model.discrepancy_scales[stream]
                            for c, stream in enumerate(STREAM)}, trained)


def _sizes(model: LinearisedModel, found: Sequence[Array]) -> Array:
    """Return the RMS of a discrepancy in that of the noise, in the worst kind of motion."""
    size = np.zeros(len(CHANNELS))
    for one, noise, dataset in zip(found, model.noise, model.datasets):
        for g in range(3):
            rows = dataset.groups == g
            if rows.any():
                rms = noise.rms(g)
                size = np.maximum(size, np.sqrt(np.mean(one[rows] ** 2, axis=0))
                                  / np.where(rms > 0.0, rms, np.inf))
    return size


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
    """Find the strongest of the tests of a residual, of those of what matters."""
    options = list(_tests(summary))
    ratio, _, words = max((one for one in options if one[1] > summary.tolerance),
                          default=(0.0, 0.0, ''))
    below = max((one for one in options if one[1] <= summary.tolerance and one[0] >= 1.0),
                default=None)
    if ratio >= 1.0 or below is None:
        return UnexplainedPart(ratio, words)
    return UnexplainedPart(ratio, words, f'{below[2]}, is {below[1]:.2g} times its noise; up to '
                           f'{summary.tolerance:.2g} is within the tolerance')


def _tests(summary: ResidualSummary) -> Iterator[tuple[float, float, str]]:
    """
    Give each test of a residual.

    Yields
    ------
    ratio : float
        Statistic over its threshold.
    size : float
        RMS of what it found, in that of the channel's noise.
    words : str
    """
    yield (summary.discrepancy_evidence / WITHOUT_NAME, float(summary.size.max()),
           _discrepancy_in_words(summary))
    for one in summary.bins:
        low, high = one.band
        where = f'{CHANNELS[one.channel].name} in {one.phase}, {low:g} to {high:g} Hz'
        yield one.z / BIN_SIGMA, one.excess, f'{where} ({one.z:.1f} sigma)'
    several = int(summary.impulses.max())
    yield (several / MIN_IMPULSES, inf,
           f'{several} impulses in {CHANNELS[int(summary.impulses.argmax())].name}')
    for line in summary.lines:
        level = max(1e-12, summary.level[_INDEX[line.channel]])
        yield (line.power / LINE_RATIO, line.amplitude / np.sqrt(2.0) / level,
               f'a line at {line.frequency:.2f} Hz in {line.channel}')


def _discrepancy_in_words(summary: ResidualSummary) -> str:
    """Say where a discrepancy is strongest beside the noise, and how large it is there."""
    c = int(summary.size.argmax())
    total = np.concatenate([one[:, c] for one in summary.discrepancy])
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
    note = f'{VIBRATION}: its frequency varies about {speed:.2f} Hz; a constant one explains part'
    return others, (note,) if len(others) < len(lines) else ()
