"""Inner products of columns, residual and discrepancy, and what follows for any of its sizes."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import STREAM_SLICES
from forcecal_ros.diagnose.model.basis import Basis
from forcecal_ros.diagnose.model.compact import Compact
from forcecal_ros.diagnose.model.evidence import Gram
from forcecal_ros.diagnose.model.scales import FREE, SCALES, Scales, STREAM
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

ASCENTS = 2
"""Rounds over the streams in which their scales are improved one by one."""


class Modes(NamedTuple):
    """
    Whitened features of one channel, as few combinations as matter.

    ``rows``: of each recording, (r, n); ``weights``: features to combinations, (k, r);
    ``trained``, ``all``: inner products over training blocks and over all.
    """

    rows: list[Compact]
    weights: Array
    trained: Array
    all: Array


class Features(Protocol):
    """Features of a discrepancy, whitened."""

    basis: Basis

    def modes(self, c: int) -> Modes:
        """Return those of a channel as few combinations."""

    def factor(self, c: int, trained: bool, size: float) -> Array:
        """Return the Cholesky factor of a channel's information on its combinations."""

    def of_weights(self, weights: Mapping[int, Array], shapes: Sequence[tuple[int, ...]]
                   ) -> list[Array]:
        """Sum the features of each recording with the weights of each channel."""


class Sums(NamedTuple):
    """Inner products of (residual, columns) with themselves and with the combinations."""

    own: Array
    cross: Array
    n: int

    @classmethod
    def empty(cls, k: int, r: int) -> 'Sums':
        """Return those of k columns and r combinations over no sample."""
        return cls(np.zeros((k + 1, k + 1)), np.zeros((r, k + 1)), 0)

    def plus(self, other: 'Sums') -> 'Sums':
        """Add those of other samples."""
        return Sums(self.own + other.own, self.cross + other.cross, self.n + other.n)


class ChannelSums(NamedTuple):
    """One channel's sums over the training blocks and over all; which columns it has."""

    channel: int
    there: NDArray[np.intp]
    trained: Sums
    all: Sums


class Products:
    """
    Inner products from which Gram matrices follow for any size of the discrepancy.

    Parameters
    ----------
    k : int
        Columns.
    """

    def __init__(self, whitened: Features, k: int, channels: list[ChannelSums]) -> None:
        self.whitened, self.k, self.parts = whitened, k, channels
        self._streams: dict[tuple[int, bool, float], Gram] = {}

    def at(self, scales: Scales) -> tuple[Gram, Gram]:
        """
        Integrate the discrepancy out.

        Parameters
        ----------
        scales : tuple of float
            Part of the signals in each stream; 0: there is none.

        Returns
        -------
        trained, held : Gram
            Of the training blocks; and what the others add, given those.
        """
        trained, every = (self._total(part, scales) for part in (True, False))
        return trained, Gram(every.matrix - trained.matrix, every.vector - trained.vector,
                             every.square - trained.square, every.n - trained.n,
                             every.log_det - trained.log_det)

    def _total(self, trained: bool, scales: Scales) -> Gram:
        total = Gram(np.zeros((self.k, self.k)), np.zeros(self.k), 0.0, 0)
        for stream in self.streams():
            total += self._of_stream(stream, trained, scales[stream])
        return total

    def _of_stream(self, stream: int, trained: bool, size: float) -> Gram:
        """Return one stream's Gram; a search for the best sizes changes one after the other."""
        key, k = (stream, trained, size), self.k
        if key not in self._streams:
            matrix, vector, square, n, log_det = np.zeros((k, k)), np.zeros(k), 0.0, 0, 0.0
            for one in (one for one in self.parts if STREAM[one.channel] == stream):
                own, more = self._part(one, trained, size)
                matrix[np.ix_(one.there, one.there)] += own[1:, 1:]
                vector[one.there] += own[1:, 0]
                square += float(own[0, 0])
                n += (one.trained if trained else one.all).n
                log_det += more
            self._streams[key] = Gram(matrix, vector, square, n, log_det)
        return self._streams[key]

    def _part(self, one: ChannelSums, trained: bool, size: float) -> tuple[Array, float]:
        """Return one channel's products beside a discrepancy, and its logarithm."""
        sums = one.trained if trained else one.all
        if size == 0.0 or not len(sums.cross):
            return sums.own, 0.0
        factor = self.whitened.factor(one.channel, trained, size)
        taken = solve_triangular(factor, sums.cross, lower=True, check_finite=False)
        return sums.own - taken.T @ taken, 2.0 * float(np.log(np.diag(factor) * size).sum())

    @property
    def channels(self) -> NDArray[np.intp]:
        """Count the channels of each stream, in the order of STREAM_SLICES."""
        streams = [STREAM[one.channel] for one in self.parts]
        return np.bincount(streams, minlength=len(STREAM_SLICES))

    def streams(self) -> list[int]:
        """List the streams, by their place among scales, that there are."""
        return sorted({STREAM[one.channel] for one in self.parts})

    def likeliest(self) -> dict[int, Array]:
        """Return the features' weights at each channel's own likeliest size, shape (k,) each."""
        out = {}
        for one in self.parts:
            size, values, vectors, right = self._likeliest(one)
            if size:
                out[one.channel] = self.whitened.modes(one.channel).weights @ (
                    vectors @ (right / (values + size ** -2.0)))
        return out

    def likeliest_sizes(self) -> dict[int, float]:
        """Return the likeliest part of its signal that each channel's discrepancy has, 0: none."""
        return {one.channel: self._likeliest(one)[0] for one in self.parts}

    def _likeliest(self, one: ChannelSums) -> tuple[float, Array, Array, Array]:
        """Return a channel's likeliest size, and its information's spectrum and products."""
        values, vectors = np.linalg.eigh(self.whitened.modes(one.channel).all)
        values = np.maximum(values, 0.0)
        right = vectors.T @ one.all.cross[:, 0]
        gains = [0.5 * float(np.sum(right ** 2 / (values + s ** -2.0)
                                    - np.log1p(values * s ** 2))) for s in FREE[1:]]
        found = len(right) and max(gains) > 0.0
        return FREE[1 + int(np.argmax(gains))] if found else 0.0, values, vectors, right

    def weights(self, scales: Scales, trained: bool = True) -> dict[int, Array]:
        """
        Return the features' likeliest weights, shape (k,) each.

        Parameters
        ----------
        scales : tuple of float
            Of the discrepancy in each stream.
        trained : bool
            By the training blocks, or by all.
        """
        out = {}
        for one in self.parts:
            size = scales[STREAM[one.channel]]
            sums = one.trained if trained else one.all
            if size and len(sums.cross):
                factor = self.whitened.factor(one.channel, trained, size)
                out[one.channel] = self.whitened.modes(one.channel).weights @ cho_solve(
                    (factor, True), sums.cross[:, 0])
        return out


def ascended(products: Products, evidence: Callable[[tuple[Gram, Gram]], float], start: Scales
             ) -> Scales:
    """
    Improve the scales of a discrepancy, stream by stream.

    Parameters
    ----------
    evidence : callable
        Log-evidence of the Grams of training and other blocks.
    """
    best, most = start, evidence(products.at(start))
    for _ in range(ASCENTS):
        before = best
        for i in products.streams():
            for size in SCALES:
                tried = (*best[:i], size, *best[i + 1:])
                if size != best[i] and (value := evidence(products.at(tried))) > most:
                    best, most = tried, value
        if best == before:
            break
    return best
