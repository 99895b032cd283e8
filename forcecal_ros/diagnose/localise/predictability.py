"""Predictability test: how much of a residual a nonparametric fit to the motion predicts."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.inputs.dataset import Dataset
from forcecal_ros.diagnose.model.compact import Compact, stacked
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.sim.signals import block_means, Signals
import numpy as np

PREDICTABLE = 5.5
"""Sigmas of a channel's prediction from which its residual is more than noise."""

LAGS = (-4, -2, -1, 1, 2, 4, 8)
"""Blocks by which the main inputs are shifted to predict from their past and future."""


class Predictability(NamedTuple):
    """
    How well the residual of each channel is predicted from the motion.

    Attributes
    ----------
    z : ndarray, shape (channels,)
        On held-out blocks; N(0, 1) where only noise is left.
    size : ndarray, shape (channels,)
        RMS of the prediction in noise RMS, largest kind of motion.
    prediction : tuple of ndarray, shape (n, channels)
        One for each recording.
    """

    z: Array
    size: Array
    prediction: tuple[Array, ...]


def features(s: Signals) -> Compact:
    """
    List the inputs that an unknown effect may depend on, as block means.

    Returns
    -------
    Compact, shape (k, n)
        Of unit RMS; 0 where one does not vary.
    """
    main = [_of_unit_size(row) for row in _means(_quick(s))]
    others = [_of_unit_size(row) for row in _means(_others(s))]
    return Compact.joined([*main, *others, *(one.rolled(lag) for lag in LAGS for one in main)])


def _quick(s: Signals) -> Iterator[Array]:
    """Give inputs whose past and future count as well, one after the other."""
    yield s.wrench - s.wrench.mean(axis=0)
    yield s.specific_force - s.specific_force.mean(axis=0)
    yield s.velocity
    yield s.omega
    yield s.optidrive[:, np.newaxis]
    yield s.speed[:, np.newaxis]


def _others(s: Signals) -> Iterator[Array]:
    """Give the other inputs one after the other: all of them at 1 kHz would fill much memory."""
    time = (np.arange(len(s.wrench)) / len(s.wrench))[:, np.newaxis]
    push, speed = s.contact[:, :3], s.speed[:, np.newaxis]
    wrench = s.wrench - s.wrench.mean(axis=0)
    yield s.position - s.position.mean(axis=0)
    yield s.R_base_sensor[:, 2, :]
    yield s.R_base_sensor[:, 0, :]
    yield s.acceleration
    yield s.alpha
    yield push
    yield time
    yield time ** 2
    yield time * wrench
    yield np.tanh(s.velocity / 2e-3)
    yield np.tanh(np.einsum('nij,ni->nj', s.R_base_sensor, s.velocity) / 2e-3)
    yield np.tanh(s.omega / 5e-3)
    yield np.tanh(speed / 2e-4)
    yield np.tanh(speed / 2e-3)
    yield np.abs(s.velocity)
    yield s.optidrive[:, np.newaxis] ** 3
    yield wrench[:, :3] ** 2
    yield wrench[:, :3] ** 3
    yield push ** 2
    yield np.sqrt(np.abs(push))
    yield (np.abs(push) > 0.0).astype(float)
    yield s.omega ** 2
    yield s.velocity ** 2


def _means(signals: Iterable[Array]) -> Iterator[Array]:
    """Give the block means of each column of signals."""
    return (row for values in signals for row in block_means(values).T)


def _of_unit_size(row: Array) -> Compact:
    size = np.sqrt(np.mean(row ** 2))
    return Compact.of((row / size if size > 1e-12 else np.zeros(len(row)))[np.newaxis])


def predictability_of(model: LinearisedModel) -> Predictability:
    """
    Predict the residual of every channel from the motion, trained and tested on other blocks.

    Parameters
    ----------
    model : LinearisedModel
        As far as is explained.
    """
    inputs = [features(model.signals(i)) for i in range(len(model.datasets))]
    residuals, k = model.residuals, len(inputs[0].numbers)
    z, size = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    predictions = tuple(np.zeros_like(b) for b in residuals)
    for c in range(len(CHANNELS)):
        if not any(n.sigma[:, c].any() for n in model.noise):
            continue
        train, held = np.zeros((2, 1 + k, 1 + k))
        for n, b, i, p in zip(model.noise, residuals, inputs, model.datasets):
            for rows, white in n.whiten_in_pieces(stacked(b[:, c], i.rows()), c):
                for gram, part in ((train, p.train[rows]), (held, p.held[rows])):
                    some = white[:, part]
                    gram += some @ some.T
        theta = _ridge(train)
        energy = float(theta @ held[1:, 1:] @ theta)
        if energy > 1e-9:
            z[c] = float(theta @ held[1:, 0]) / np.sqrt(energy)
        predicted = [i.combined(theta) for i in inputs]
        if not _within(predicted, [b[:, c] for b in residuals], model.datasets):
            z[c] = 0.0
            continue
        for one, rows_of, noise, dataset in zip(predictions, predicted, model.noise,
                                                model.datasets):
            one[:, c] = rows_of
            for g in range(3):
                rows = dataset.held & (dataset.groups == g)
                if rows.sum() >= 50 and noise.sigma[g, c] > 0.0:
                    ratio = np.sqrt(np.mean(one[rows, c] ** 2)) / noise.rms(g)[c]
                    size[c] = max(size[c], float(ratio))
    return Predictability(z, size, predictions)


def _within(predicted: list[Array], residuals: list[Array], datasets: tuple[Dataset, ...]) -> bool:
    """
    Say whether a prediction is no larger than what it predicts, on held-out blocks.

    Noise with a root near 1 leaves the level of a prediction open: inputs that hardly vary then
    make a constant of any size.
    """
    size, rest = (np.sqrt(sum(float(np.sum(x[c.held] ** 2)) for x, c in zip(rows, datasets)))
                  for rows in (predicted, residuals))
    return bool(size <= rest)


def _ridge(gram: Array) -> Array:
    """Fit with the ridge that the training data find likeliest."""
    matrix, vector = gram[1:, 1:], gram[1:, 0]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    values = np.maximum(values, 0.0)
    turned = vectors.T @ (vector / scale)

    def evidence(ridge: float) -> float:
        return float(0.5 * np.sum(turned ** 2 / (values + ridge))
                     - 0.5 * np.sum(np.log1p(values / ridge)))

    best = max(10.0 ** np.arange(-6.0, 4.0), key=evidence)
    if evidence(best) < 0.0:
        return np.zeros(len(vector))
    return np.asarray(vectors @ (turned / (values + best)) / scale)
