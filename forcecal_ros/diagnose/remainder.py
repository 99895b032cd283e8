"""What no effect explains: predictable from the motion, too strong in a cell, or impulsive."""

from typing import NamedTuple

from forcecal_ros.diagnose.blocked import Blocked
from forcecal_ros.diagnose.case import Case
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.simulation import block_means, Signals
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import Autoregression
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

PREDICTABLE = 5.5
"""Sigmas of a channel's prediction from which something is left."""

STRONG = 9.0
"""Sigmas of a cell's energy from which something is left."""

IMPULSE = 7.0
"""Innovation, in its sigma, that noise does not make."""

IMPULSES = 4
"""So many of them count."""

STEEPEST = 2.2
"""By how much coloured noise may grow from one octave to the next lower one."""

LOWEST = 2.5
"""And by how much more in the lowest band, which is many octaves."""

LAGS = (-4, -2, -1, 1, 2, 4, 8)
"""Blocks by which the main inputs are shifted."""

BANDS = ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 16.0), (16.0, 32.0),
         (32.0, 62.5), (62.5, 125.0))
"""Octaves [Hz] of the block means."""

RATE = 250.0

SHORTEST, FEWEST = 50.0, 8
"""Stretch whose spectrum is taken, in blocks: 0.2 s tell octaves from 5 Hz on; its samples."""


class Ceiling(NamedTuple):
    """
    How well the remainder of each channel is predicted from the motion.

    Attributes
    ----------
    z : ndarray, shape (channels,)
        Held out; N(0, 1) where nothing is left.
    size : ndarray, shape (channels,)
        RMS of the prediction in noise RMS, largest kind of motion.
    prediction : tuple of ndarray, shape (n, channels)
        One for each recording.
    """

    z: Array
    size: Array
    prediction: tuple[Array, ...]


class Cell(NamedTuple):
    """Energy of one channel, phase and octave against the noise at rest."""

    channel: int
    phase: str
    band: tuple[float, float]
    excess: float
    z: float

    @property
    def p(self) -> float:
        """One-sided probability by chance."""
        return float(ndtr(-self.z))


def features(s: Signals) -> Array:
    """
    List the inputs that an unknown effect may depend on, as block means.

    Parameters
    ----------
    s : Signals

    Returns
    -------
    ndarray, shape (k, n)
    """
    v_sensor = np.einsum('nij,ni->nj', s.R_base_sensor, s.velocity)
    time = (np.arange(len(s.wrench)) / len(s.wrench))[:, np.newaxis]
    push = s.contact[:, :3]
    wrench = s.wrench - s.wrench.mean(axis=0)
    main = np.concatenate([wrench, s.specific_force - s.specific_force.mean(axis=0),
                           s.velocity, s.omega, s.optidrive[:, np.newaxis],
                           s.speed[:, np.newaxis]], axis=1)
    speed = s.speed[:, np.newaxis]
    slow = np.concatenate([
        s.position - s.position.mean(axis=0), s.R_base_sensor[:, 2, :],
        s.R_base_sensor[:, 0, :], s.acceleration, s.alpha, push, time, time ** 2,
        time * wrench, np.tanh(s.velocity / 2e-3), np.tanh(v_sensor / 2e-3),
        np.tanh(s.omega / 5e-3), np.tanh(speed / 2e-4), np.tanh(speed / 2e-3),
        np.abs(s.velocity), s.optidrive[:, np.newaxis] ** 3, wrench[:, :3] ** 2,
        wrench[:, :3] ** 3, push ** 2, np.sqrt(np.abs(push)), (np.abs(push) > 0.0),
        s.omega ** 2, s.velocity ** 2], axis=1)
    blocks = block_means(np.concatenate([main, slow], axis=1)).T
    shifted = [np.roll(blocks[:main.shape[1]], lag, axis=1) for lag in LAGS]
    out = np.concatenate([blocks, *shifted])
    scale = np.sqrt(np.mean(out ** 2, axis=1, keepdims=True))
    return np.asarray(out[(scale > 1e-12).ravel()] / scale[scale > 1e-12][:, np.newaxis])


def ceiling(problem: Problem, signals: list[Signals], blocks: list[Array]) -> Ceiling:
    """
    Predict the remainder of every channel from the motion, trained and judged apart.

    Parameters
    ----------
    problem : Problem
        Its noise belongs to ``blocks``.
    signals : list of Signals
        Simulated, as far as is explained.
    blocks : list of ndarray, shape (n, channels)
        What remains.

    Returns
    -------
    Ceiling
    """
    inputs = [features(s) for s in signals]
    k = min(len(i) for i in inputs)
    inputs = [i[:k] for i in inputs] if all(len(i) == k for i in inputs) else \
        [_padded(i, max(map(len, inputs))) for i in inputs]
    z, size = np.zeros(len(CHANNELS)), np.zeros(len(CHANNELS))
    predictions = tuple(np.zeros_like(b) for b in blocks)
    for c in range(len(CHANNELS)):
        if not any(n.sigma[:, c].any() for n in problem.noise):
            continue
        white = [n.whiten(np.vstack([b[:, c], i]), c)
                 for n, b, i in zip(problem.noise, blocks, inputs)]
        train, held = (np.sum([_products(w, getattr(p, part)) for w, p in zip(
            white, problem.cases)], axis=0) for part in ('train', 'held'))
        theta = _ridge(train)
        energy = float(theta @ held[1:, 1:] @ theta)
        if energy > 1e-9:
            z[c] = float(theta @ held[1:, 0]) / np.sqrt(energy)
        predicted = [theta @ i for i in inputs]
        if not _within(predicted, [b[:, c] for b in blocks], problem.cases):
            z[c] = 0.0
            continue
        for one, rows_of, noise, case in zip(predictions, predicted, problem.noise,
                                             problem.cases):
            one[:, c] = rows_of
            for g in range(3):
                rows = case.held & (case.groups == g)
                if rows.sum() >= 50 and noise.sigma[g, c] > 0.0:
                    ratio = np.sqrt(np.mean(one[rows, c] ** 2)) / noise.rms(g)[c]
                    size[c] = max(size[c], float(ratio))
    return Ceiling(z, size, predictions)


