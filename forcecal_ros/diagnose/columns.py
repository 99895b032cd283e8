"""Sensitivities: what one step of a parameter does to every block of every channel."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.diagnose.case import Case
from forcecal_ros.diagnose.channels import CHANNELS, COLUMNS
from forcecal_ros.diagnose.evidence import Gram
from forcecal_ros.diagnose.nuisances import Nuisance
from forcecal_ros.diagnose.simulation import Signals
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import Autoregression
import numpy as np
from numpy.typing import NDArray

NOTHING = 1e-7
"""Fraction of a channel's noise below which a step does nothing to it."""

Column = dict[int, NDArray[np.float32]]
"""Channel index -> blocks of one recording; channels that nothing happens to are left out."""


class Step(NamedTuple):
    """
    One parameter's column in each recording.

    Attributes
    ----------
    columns : tuple of Column
        One per recording, for one unit of the parameter.
    """

    columns: tuple[Column, ...]


def column(difference: Array, level: Array) -> Column:
    """
    Keep the channels in which something happens.

    Parameters
    ----------
    difference : ndarray, shape (n, channels)
    level : ndarray, shape (channels,)
        Of the noise.

    Returns
    -------
    Column
    """
    largest = np.abs(difference).max(axis=0)
    return {c: difference[:, c].astype(np.float32) for c in range(len(CHANNELS))
            if largest[c] > NOTHING * level[c]}


def nuisance_column(case: Case, nuisance: Nuisance, size: float, rig: Rig, reference: Signals,
                    blocks: Array, level: Array) -> Column:
    """
    Give the column of one spread of a nuisance.

    Parameters
    ----------
    case : Case
    nuisance : Nuisance
    size : float
        Of one spread.
    rig : Rig
        Where the column is taken.
    reference : Signals
        Of that rig.
    blocks : ndarray, shape (n, channels)
        Measured less reference.
    level : ndarray, shape (channels,)
        Of the noise.

    Returns
    -------
    Column
    """
    if nuisance.where == 'step':
        since = case.measured.since(CHANNELS[nuisance.axis].stream, nuisance.instant)
        return {nuisance.axis: (size * since).astype(np.float32)}
    if nuisance.where == 'rig':
        changed = case.simulation.signals(nuisance.apply(rig, size))
        return column(blocks - case.measured.blocks(changed), level)
    i = nuisance.axis
    if nuisance.where == 'wrench':
        channel, signal, rest = i, reference.wrench[:, i], rig.wrench_sensor.bias[i]
    else:
        channel, signal = COLUMNS['accelerometer'].start + i, reference.volts[:, i]
        rest = rig.accelerometer.model(case.simulation.accelerometer).offset[i]
    shape = signal - rest if 'gain' in nuisance.name else np.ones(len(signal))
    per_block = case.measured.present[:, channel] * size * shape.reshape(len(blocks), -1).mean(
        axis=1)
    return {channel: per_block.astype(np.float32)}


def gram(noise: Autoregression, columns: Sequence[Column], residual: Array,
         parts: Sequence[NDArray[np.bool_]]) -> list[Gram]:
    """
    Inner products of whitened columns and residual of one recording.

    Parameters
    ----------
    noise : Autoregression
    columns : sequence of Column
    residual : ndarray, shape (n, channels)
    parts : sequence of ndarray of bool, shape (n,)
        Which blocks count; one Gram for each.

    Returns
    -------
    list of Gram
    """
    k = len(columns)
    out = [Gram(np.zeros((k, k)), np.zeros(k), 0.0, 0) for _ in parts]
    for c in range(len(CHANNELS)):
        if not noise.sigma[:, c].any():
            continue
        there = np.array([i for i in range(k) if c in columns[i]], dtype=np.intp)
        rows = np.stack([residual[:, c], *(columns[i][c] for i in there)]).astype(float)
        white = noise.whiten(rows, c)
        for j, part in enumerate(parts):
            chosen = part & noise.rows[:, c]
            if not chosen.any():
                continue
            w = white if chosen.all() else white[:, chosen]
            products = w @ w.T
            g = out[j]
            g.matrix[np.ix_(there, there)] += products[1:, 1:]
            g.vector[there] += products[1:, 0]
            out[j] = g._replace(square=g.square + float(products[0, 0]),
                                n=g.n + int(chosen.sum()))
    return out


def combined(columns: Sequence[Column], x: Array, n: int) -> Array:
    """Sum columns times parameters of one recording, shape (n, channels)."""
    out = np.zeros((n, len(CHANNELS)))
    for one, value in zip(columns, x):
        if value:
            for c, rows in one.items():
                out[:, c] += value * rows
    return out
