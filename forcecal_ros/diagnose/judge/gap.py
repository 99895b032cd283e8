"""
How much of the misfit is explained: three arms, per channel and overall, on held-out blocks.

Numbers are those of a fit to the training blocks, as far as these identify them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset, MeasuredBlocks
from forcecal_ros.diagnose.judge.parameter_errors import Errors, parameter_errors
from forcecal_ros.diagnose.judge.residual_summary import ResidualSummary
from forcecal_ros.diagnose.localise import BIN_SIGMA, TimeFrequencyBin
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import Explained, ModelComparison
from forcecal_ros.diagnose.search.posterior import Posterior
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

SECOND = 250
"""Blocks of one second, which the bootstrap draws together."""

OFF = 0.4
"""
Standard deviation of the logarithm of what is left beside a discrepancy, for part of that passes
for noise, and an effect's form leaves some: in 20 cases of two opened parts of the blind check it
was off by 0.33 without a form of its own of the effect, and 0.47 with it.
"""


class Gap(NamedTuple):
    """
    The three arms.

    Attributes
    ----------
    nominal, recalibrated, explained : float
        Root mean square over channels of gap / noise RMS.
    closed : float
        1 - explained / recalibrated.
    channels : dict of str to tuple of float
        RMS of the gap in the three arms and of the noise, by channel, in its unit.
    contact_force : tuple of float
        RMS error of the contact force that one gets by taking the simulated free tool's wrench
        off the measured one, in the three arms, above the noise [N].
    """

    nominal: float
    recalibrated: float
    explained: float
    closed: float
    closed_ci95: tuple[float, float]
    channels: dict[str, tuple[float, float, float, float]]
    contact_force: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Arms(NamedTuple):
    """
    Block means of one recording, shape (n, channels) each.

    Attributes
    ----------
    recalibrated : ndarray
        Measured less the recalibrated simulation.
    by_nuisances : ndarray
        Recalibrated less nominal simulation.
    by_effects : ndarray
        Explained less recalibrated simulation.
    predictable : ndarray
        What the motion still predicts of the residual; zero where that is not significant.
    """

    recalibrated: Array
    by_nuisances: Array
    by_effects: Array
    predictable: Array


def gap(datasets: tuple[Dataset, ...], arms: list[Arms], noise: Array, cell_energy: Array,
        errors: Errors) -> Gap:
    """
    Measure the gap on held-out blocks.

    What a difference removes is 2 <residual, difference> - |difference|^2, which the noise
    disturbs far less than a difference of two energies.

    Parameters
    ----------
    noise : ndarray, shape (channels,)
        RMS of one sample of each channel; 0 where there is none.
    cell_energy : ndarray, shape (channels,)
        Mean square of time-frequency bins beyond what ``predictable`` predicts.
    errors : Errors
        Of the parameters.
    """
    explained, recalibrated, nominal, weights = [], [], [], []
    left = np.zeros(len(noise))
    for dataset, a in zip(datasets, arms):
        for first in range(0, len(dataset.held), SECOND):
            part = slice(first, first + SECOND)
            rows = dataset.held[part, np.newaxis] & dataset.measured.present[part]
            if not rows.any():
                continue
            r, n, d, predictable = (np.where(rows, x[part], 0.0) for x in a)
            unexplained = r - d
            left += (unexplained ** 2).sum(axis=0)
            over = (2.0 * unexplained * predictable - predictable ** 2).sum(axis=0)
            by_effects = (2.0 * r * d - d ** 2).sum(axis=0)
            by_nuisances = (2.0 * (r + n) * n - n ** 2).sum(axis=0)
            explained.append(over)
            recalibrated.append(over + by_effects)
            nominal.append(over + by_effects + by_nuisances)
            weights.append(rows.sum(axis=0))
    table = np.array([nominal, recalibrated, explained])
    w = np.array(weights, dtype=float)
    left /= np.maximum(w.sum(axis=0), 1.0)
    there = noise > 0.0

    def means(chosen: NDArray[np.intp], wrong: Array, beside: Array) -> Array:
        energy = np.maximum(table[:, chosen].sum(axis=1) / np.maximum(w[chosen].sum(axis=0), 1.0)
                            + cell_energy + wrong, 0.0)
        if beside.any():  # no more was taken for the effects than they explain
            energy[2] = np.minimum(energy[2] + beside, np.maximum(energy[1], energy[2]))
        return np.asarray(np.sqrt(energy))

    def overall(rms: Array) -> Array:
        return np.asarray(np.sqrt(np.mean((rms[:, there] / noise[there]) ** 2, axis=1)))

    rms = means(np.arange(len(w)), errors.of_parameters(), errors.of_discrepancy(left))
    arms3 = overall(rms)
    draw = np.random.default_rng(0)
    shares = [_closed(overall(means(draw.integers(0, len(w), len(w)), errors.of_parameters(draw),
                                    errors.of_discrepancy(left, draw)))) for _ in range(400)]
    closed = _closed(arms3)
    # a bootstrap of few blocks is too narrow, by the root of n / (n - 1) and as t is to normal
    few = max(2, len(w))
    wider = float(np.sqrt(few / (few - 1.0)) * stdtrit(few - 1.0, 0.975) / ndtri(0.975))
    low, high = closed + wider * (np.percentile(shares, [2.5, 97.5]) - closed)
    if errors.taken is not None:
        low, high = _wider(closed, low, high)
    channels = {c.name: (float(rms[0, i]), float(rms[1, i]), float(rms[2, i]), float(noise[i]))
                for i, c in enumerate(CHANNELS) if there[i]}
    return Gap(float(arms3[0]), float(arms3[1]), float(arms3[2]), closed,
               (float(low), min(1.0, float(high))), channels)


def _wider(closed: float, low: float, high: float) -> tuple[float, float]:
    """Widen a 95 % interval by what is left being off by more than chance."""
    off = np.exp(OFF * ndtri(0.975))
    more = (1.0 - closed) * np.array([off - 1.0, 1.0 - 1.0 / off])
    down, up = np.hypot([max(0.0, closed - low), max(0.0, high - closed)], more)
    return closed - float(down), closed + float(up)


def _closed(arms: Array) -> float:
    return float(1.0 - arms[2] / arms[1]) if arms[1] > 1e-9 else 0.0


def contact_error(datasets: tuple[Dataset, ...], arms: list[Arms], contact: list[list[Array]],
                  explained: Array) -> tuple[float, float, float]:
    """
    Say how wrong the contact force comes out that a user of each arm's model gets.

    It is the measured force less what the arm's tool weighs and resists, above the noise; the
    contact that the best explanation simulates counts as true.

    Parameters
    ----------
    contact : list of list of ndarray, shape (n, 6)
        Simulated contact wrench, nominal, recalibrated, explained, in each recording.
    explained : ndarray, shape (3,)
        Mean square of each force that is unexplained.

    Returns
    -------
    tuple of float
        Nominal, recalibrated, explained [N].
    """
    total, n = np.zeros((3, 3)), 0
    for dataset, a, simulated in zip(datasets, arms, contact):
        h = dataset.held & dataset.measured.present[:, 0]
        n += int(h.sum())
        unexplained = (a.recalibrated - a.by_effects)[h, :3]
        for i, more in enumerate((a.by_effects + a.by_nuisances, a.by_effects,
                                  np.zeros_like(a.by_effects))):
            d = more[h, :3] + (simulated[i] - simulated[2])[h, :3]
            total[i] += np.sum(2.0 * unexplained * d + d ** 2, axis=0)
    energy = np.maximum(total / max(1, n) + explained, 0.0).sum(axis=1)
    nominal, recalibrated, predictable = np.sqrt(energy)
    return float(nominal), float(recalibrated), float(predictable)


def sample_noise(model: LinearisedModel, explained: Array,
                 predictable: Sequence[Array] = ()) -> Array:
    """
    RMS of the noise of one sample of every channel: of what is neither explained nor predicted.

    Parameters
    ----------
    model : LinearisedModel
        As far as is explained.
    explained : ndarray, shape (channels,)
        Mean square of what else is no noise, such as what wrong parameters leave.
    predictable : sequence of ndarray, shape (n, channels)
        What else is predicted, in each recording.

    Returns
    -------
    ndarray, shape (channels,)
        0 where there is no channel.
    """
    total, weight, within = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS)), []
    for i, dataset in enumerate(model.datasets):
        unexplained = model.residuals[i] - (predictable[i] if predictable else 0.0)
        rows = dataset.held[:, np.newaxis] & dataset.measured.present
        total += np.sum(np.where(rows, unexplained, 0.0) ** 2, axis=0)
        weight += rows.sum(axis=0)
        if dataset.held.any():
            within.append(dataset.measured.scatter(model.signals(i)))
    mean = np.maximum(total / np.maximum(weight, 1.0) - explained, 0.0)
    return np.asarray(np.sqrt(np.where(weight > 0.0, mean + np.mean(within, axis=0), 0.0)))


def unpredictable(model: LinearisedModel, bins: list[TimeFrequencyBin],
                  predictable: Sequence[Array]) -> Array:
    """
    Mean square of what is unexplained, is no noise, and is not predicted from the motion.

    Parameters
    ----------
    bins : list of TimeFrequencyBin
        Of what is unexplained.
    predictable : sequence of ndarray, shape (n, channels)
        What of it is predicted, in each recording.

    Returns
    -------
    ndarray, shape (channels,)
        0 where a channel has no strong bin.
    """
    energy = np.zeros(len(CHANNELS))
    for c in {x.channel for x in bins if x.z > BIN_SIGMA}:
        held = [(b - p)[dataset.held & dataset.measured.present[:, c], c]
                for b, p, dataset in zip(model.residuals, predictable, model.datasets)]
        level = np.mean([n.rms(0)[c] ** 2 for n in model.noise])
        energy[c] = max(0.0, float(np.mean(np.concatenate(held) ** 2) - level))
    return energy


def measured_gap(model: LinearisedModel, selection: Posterior, summary: ResidualSummary,
                 observed: Sequence[MeasuredBlocks]) -> tuple[Gap, Array, Errors]:
    """
    Measure the gap in its three arms, the error of the contact force with it.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated, without effects.
    observed : sequence of MeasuredBlocks
        By the stamps that the recordings came with.

    Returns
    -------
    gap : Gap
    noise : ndarray, shape (channels,)
        RMS of one sample.
    errors : Errors
    """
    arms, contact = [], []
    comparison = ModelComparison(selection.model, selection.jacobians)
    moved, errors = summary.predicted, parameter_errors(comparison)
    changed = comparison.by_training()
    recalibrated = Explained(model).by_training() if selection.accepted else changed
    final = replace(selection.model, residuals=[
        r - by for r, by in zip(selection.model.residuals, changed)])
    without_name = 0.0 if selection.accepted else unpredictable(final, summary.bins, moved)
    noise = sample_noise(final, errors.of_parameters() + without_name, moved)
    beside = errors.predicted or moved
    energy = unpredictable(final, summary.bins, beside)
    for i, (dataset, rows) in enumerate(zip(model.datasets, beside)):
        simulated, means = model.signals(i), dataset.measured.of_wrench
        nominal, before = (observed[i].residual(s) for s in (dataset.nominal, simulated))
        before = before - recalibrated[i]
        arms.append(Arms(before, nominal - before, before - final.residuals[i], rows))
        contact.append([means(s.contact) for s in (
            dataset.nominal, simulated, final.signals(i))])
    out = gap(model.datasets, arms, noise, energy, errors)
    if any(c.name in out.channels for c in CHANNELS[:3]):
        # one whose rest is all explained has no noise left, and counts as met
        remaining = np.array([out.channels[c.name][2] ** 2 if c.name in out.channels else 0.0
                              for c in CHANNELS[:3]])
        out = out._replace(contact_force=contact_error(model.datasets, arms, contact, remaining))
    return out, noise, errors
