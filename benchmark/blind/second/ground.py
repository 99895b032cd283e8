"""How much a departure matters: its energy over the noise, less what nuisances take up."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from blind.robot import Array
import numpy as np
from scipy.optimize import lsq_linear

Departure = Mapping[str, Array]
"""Topic -> change of its channels, (n, k)."""
WITHIN = 3.0
"""Sigmas within which the tool recalibrates, as docs/explanation/diagnosis.md states."""


class Ground:
    """The recording that judges, without noise, and what its nuisances look like."""

    def __init__(self, noise: Mapping[str, Sequence[Any]], sigmas: Mapping[str, Array],
                 columns: Sequence[tuple[str, Departure]]) -> None:
        self._noise, self._sigmas = noise, sigmas
        self._keys = [key for key, _ in columns]
        self._plain = [column for _, column in columns]
        self._columns = np.array([self.whitened(column) for _, column in columns])
        self._gram = self._columns @ self._columns.T + np.eye(len(columns))

    def whitened(self, departure: Departure) -> Array:
        """Return a departure in units of the noise, in one row."""
        return np.concatenate([
            noise.whiten(departure[topic][:, j], self._sigmas[topic][j])
            for topic, channels in self._noise.items() if topic in departure
            for j, noise in enumerate(channels)])

    def _product(self, one: Array, other: Array, without: str) -> float:
        """Return a product of whitened departures, less what nuisances take up of it."""
        kept = np.array([key != without for key in self._keys])
        first, second = ((self._columns @ x)[kept] for x in (one, other))
        return float(one @ other - first @ np.linalg.solve(self._gram[np.ix_(kept, kept)],
                                                           second))

    def net(self, departure: Departure, without: str = '') -> float:
        """Return its energy; ``without``: a nuisance that may not take up any."""
        d = self.whitened(departure)
        return max(0.0, self._product(d, d, without))

    def strength(self, measured: Departure, departure: Departure, without: str = ''
                 ) -> tuple[float, float]:
        """Return how much of a departure is in what was measured, and the standard error."""
        d = self.whitened(departure)
        energy = max(1e-12, self._product(d, d, without))
        return self._product(d, self.whitened(measured), without) / energy, energy**-0.5

    def left(self, departure: Departure, without: str = '') -> dict[str, Array]:
        """Return it less what nuisances take up, each within three times its prior's sigma."""
        kept = np.array([key != without for key in self._keys])
        root = np.linalg.cholesky(self._gram[np.ix_(kept, kept)])
        wanted = np.linalg.solve(root, (self._columns @ self.whitened(departure))[kept])
        weights = np.zeros(len(kept))
        weights[kept] = lsq_linear(root.T, wanted, (-WITHIN, WITHIN)).x
        out = {topic: np.array(values) for topic, values in departure.items()}
        for weight, column in zip(weights, self._plain):
            for topic in out:
                if topic in column:
                    out[topic] -= weight * column[topic]
        return out


def sized(energy_of: Callable[[float], float], wanted: float, start: float, limit: float
          ) -> tuple[float, float]:
    """
    Find the size at which something has an energy.

    Parameters
    ----------
    energy_of : callable
        Size -> energy, which grows with it about as a power.
    wanted : float
    start, limit : float
        A size to begin with, and the largest.

    Returns
    -------
    size, energy : float
        As near as eight tries come.
    """
    size, tried = min(start, limit), []
    for _ in range(8):
        energy = energy_of(size)
        if not np.isfinite(energy):
            size *= 0.3
            continue
        tried.append((size, energy))
        if abs(energy / wanted - 1) < 0.05 or (size >= limit and energy < wanted):
            break
        size = min(limit, _next(tried, wanted))
    return min(tried, key=lambda one: abs(np.log(max(one[1], 1e-9) / wanted)))


def _next(tried: Sequence[tuple[float, float]], wanted: float) -> float:
    """Return the next size: between two that enclose, else along the last slope."""
    below = max((one for one in tried if one[1] < wanted), default=None)
    above = min((one for one in tried if one[1] >= wanted), default=None)
    if below and above and below[0] < above[0]:
        low, high = (np.log([size, max(energy, 1e-9)]) for size, energy in (below, above))
        share = np.clip((np.log(wanted) - low[1]) / max(high[1] - low[1], 1e-9), 0.1, 0.9)
        return float(np.exp(low[0] + share * (high[0] - low[0])))
    size, energy = tried[-1]
    return float(size * np.clip(np.sqrt(wanted / max(energy, 1e-9)), 0.02, 50.0))
