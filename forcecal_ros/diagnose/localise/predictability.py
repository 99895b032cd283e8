"""Predictability test: how much of a residual a nonparametric fit to the motion predicts."""

from itertools import chain
from typing import NamedTuple

from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.inputs.dataset import Dataset
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.geometry import Array
from forcecal_ros.simulators.signals import block_means, Signals
import numpy as np
from numpy.typing import NDArray

PREDICTABLE = 5.5
"""Sigmas of a channel's prediction from which its residual is more than noise."""

LAGS = (-4, -2, -1, 1, 2, 4, 8)
"""Blocks by which the main inputs are shifted to predict from their past and future."""


AT_ONCE = 4096
"""Blocks that are held in double precision at once: a hundred inputs of them fill a cache."""


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
    v_sensor = np.einsum('nij,ni->nj', s.R_base_sensor, s.velocity)
    time = (np.arange(len(s.wrench)) / len(s.wrench))[:, np.newaxis]
    push = s.contact[:, :3]
    wrench = s.wrench - s.wrench.mean(axis=0)
    speed = s.speed[:, np.newaxis]
    main = _means(wrench, s.specific_force - s.specific_force.mean(axis=0), s.velocity, s.omega,
                  s.optidrive[:, np.newaxis], speed)
    slow = _means(
        s.position - s.position.mean(axis=0), s.R_base_sensor[:, 2, :],
        s.R_base_sensor[:, 0, :], s.acceleration, s.alpha, push, time, time ** 2,
        time * wrench, np.tanh(s.velocity / 2e-3), np.tanh(v_sensor / 2e-3),
        np.tanh(s.omega / 5e-3), np.tanh(speed / 2e-4), np.tanh(speed / 2e-3),
        np.abs(s.velocity), s.optidrive[:, np.newaxis] ** 3, wrench[:, :3] ** 2,
        wrench[:, :3] ** 3, push ** 2, np.sqrt(np.abs(push)), (np.abs(push) > 0.0).astype(float),
        s.omega ** 2, s.velocity ** 2)
    rows = [row / size if size > 1e-12 else np.zeros(len(row))
            for row in (*main, *slow) for size in [np.sqrt(np.mean(row ** 2))]]
    lagged = (np.roll(row, lag) for lag in LAGS for row in rows[:len(main)])
    return Compact.joined([Compact.of(row[np.newaxis]) for row in chain(rows, lagged)])


def _means(*signals: Array) -> list[Array]:
    """Return the block means of each column of signals: all of them at 1 kHz fill much memory."""
    return [row for values in signals for row in block_means(values).T]


def predictability_of(model: LinearisedModel) -> Predictability:
    """
    Predict the residual of every channel from the motion, trained and tested on other blocks.

    Parameters
    ----------
    model : LinearisedModel
        As far as is explained.
    """
    inputs = [features(model.signals(i)) for i in range(len(model.datasets))]
    residuals = model.residuals
    z, size = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    predictions = tuple(np.zeros_like(b) for b in residuals)
    for c in range(len(CHANNELS)):
        if not any(n.sigma[:, c].any() for n in model.noise):
            continue
        white = [(n.whiten(b[np.newaxis, :, c], c),
                  n.whiten_singly(i.numbers, c, i.unit[:, 0].astype(float)))
                 for n, b, i in zip(model.noise, residuals, inputs)]
        train, held = (np.sum([_products(*w, getattr(p, part)) for w, p in zip(
            white, model.datasets)], axis=0) for part in ('train', 'held'))
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


def _products(residual: Array, white: NDArray[np.float32], rows: NDArray[np.bool_]) -> Array:
    """Return inner products over some blocks, summed in double precision part by part."""
    out, chosen = np.zeros((1 + len(white),) * 2), np.flatnonzero(rows)
    for part in np.array_split(chosen, -(-len(chosen) // AT_ONCE) or 1):
        some = np.concatenate([residual[:, part], white[:, part]])
        out += some @ some.T
    return out


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
