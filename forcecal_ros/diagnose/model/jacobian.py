"""
Columns of the Jacobian: what one unit of a parameter changes in every block and channel.

Hundreds are held at once, so each signal is held in sixteen bits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import pieces
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset, STREAM_SLICES
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.signals import block_means, Signals
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Compact:
    """
    Signals as whole numbers of a unit of its own each: right to 1.5e-5 of its largest value.

    Attributes
    ----------
    numbers : ndarray of int16, shape (..., n)
    unit : ndarray of float32, shape (..., 1)
    """

    numbers: NDArray[np.int16]
    unit: NDArray[np.float32]

    @classmethod
    def of(cls, signals: Array | NDArray[np.float32]) -> 'Compact':
        """Round signals, time last."""
        unit = np.abs(signals).max(axis=-1, keepdims=True, initial=0.0).astype(np.float32)
        unit = np.where(unit > 1e-30, unit / np.float32(np.iinfo(np.int16).max), np.float32(1.0))
        scaled = signals * (1.0 / unit)
        return cls(np.rint(scaled, out=scaled).astype(np.int16), unit)

    @classmethod
    def joined(cls, parts: Sequence['Compact']) -> 'Compact':
        """Put several signals below each other, shape (k, n)."""
        return cls(np.concatenate([one.numbers for one in parts]),
                   np.concatenate([one.unit for one in parts]))

    def values(self, rows: slice = slice(None)) -> NDArray[np.float32]:
        """Return the signals, or a part of their time."""
        return np.asarray(self.numbers[..., rows] * self.unit)

    def combined(self, weights: Array) -> Array:
        """Sum k signals with some weights, shape (..., k) to (..., n)."""
        out = np.empty((*weights.shape[:-1], self.numbers.shape[-1]))
        for rows in pieces(out.shape[-1]):
            out[..., rows] = weights @ self.values(rows)
        return out

    def times(self, factor: float) -> 'Compact':
        """Return the signals times a factor, without a copy."""
        return Compact(self.numbers, self.unit * np.float32(factor))


def stacked(first: Array, others: Sequence[Compact | None]) -> Callable[[slice], Array]:
    """
    Return what gives a signal and others at some of their samples, shape (1 + k, samples).

    Parameters
    ----------
    first : ndarray, shape (n,)
    others : sequence of Compact or None
        None represents nothing but 0.
    """
    def at(rows: slice) -> Array:
        out = np.zeros((1 + len(others), rows.stop - rows.start))
        out[0] = first[rows]
        for row, one in zip(out[1:], others):
            if one is not None:
                row[:] = one.values(rows)
        return out

    return at


Column = dict[int, Compact]
"""Channel index -> blocks of one recording; channels that nothing happens to are left out."""


def column(difference: Array, level: Array) -> Column:
    """
    Keep the channels in which something happens.

    Parameters
    ----------
    difference : ndarray, shape (n, channels)
    level : ndarray, shape (channels,)
        Of the noise.
    """
    largest = np.maximum(difference.max(axis=0), -difference.min(axis=0))
    return {c: Compact.of(difference[:, c]) for c in range(len(CHANNELS))
            if largest[c] > 1e-7 * level[c]}


NEARBY = 1e-3
"""
Part of a nuisance's size by which it is changed where signals are linear about points that were
tried: the nearest of them stays the same.
"""


def nuisance_column(dataset: Dataset, nuisance: Nuisance, size: float, rig: Rig,
                    reference: Signals, residual: Array, level: Array) -> Column:
    """
    Give the column of a nuisance, for a change by its prior standard deviation.

    Parameters
    ----------
    size : float
        Its prior standard deviation.
    rig : Rig
        Where the column is taken.
    reference : Signals
        Of that rig.
    residual : ndarray, shape (n, channels)
        Measured less reference.
    level : ndarray, shape (channels,)
        Of the noise.
    """
    if nuisance.acts_on == 'rig':
        simulation = dataset.simulation
        part = 1.0 if simulation.tangent(rig, nuisance.name) is None else NEARBY
        changed = simulation.signals(nuisance.apply(rig, part * size))
        return column((residual - dataset.measured.residual(changed)) / part, level)
    channel, change = sensor_change(nuisance, size, rig, dataset.simulation.clear(reference),
                                    dataset.simulation.accelerometer)
    return {channel: Compact.of(dataset.measured.present[:, channel] * change)}


def sensor_change(nuisance: Nuisance, size: float, rig: Rig, reference: Signals,
                  accelerometer: str) -> tuple[int, Array]:
    """
    Return the channel that a sensor's own gain or offset acts on, and the change in its blocks.

    Parameters
    ----------
    size : float
        Of the gain or offset.
    rig : Rig
        Of which the reference is.
    accelerometer : str
        Which one the rig carries.
    """
    i = nuisance.axis
    if nuisance.acts_on == 'wrench':
        channel, signal, rest = i, reference.wrench[:, i], rig.wrench_sensor.bias[i]
    else:
        channel, signal = STREAM_SLICES['accelerometer'].start + i, reference.volts[:, i]
        rest = rig.accelerometer.model(accelerometer).offset[i]
    shape = signal - rest if 'gain' in nuisance.name else np.ones(len(signal))
    return channel, size * block_means(shape[:, np.newaxis])[:, 0]


def combined(columns: Sequence[Column], x: Array, n: int) -> Array:
    """Sum columns times parameters of one recording, shape (n, channels)."""
    out = np.zeros((n, len(CHANNELS)))
    for one, value in zip(columns, x):
        if value:
            for c, rows in one.items():
                out[:, c] += value * rows.values()
    return out
