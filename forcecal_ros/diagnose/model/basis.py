"""Smooth functions of motion and time, of which a model's discrepancy is made."""

from collections.abc import Iterator, Sequence
from itertools import chain, combinations_with_replacement
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.sim.signals import BLOCK, block_means, RATE, Signals
import numpy as np

BUMPS = 7
"""Radial bumps along each axis of the workspace: a fifth of a robot's cell between two."""

MEMORIES = (0.1, 0.5, 2.0)
"""Time constants of what a sensor or mount remembers of its load [s]: foam, glue, thermal."""

COSINES = 13
"""Slow cosines of each recording: half periods of a minute's drift down to five seconds."""

SLOW_MOTION = 0.05
"""Part of the RMS speed below which friction is seen to turn over."""


class Basis(NamedTuple):
    """
    Features of recordings, and how a discrepancy's variance is spread over them.

    Attributes
    ----------
    rows : tuple of Compact, shape (k, n)
        Of each recording, one value a block; of unit RMS over all recordings, without mean.
    variance : ndarray, shape (k,)
        Of each feature's weight, in that of the whole; each group has the same.
    """

    rows: tuple[Compact, ...]
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
    groups = [_scaled(rows) for rows in chain(zip(*map(_of_motion, signals), strict=True),
                                              _of_time(signals, frequencies))]
    members = np.array([len(of_first.numbers) for of_first, *_ in groups])
    shares = 1.0 / np.maximum(members * np.count_nonzero(members), 1)
    return Basis(tuple(map(Compact.joined, zip(*groups))), np.repeat(shares, members))


def _scaled(rows: Sequence[Sequence[Array]]) -> list[Compact]:
    """
    Take a group's means off, bring all to unit RMS, and leave out what does not vary.

    Parameters
    ----------
    rows : sequence of sequence of ndarray, shape (n,)
        Of each recording, as many in each.

    Returns
    -------
    list of Compact, shape (k, n)
        Of each recording: there are some hundred in all.
    """
    n = sum(len(own[0]) for own in rows)
    means = [sum(float(row.sum()) for row in feature) / n for feature in zip(*rows)]
    flat = [[row - mean for row, mean in zip(own, means)] for own in rows]
    size = np.array([np.sqrt(sum(float(row @ row) for row in feature) / n)
                     for feature in zip(*flat)])
    kept = np.flatnonzero(size > max(1e-9 * size.max(), 1e-15))
    return [Compact.of(np.array([own[i] / size[i] for i in kept]).reshape(
        len(kept), len(own[0]))) for own in flat]


def _of_motion(s: Signals) -> Iterator[Sequence[Array]]:
    """Give one after the other the groups of features that mean the same in every recording."""
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
    yield list(gravity)
    yield _products(gravity)
    yield [*heading, *_products(heading)]
    yield [*p, *_products(p - p.mean(axis=1, keepdims=True))]
    yield _bumps(p)
    yield list(rates)
    yield _turning_over(rates)
    yield [*np.abs(rates), *(rates * np.abs(rates)), *_products(omega)]
    yield [*force, *_means(s.alpha), *_means(s.acceleration)]
    yield [*wrench, *slide, *_products(wrench[:3]), *wrench[3:] ** 2, *slide ** 3,
           *_lengths(wrench)]
    yield [*contact, *np.sqrt(np.abs(contact)), *contact ** 2,
           (np.abs(contact).max(axis=0) > 0.0).astype(float)]
    yield list(changing)
    yield list(np.gradient(changing, BLOCK, axis=1))
    yield [_remembered(row, t) for t in MEMORIES for row in loads]
    yield [*(time * wrench), *(time ** 2 * wrench), *(time * force)]


def _of_time(signals: Sequence[Signals], frequencies: Sequence[float]
             ) -> Iterator[Sequence[Sequence[Array]]]:
    """Give drifts, then lines, which begin anew in each recording; flat in the others."""
    counts = [len(s.optidrive) // round(BLOCK * RATE) for s in signals]
    kinds = zip(*(_waves(s.start, n, frequencies) for s, n in zip(signals, counts)))
    for waves in (one for one in kinds if one[0]):
        yield [[row if i == j else np.zeros(n) for j, own in enumerate(waves) for row in own]
               for i, n in enumerate(counts)]


def _waves(start: float, n: int, frequencies: Sequence[float]) -> tuple[list[Array], list[Array]]:
    """Return the slow cosines and the lines of one recording."""
    t, turns = BLOCK * (np.arange(n) + 0.5), 2.0 * np.pi * np.array(frequencies)
    return ([np.cos(np.pi * k * t / (n * BLOCK)) for k in range(COSINES)],
            [wave(rate * (start + t)) for rate in turns for wave in (np.sin, np.cos)])


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
