"""A data set of any length as one small matrix of sums: all that least squares needs of it."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.jit import compiled_in_any_order
from forcecal_ros.insitu.prepare import Prepared
from forcecal_ros.insitu.smoothing import smooth
import numpy as np

TRUNCATE = 1e-10
"""Directions of the regressors with less than this share of the largest moment are not used."""

PIECE = 64
"""Samples that are summed at a time: twenty columns of so many fit a first-level cache."""


@dataclass(frozen=True)
class Moments:
    """
    Sums over the samples of a data set, noise of the accelerometer taken off.

    Attributes
    ----------
    count : int
        Samples.
    singular_values : ndarray, shape (n,)
        Of the centred raw measurements, over sqrt(count), [Traversaro2014] Eq. 10.
    mean : ndarray, shape (n,)
        Of the raw measurements, Eq. 9.
    scatter : ndarray, shape (n, n)
        Covariance of the raw measurements, their white noise taken off.
    directions : ndarray, shape (q, m)
        As many pseudo-samples of the regressors as they have excited directions; their outer
        products add up to the sum over all samples.
    raw : ndarray, shape (q, n)
        Raw measurements projected on the same pseudo-samples.
    ones : ndarray, shape (q,)
        The constant 1 projected on the same pseudo-samples.
    combine : ndarray, shape (m, q)
        Regressors of a sample times this are its weights in the pseudo-samples.
    spread : ndarray, shape (3, 3)
        Covariance of measured gravity, noise taken off [(m/s^2)^2].
    """

    count: int
    singular_values: Array
    mean: Array
    scatter: Array
    directions: Array
    raw: Array
    ones: Array
    combine: Array
    spread: Array

    def without(self, part: Array, raw: Array, regressors: Array) -> 'Moments':
        """
        Take a known part off the raw measurements.

        Parameters
        ----------
        part, raw : ndarray, shape (b, n)
            The part, and raw measurements with it, as means of equally long blocks.
        regressors : ndarray, shape (b, m)
            Of the same blocks.
        """
        without = raw - part
        change = np.cov(without.T, bias=True) - np.cov(raw.T, bias=True)
        each = self.count / len(part)
        return replace(self, mean=self.mean - part.mean(axis=0), scatter=self.scatter + change,
                       raw=self.raw - each * (regressors @ self.combine).T @ part)

    @property
    def constant_weight(self) -> float:
        """Samples' worth of information on a constant beside the regressors."""
        return float(self.count - self.ones @ self.ones)


def accumulate(chunks: Iterable[Prepared], kept: tuple[tuple[float, float], ...], window: int,
               order: int, raw_noise: Array, gravity_noise: Array, magnitude: float | None
               ) -> Moments:
    """
    Filter the kept stretches and fold all samples into their moments, in constant memory.

    At rest the accelerometer tells a direction only: its readings are scaled to the magnitude of
    gravity, before the filter, which is linear and so keeps what holds for a sample. The rest
    of its noise is an error in the regressor: its share of the second moments, scaled by the
    filter's gain, is taken off before anything is regressed on them.

    Parameters
    ----------
    kept : tuple of (float, float)
        Stretches to use [s].
    window, order : int
        Of the filter.
    raw_noise : ndarray, shape (n, n)
        Covariance of a raw sample's white noise.
    gravity_noise : ndarray, shape (3, 3)
        The same of the accelerometer [(m/s^2)^2].
    magnitude : float or None
        Of gravity [m/s^2]; None in motion.

    Raises
    ------
    DataError
        No sample lies in the stretches, or gravity has no scatter beyond its noise.
    """
    size = None if magnitude is None else magnitude + np.trace(gravity_noise) / (3 * magnitude)
    reference: Array | None = None
    gain = 0.0
    for run in _runs(chunks, kept, size):
        for part in smooth(run, window, order):
            if reference is None:
                reference = part.values[0].copy()
                reference[:-len(raw_noise)] = 0.0
                gram = np.zeros((1 + len(reference), 1 + len(reference)))
            _add_products(part.values, reference, gram)
            gain += part.noise_gain
    if reference is None:
        raise DataError('no sample lies in the stretches that are used')
    gram = np.tril(gram) + np.tril(gram, -1).T
    if magnitude is not None:
        gravity_noise = _tangential(gram, gravity_noise, magnitude)
    return _moments(gram, reference[-len(raw_noise):], gain, raw_noise, gravity_noise)


