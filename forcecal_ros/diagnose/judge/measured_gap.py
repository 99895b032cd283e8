"""The gap of a fitted model: its noise, the errors of its parameters, and its three arms."""

from collections.abc import Sequence

from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.judge.gap import Arms, contact_error, Errors, Gap, gap
from forcecal_ros.diagnose.localise.time_frequency import STRONG, TimeFrequencyBin
from forcecal_ros.diagnose.model.effect_jacobian import EffectJacobian
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import ModelComparison
from forcecal_ros.geometry import Array
import numpy as np


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
            within.append(dataset.measured.scatter(model.base[i]))
    mean = np.maximum(total / np.maximum(weight, 1.0) - explained, 0.0)
    return np.asarray(np.sqrt(np.where(weight > 0.0, mean + np.mean(within, axis=0), 0.0)))


def parameter_errors(model: LinearisedModel, jacobians: Sequence[EffectJacobian]) -> Errors:
    """
    Say what wrong parameters leave on held-out blocks.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit.
    jacobians : sequence of EffectJacobian
        Of its effects.
    """
    comparison = ModelComparison(model, jacobians)
    k = len(comparison.null.x)
    grams, n = np.zeros((len(CHANNELS), k, k)), 0
    for i, dataset in enumerate(model.datasets):
        columns = [*model.jacobian[i], *comparison.extra[i]]
        n += int(dataset.held.sum())
        for c in range(len(CHANNELS)):
            there = [j for j in range(k) if c in columns[j]]
            if there and dataset.held.any():
                rows = np.stack([columns[j][c][dataset.held] for j in there]).astype(float)
                grams[c][np.ix_(there, there)] += rows @ rows.T
    return Errors(grams / max(1, n), comparison.null.covariance)


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
        0 where a channel has no strong bin, or a predicted part that stands for it.
    """
    energy = np.zeros(len(CHANNELS))
    for c in {x.channel for x in bins if x.z > STRONG}:
        if not any(x[:, c].any() for x in predictable):
            held = [b[dataset.held, c] for b, dataset in zip(model.residuals, model.datasets)]
            level = np.mean([n.rms(0)[c] ** 2 for n in model.noise])
            energy[c] = max(0.0, float(np.mean(np.concatenate(held) ** 2) - level))
    return energy


def measured_gap(model: LinearisedModel, final: LinearisedModel,
                 residuals: tuple[list[Array], ...], noise: Array, energy: Array,
                 errors: Errors) -> Gap:
    """
    Measure the gap in its three arms, the error of the contact force with it.

    Parameters
    ----------
    model, final : LinearisedModel
        Recalibrated; with the effects.
    residuals : tuple of three lists of ndarray, shape (n, channels)
        Of each recording: measured less nominal, measured less recalibrated, and what of the
        final residual is predictable.
    noise : ndarray, shape (channels,)
        RMS of one sample.
    energy : ndarray, shape (channels,)
        Mean square of what else is unexplained and is no noise.
    """
    arms, contact = [], []
    for i, (nominal, before, predictable) in enumerate(zip(*residuals)):
        dataset = model.datasets[i]
        arms.append(Arms(before, nominal - before, before - final.residuals[i], predictable))
        contact.append([dataset.measured.of_wrench(s.contact) for s in (
            dataset.nominal, model.base[i], final.base[i])])
    out = gap(model.datasets, arms, noise, energy, errors)
    forces = [out.channels.get(c.name) for c in CHANNELS[:3]]
    # one whose rest is all explained has no noise left, and counts as met
    remaining = np.array([0.0 if one is None else one[2] ** 2 for one in forces]
                         if any(forces) else [])
    return out._replace(contact_force=contact_error(model.datasets, arms, contact, remaining))
