"""Smooth functions of motion and time, of which a model's discrepancy is made."""

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.simulators.signals import BLOCK, block_means, RATE, Signals
import numpy as np
from numpy.typing import NDArray

BUMPS = 7
"""Radial bumps along each axis of the workspace: a fifth of a robot's cell between two."""

MEMORIES = (0.1, 0.5, 2.0)
"""Time constants of what a sensor or mount remembers of its load [s]: foam, glue, thermal."""

COSINES = 13
"""Slow cosines of each recording: half periods of a minute's drift down to five seconds."""

SLOW_MOTION = 0.05
"""Part of the RMS speed below which friction is seen to turn over."""

NEGLIGIBLE = 1e-9
"""Part of its group's largest RMS below which a feature does not vary."""


class Basis(NamedTuple):
    """
    Features of recordings, and how a discrepancy's variance is spread over them.

    Attributes
    ----------
    rows : tuple of ndarray, shape (k, n)
        Of each recording, one value a block; of unit RMS over all recordings, without mean.
    variance : ndarray, shape (k,)
        Of each feature's weight, in that of the whole; each group has the same.
    """

    rows: tuple[NDArray[np.float32], ...]
    variance: Array


def basis(signals: Sequence[Signals], frequencies: Sequence[float] = ()) -> Basis:
    """
    List what a discrepancy may depend on [KennedyOHagan2001].

    Parameters
    ----------
    signals : sequence of Signals
        Of each recording, simulated.
    frequencies : sequence of float
        Of lines that the residual shows [Hz].
    """
    names: list[str] = []
    parts: list[list[Array]] = []
    for s in signals:
        groups = _of_motion(s)
        names = list(groups)
        parts.append([np.stack(rows) for rows in groups.values()])
    rows = [np.concatenate(one) for one in parts]
    group = np.repeat(np.arange(len(names)), [len(one) for one in parts[0]])
    own = [_of_time(s, frequencies) for s in signals]
    for kind in range(len(own[0])):
        group = np.append(group, np.full(sum(len(o[kind]) for o in own), len(names) + kind))
        rows = [np.concatenate([r, *(o[kind] if j == i else np.zeros((len(o[kind]), r.shape[1]))
                                     for j, o in enumerate(own))]) for i, r in enumerate(rows)]
    return _scaled(rows, group)


def _scaled(rows: list[Array], group: NDArray[np.intp]) -> Basis:
    """Take the means off, bring all to unit RMS, and leave out what does not vary."""
    n = sum(r.shape[1] for r in rows)
    mean = sum(r.sum(axis=1) for r in rows) / n
    flat = [r - mean[:, np.newaxis] for r in rows]
    size = np.sqrt(sum(np.sum(r ** 2, axis=1) for r in flat) / n)
    largest = np.array([size[group == g].max() for g in group])
    kept = size > np.maximum(NEGLIGIBLE * largest, 1e-15)
    used, members = np.unique(group[kept], return_counts=True)
    share = dict(zip(used.tolist(), (1.0 / (members * len(used))).tolist()))
    return Basis(tuple((r[kept] / size[kept, np.newaxis]).astype(np.float32) for r in flat),
                 np.array([share[g] for g in group[kept].tolist()]))


def _of_motion(s: Signals) -> dict[str, list[Array]]:
    """Return the groups of features that mean the same in every recording."""
    p, R = _means(s.position), s.R_base_sensor
    gravity, heading = _means(R[:, 2, :]), _means(R[:, 0, :])
    velocity, omega = _means(s.velocity), _means(s.omega)
    own = _means(np.einsum('nij,ni->nj', R, s.velocity))
    speed, slide = _means(s.speed[:, np.newaxis]), _means(s.optidrive[:, np.newaxis])
    wrench, force = _means(s.wrench), _means(s.specific_force)
    wrench = wrench - wrench.mean(axis=1, keepdims=True)
    contact = _means(s.contact[:, :3])
    rates = np.concatenate([velocity, own, omega, speed])
    loads = np.concatenate([wrench, force, slide])
    time = BLOCK * np.arange(p.shape[1])
    changing = np.gradient(loads, BLOCK, axis=1)
    return {
        'gravity': list(gravity),
        'gravity squared': _products(gravity),
        'heading': [*heading, *_products(heading)],
        'position': [*p, *_products(p - p.mean(axis=1, keepdims=True))],
        'place': _bumps(p),
        'rates': list(rates),
        'turning over': _turning_over(rates),
        'drag': [*np.abs(rates), *(rates * np.abs(rates)), *_products(omega)],
        'acceleration': [*force, *_means(s.alpha), *_means(s.acceleration)],
        'load': [*wrench, *slide, *_products(wrench[:3]), *wrench[3:] ** 2, *slide ** 3,
                 *_lengths(wrench)],
        'touch': [*contact, *np.sqrt(np.abs(contact)), *contact ** 2,
                  (np.abs(contact).max(axis=0) > 0.0).astype(float)],
        'load changing': list(changing),
        'load changing faster': list(np.gradient(changing, BLOCK, axis=1)),
        'memory': [_remembered(row, t) for t in MEMORIES for row in loads],
        'load over time': [*(time * wrench), *(time ** 2 * wrench), *(time * force)],
    }


def _of_time(s: Signals, frequencies: Sequence[float]) -> tuple[Array, Array]:
    """Return drifts and lines, which begin anew in each recording."""
    n = len(s.optidrive) // round(BLOCK * RATE)
    u = (np.arange(n) + 0.5) / n
    t = s.start + BLOCK * (np.arange(n) + 0.5)
    waves = [wave(2.0 * np.pi * f * t) for f in frequencies for wave in (np.sin, np.cos)]
    return (np.stack([np.cos(np.pi * k * u) for k in range(COSINES)]),
            np.array(waves).reshape(-1, n))


def _means(values: Array) -> Array:
    """Return block means, channels first."""
    return block_means(values).T


def _products(rows: Array) -> list[Array]:
    return [rows[i] * rows[j] for i, j in combinations_with_replacement(range(len(rows)), 2)]


def _lengths(wrench: Array) -> list[Array]:
    return [np.linalg.norm(wrench[:3], axis=0), np.linalg.norm(wrench[3:], axis=0)]


def _bumps(position: Array) -> list[Array]:
    out = []
    for row in position:
        low, high = float(row.min()), float(row.max())
        width = (high - low) / (BUMPS - 1) if high > low else 1.0
        out += [np.exp(-0.5 * ((row - c) / width) ** 2) for c in np.linspace(low, high, BUMPS)]
    return out


def _turning_over(rates: Array) -> list[Array]:
    rms = np.sqrt(np.mean(rates ** 2, axis=1, keepdims=True))
    return list(np.tanh(rates / np.where(rms > 0.0, SLOW_MOTION * rms, 1.0)))


def _remembered(row: Array, memory: float) -> Array:
    """Return a signal behind a first-order lag, in equilibrium at the beginning."""
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    a = float(np.exp(-BLOCK / memory))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], row, zi=[a * row[0]])[0])
