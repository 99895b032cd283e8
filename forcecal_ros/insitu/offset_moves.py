"""Whether the offset stayed, from data set to data set and within each: a tare moves it."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.blocks import Blocks, Mask
from forcecal_ros.insitu.tally import TINY
import numpy as np

MISFITS = 4.0
"""Moves that are fewer misfits of a data set's own affine map than this are not told from them."""


EXPLAINS, DRIFTS = 0.5, 1.2
"""A jump is told where it explains this share of what an affine map leaves, and so many times what
a steady drift explains: half-way a drift explains three quarters of a jump, and a jump of a drift.
Of the hysteresis and bends of usual sensors a jump explains a fifth."""

SURE = 200.0
"""Chi-square that a jump explains at least: of eight channels once in 10^30 by chance, and noise
is known to some percent only."""

SIDE = 0.15
"""Share of a data set on either side of a jump, at least."""


class Jump(NamedTuple):
    """From when on [s] channels are off by up to which share of what gravity moves them."""

    start: float
    share: float


def jump_within(blocks: Blocks, use: Mask) -> Jump | None:
    """Find the instant from which on a data set's channels are off, however gravity turns."""
    g, raw, start = blocks.regressors[use, :3], blocks.raw[use], blocks.start[use]
    n = len(raw)
    root = np.linalg.cholesky(blocks.raw_noise / blocks.samples)
    white = np.linalg.solve(root, (raw - raw.mean(axis=0)).T).T
    q, _ = np.linalg.qr(np.column_stack([np.ones(n), g]))
    off = white - q @ (q.T @ white)
    splits = np.arange(max(1, round(SIDE * n)), n - round(SIDE * n))
    if not len(splits):
        return None
    # what follows a split less its affine part, by sums from there on: memory grows with n only
    after_q, after_off = (np.cumsum(x[::-1], axis=0)[::-1][splits] for x in (q, off))
    size = n - splits - (after_q**2).sum(axis=1)
    gains = (after_off**2).sum(axis=1) / np.maximum(size, TINY)
    drift = np.arange(n) / n
    drift -= q @ (q.T @ drift)
    steady = ((drift @ off)**2).sum() / max(float(drift @ drift), TINY)
    best = int(np.argmax(gains))
    if gains[best] < max(SURE, EXPLAINS * float((off**2).sum()), DRIFTS * steady):
        return None
    jump = np.abs(root @ after_off[best] / size[best])
    span = np.maximum(affine(g, raw)[2], 1e-12)
    return Jump(float(start[splits[best]]), float((jump / span).max()))


def offset_moves(data_sets: Sequence[tuple[Blocks, Mask]]) -> Array:
    """
    Compare each data set's own offset with the median of all.

    Unlike the residuals under one shared offset, those of own affine maps do not hold the move.

    Parameters
    ----------
    data_sets : sequence of (Blocks, ndarray of bool)

    Returns
    -------
    ndarray, shape (k,)
        Largest move of a channel over its span; zero where misfits explain it.
    """
    fits = [affine(blocks.regressors[use, :3], blocks.raw[use]) for blocks, use in data_sets]
    offsets = np.array([offset for offset, *_ in fits])
    span = np.max([size for _, _, size in fits], axis=0)
    moves = np.abs(offsets - np.median(offsets, axis=0))
    levers = [_lever(blocks.regressors[use, :3]) for blocks, use in data_sets]
    sure = moves > MISFITS * np.array([lever * rms for lever, (_, rms, _) in zip(levers, fits)])
    return np.asarray((np.where(sure, moves, 0.0) / np.maximum(span, 1e-12)).max(axis=1))


def explained(data_sets: Sequence[tuple[Blocks, Mask]]) -> Array:
    """Share of each channel's variance that own affine maps of gravity explain, shape (n,)."""
    used = [(blocks.regressors[use, :3], blocks.raw[use]) for blocks, use in data_sets]
    residual = np.sum([len(raw) * affine(gravity, raw)[1] ** 2 for gravity, raw in used], axis=0)
    whole = np.sum([len(raw) * raw.var(axis=0, ddof=1) for _, raw in used], axis=0)
    return np.asarray(1 - residual / np.maximum(whole, 1e-24))


def affine(gravity: Array, raw: Array) -> tuple[Array, Array, Array]:
    """Offset, RMS of the misfit, and span of each channel's own affine map of gravity."""
    x = np.column_stack([np.ones(len(gravity)), gravity])
    theta = np.linalg.lstsq(x, raw, rcond=None)[0]
    rms = np.linalg.norm(raw - x @ theta, axis=0) / np.sqrt(max(len(x) - x.shape[1], 1))
    return theta[0], rms, np.ptp(x @ theta, axis=0)


def _lever(gravity: Array) -> float:
    """How far a misfit of RMS 1 may move the offset."""
    x = np.column_stack([np.ones(len(gravity)), gravity])
    return float(np.sqrt(len(x) * np.linalg.pinv(x.T @ x)[0, 0]))
