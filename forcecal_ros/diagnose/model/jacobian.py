"""Columns of the Jacobian: what one unit of a parameter changes in every block and channel."""

from collections.abc import Sequence

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, Dataset, STREAM_SLICES
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import Rig
from forcecal_ros.sim.signals import Signals
import numpy as np

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
        changed = dataset.simulation.signals(nuisance.apply(rig, size))
        return column(residual - dataset.measured.residual(changed), level)
    i = nuisance.axis
    if nuisance.acts_on == 'wrench':
        channel, signal, rest = i, reference.wrench[:, i], rig.wrench_sensor.bias[i]
    else:
        channel, signal = STREAM_SLICES['accelerometer'].start + i, reference.volts[:, i]
        rest = rig.accelerometer.model(dataset.simulation.accelerometer).offset[i]
    shape = signal - rest if 'gain' in nuisance.name else np.ones(len(signal))
    per_block = dataset.measured.present[:, channel] * size * shape.reshape(len(residual),
                                                                            -1).mean(axis=1)
    return {channel: Compact.of(per_block)}


def combined(columns: Sequence[Column], x: Array, n: int) -> Array:
    """Sum columns times parameters of one recording, shape (n, channels)."""
    out = np.zeros((n, len(CHANNELS)))
    for one, value in zip(columns, x):
        if value:
            for c, rows in one.items():
                out[:, c] += value * rows.values()
    return out
