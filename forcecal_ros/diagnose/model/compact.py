"""Signals in sixteen bits, of which hundreds are held at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import pieces
import numpy as np
from numpy.typing import NDArray

LARGEST = 32767
"""Largest whole number of sixteen bits."""


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
        unit = np.where(unit > 1e-30, unit / np.float32(LARGEST), np.float32(1.0))
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