def _within(predicted: list[Array], blocks: list[Array], cases: tuple[Case, ...]) -> bool:
    """
    Say whether a prediction is no larger than what it predicts, on held-out blocks.

    Noise with a root near 1 leaves the level of a prediction open: inputs that hardly vary then
    make a constant of any size.
    """
    size, rest = (np.sqrt(sum(float(np.sum(x[c.held] ** 2)) for x, c in zip(rows, cases)))
                  for rows in (predicted, blocks))
    return bool(size <= rest)


def _products(white: Array, rows: NDArray[np.bool_]) -> Array:
    if not rows.any():
        return np.zeros((len(white), len(white)))
    chosen = white if rows.all() else white[:, rows]
    return np.asarray(chosen @ chosen.T)


def _padded(rows: Array, k: int) -> Array:
    return np.vstack([rows, np.zeros((k - len(rows), rows.shape[1]))])


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


def cells(case: Blocked, noise: Autoregression, blocks: Array) -> list[Cell]:
    """
    Compare the energy of every channel, phase and octave with the noise at rest.

    Noise that is stronger in a phase at all frequencies is still noise: the highest octave's
    ratio divides the others'.

    Parameters
    ----------
    case : Blocked
    noise : Autoregression
    blocks : ndarray, shape (n, channels)

    Returns
    -------
    list of Cell
    """
    resting = max(1, int((case.groups == 0).sum()))
    scatter = 2.0 / max(20.0, resting / 10.0)
    rest = noise._replace(coefficients=np.repeat(noise.coefficients[:1], 3, axis=0),
                          sigma=np.repeat(noise.sigma[:1], 3, axis=0))
    phases, found = case.phase_rows(), []
    for c in range(len(CHANNELS)):
        if not noise.sigma[:, c].any():
            continue
        white = rest.whiten(blocks[:, c][np.newaxis], c)[0]
        there, spacing = noise.present[:, c], noise.spacing(c)
        octaves = {word: _octaves(white[there], (rows & noise.rows[:, c])[there], spacing)
                   for word, rows in phases.items()}
        expected = _colour(list(octaves.values()))
        for word, (energy, dof) in octaves.items():
            ratio = energy / np.maximum(dof, 1.0) / expected
            common = max(1.0, float(ratio[-1])) if dof[-1] > 20 else 1.0
            for b, band in enumerate(BANDS[:-1]):
                if dof[b] >= 4:
                    over = ratio[b] / common - 1.0
                    z = over / np.sqrt(2.0 / dof[b] + scatter)
                    z = min(z, _cube_root(ratio[b] / common, dof[b]))
                    found.append(Cell(c, word, band, float(np.sqrt(max(0.0, over))), float(z)))
    return sorted(found, key=lambda cell: -cell.z)


def _colour(octaves: list[tuple[Array, Array]]) -> Array:
    """
    Follow a channel's noise to low frequencies, where a short rest says nothing about it.

    Noise grows steadily from octave to octave and is there in most phases; shape (bands,).
    """
    ratios = np.array([np.where(dof >= 4, energy / np.maximum(dof, 1.0), np.nan)
                       for energy, dof in octaves])
    expected = np.ones(len(BANDS))
    for b in range(len(BANDS) - 2, -1, -1):
        there = ratios[np.isfinite(ratios[:, b]), b]
        steepest = expected[b + 1] * STEEPEST * (LOWEST if b == 0 else 1.0)
        if len(there):
            expected[b] = min(max(1.0, float(np.median(there))), steepest)
    return expected


def _cube_root(ratio: float, dof: float) -> float:
    """Give the normal score of a chi-square ratio (Wilson and Hilferty)."""
    q = 2.0 / (9.0 * dof)
    return float((np.cbrt(ratio) - (1.0 - q)) / np.sqrt(q))


def _octaves(white: Array, rows: NDArray[np.bool_], spacing: float) -> tuple[Array, Array]:
    energy, dof = np.zeros(len(BANDS)), np.zeros(len(BANDS))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    for i, j in zip(edges[::2], edges[1::2]):
        n = j - i
        if n < max(FEWEST, SHORTEST / spacing):
            continue
        power = np.abs(np.fft.rfft(white[i:j])) ** 2 / n
        weight = np.full(len(power), 2.0)
        weight[0] = 1.0
        frequency = np.arange(len(power)) * RATE / spacing / n
        for b, (low, high) in enumerate(BANDS):
            chosen = (frequency >= low) & (frequency < high)
            energy[b] += float(np.sum((power * weight)[chosen]))
            dof[b] += float(np.sum(weight[chosen]))
    return energy, dof


def impulses(noise: Autoregression, blocks: Array) -> Array:
    """Count innovations of each channel that noise does not make, shape (channels,)."""
    return np.array([
        np.sum(np.abs(noise.whiten(blocks[:, c][np.newaxis], c)) > IMPULSE)
        if noise.sigma[:, c].any() else 0 for c in range(len(CHANNELS))])