def _tangential(gram: Array, gravity_noise: Array, magnitude: float) -> Array:
    """Mean covariance of noise across gravity, which is what scaling leaves of it."""
    along = gram[1:4, 1:4] / (gram[0, 0] * magnitude ** 2)
    return np.asarray(np.trace(gravity_noise) / 3 * (np.eye(3) - along))


def _runs(chunks: Iterable[Prepared], kept: tuple[tuple[float, float], ...],
          magnitude: float | None) -> Iterator[Iterator[Array]]:
    """
    Yield each kept stretch as an iterator over chunks of [regressors, raw]; read in order.

    Measured gravity is scaled to ``magnitude`` [m/s^2]; noise across it makes its mean shorter.
    """
    source = iter(chunks)
    held: list[Prepared] = []

    def stretch(start: float, end: float) -> Iterator[Array]:
        while True:
            chunk = held.pop() if held else next(source, None)
            if chunk is None:
                return
            i, j = np.searchsorted(chunk.t, [start, end])
            if j > i:
                yield _rows(chunk.regressors[i:j], chunk.raw[i:j], magnitude or np.nan)
            if j < len(chunk.t):
                held.append(chunk.take(slice(j, None)))
                return

    for start, end in kept:
        yield stretch(start, end)


@compiled_in_any_order
def _rows(regressors: Array, raw: Array, magnitude: float) -> Array:
    """Put raw channels beside regressors, gravity of a magnitude unless that is NaN."""
    m, n = regressors.shape[1], raw.shape[1]
    rows = np.empty((len(raw), m + n))
    for i in range(len(raw)):
        x, y, z = regressors[i, 0], regressors[i, 1], regressors[i, 2]
        scale = magnitude / np.sqrt(x * x + y * y + z * z)
        for k in range(m):
            rows[i, k] = regressors[i, k]
        if not np.isnan(magnitude):
            for k in range(3):
                rows[i, k] *= scale
        for k in range(n):
            rows[i, m + k] = raw[i, k]
    return rows


@compiled_in_any_order
def _add_products(rows: Array, reference: Array, gram: Array) -> None:
    """Add to the lower half of X^T X, X = [1, rows - reference], piece by piece."""
    n = len(reference)
    x = np.ones((1 + n, PIECE))
    for start in range(0, len(rows), PIECE):
        size = min(PIECE, len(rows) - start)
        for i in range(size):
            for k in range(n):
                x[1 + k, i] = rows[start + i, k] - reference[k]
        for k in range(1 + n):
            for j in range(k + 1):
                total = 0.0
                for i in range(size):
                    total += x[k, i] * x[j, i]
                gram[k, j] += total


def _moments(gram: Array, reference: Array, gain: float, raw_noise: Array,
             gravity_noise: Array) -> Moments:
    n = len(reference)
    m = len(gram) - 1 - n
    count = gram[0, 0]
    covariance = (gram[1:, 1:] - np.outer(gram[0, 1:], gram[0, 1:]) / count) / count
    spread = covariance[:3, :3] - gain / count * gravity_noise
    scatter = covariance[m:, m:]
    second = gram[1:m + 1, 1:m + 1].copy()
    second[:3, :3] -= gain * gravity_noise
    values, vectors = np.linalg.eigh(second)
    strong = values > TRUNCATE * values[-1]
    root, vectors = np.sqrt(values[strong]), vectors[:, strong]
    combine = vectors / root
    return Moments(
        count=round(count),
        singular_values=np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[::-1], 0.0)),
        mean=reference + gram[0, m + 1:] / count,
        scatter=scatter - gain / count * raw_noise,
        directions=(vectors * root).T,
        raw=combine.T @ (gram[1:m + 1, m + 1:] + np.outer(gram[1:m + 1, 0], reference)),
        ones=combine.T @ gram[1:m + 1, 0],
        combine=combine,
        spread=spread)
