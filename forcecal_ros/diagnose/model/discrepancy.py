"""
What no model has: a smooth function of the motion beside noise, integrated out.

[KennedyOHagan2001], [BrynjarsdottirOHagan2014]: every channel carries, besides noise and
nuisances, a combination of the basis' features, the same in all recordings, its weights normal
with a standard deviation that is a small part of the channel's signal. What of a hypothesis such
a function could do as well counts for little, and what it does beyond counts in full.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple
from weakref import ref

from forcecal_ros.diagnose.inputs.channels import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.basis import Basis
from forcecal_ros.diagnose.model.compact import Compact, stacked
from forcecal_ros.diagnose.model.evidence import Gram
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import Autoregression
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, LinAlgError, solve_triangular

Scales = tuple[float, ...]
"""Part of the signal that a discrepancy has in each stream, in the order of STREAM_SLICES."""

SCALES = (0.0, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3)
"""
Parts of its channels' signals that a discrepancy may have in a stream; the evidence says which.

Were 1 % allowed, many an effect would be no more than such a function; beside a larger background
effects are weighed by what they explain of the misfit, and leave.
"""

NO_DISCREPANCY: Scales = (0.0,) * len(STREAM_SLICES)
"""Scales that stand for no discrepancy in any stream."""

ASCENTS = 2
"""Rounds over the streams in which their scales are improved one by one."""

FREE = (*SCALES, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Scales of a discrepancy, channel by channel, where it is taken off to estimate the noise."""

LEAST_WEIGHT = 1e-3
"""Variance of a combination of features, in its noise's, below which it says nothing."""

MEMORY = 2e8
"""
Bytes that whitened features may take: of a pair of a minute each two hundred combinations are
kept, of ten minutes the forty strongest.
"""

STRETCH = 1024
"""Blocks of features that are multiplied at once: two hundred features fill a cache."""

SHARING = 16
"""Channels that share that memory: all but those of joints, whose features are the same."""

STREAM = tuple(i for i, name in enumerate(STREAM_SLICES) for c in CHANNELS if c.stream == name)
"""Place of each channel's stream among the scales."""

BoolArray = NDArray[np.bool_]


class _Modes(NamedTuple):
    """
    Whitened features of one channel, as few combinations as matter.

    ``rows``: of each recording, (r, n); ``weights``: features to combinations, (k, r);
    ``trained``, ``all``: inner products over training blocks and over all.
    """

    rows: list[Compact]
    weights: Array
    trained: Array
    all: Array


def _squares(features: Compact, train: BoolArray) -> Array:
    """Return inner products of features over training blocks, and over the others."""
    r = len(features.numbers)
    out = np.zeros((2, r, r))
    for part, rows in _stretches(train, slice(0, len(train))):
        # nearly orthogonal, so that single precision keeps even the faint ones
        values = features.values(rows)
        out[part] += values @ values.T
    return out


def _stretches(train: BoolArray, rows: slice) -> Iterator[tuple[int, slice]]:
    """Give short stretches of some blocks, each for training, 0, or for judging, 1."""
    changes = rows.start + 1 + np.flatnonzero(np.diff(train[rows]))
    edges = {*changes.tolist(), *range(rows.start, rows.stop, STRETCH), rows.stop}
    for begin, end in pairwise(sorted(edges)):
        yield int(not train[begin]), slice(begin, end)


def _factor(information: Array) -> Array:
    """Return a Cholesky factor; what rounding has made negative counts as nothing."""
    try:
        return np.asarray(cholesky(information, lower=True))
    except LinAlgError:
        values, vectors = np.linalg.eigh(information)
        least = np.finfo(np.float32).eps * values[-1]
        return np.asarray(cholesky((vectors * np.maximum(values, least)) @ vectors.T, lower=True))


class Discrepancy:
    """
    The discrepancy of recordings in blocks.

    Parameters
    ----------
    signal : ndarray, shape (channels,)
        Standard deviation of what each channel shows [channel's unit].
    train : sequence of ndarray of bool, shape (n,)
        Blocks to fit on, of each recording.
    """

    def __init__(self, of: Basis, signal: Array, train: Sequence[BoolArray]) -> None:
        self.basis, self.signal, self.train = of, signal, list(train)
        self._kept: WhitenedDiscrepancy | None = None

    def whitened(self, noise: Sequence[Autoregression]) -> 'WhitenedDiscrepancy':
        """Return it whitened by a noise: the last one, which takes much memory, is kept."""
        kept = self._kept
        if kept is None or any(a is not b for a, b in zip(kept.noise, noise, strict=True)):
            self._kept = kept = WhitenedDiscrepancy(
                self.basis, self.signal, self.train, list(noise),
                kept.known(noise) if kept else _Known({}, {}, {}))
        return kept


class _Cross(NamedTuple):
    """A column, and its products with combinations over training blocks and others, (2, r)."""

    column: 'ref[Compact]'
    products: NDArray[np.float32]


class _Known(NamedTuple):
    """
    What was found of each channel.

    Its combinations, factors of its information on them, and products with columns, by channel,
    recording and identity of the column.
    """

    modes: dict[int, _Modes]
    factors: dict[tuple[int, bool, float], Array]
    crosses: dict[tuple[int, int, int], _Cross]

    def of(self, channels: set[int]) -> '_Known':
        """Keep some channels."""
        return _Known({c: modes for c, modes in self.modes.items() if c in channels},
                      {key: f for key, f in self.factors.items() if key[0] in channels},
                      {key: one for key, one in self.crosses.items() if key[0] in channels})


class WhitenedDiscrepancy:
    """
    A discrepancy, whitened by a given noise.

    Parameters
    ----------
    signal : ndarray, shape (channels,)
    train : sequence of ndarray of bool, shape (n,)
    noise : list of Autoregression
        Of each recording.
    known : tuple
        What was found already, of channels whose noise is the same.
    """

    def __init__(self, of: Basis, signal: Array, train: Sequence[BoolArray],
                 noise: list[Autoregression], known: _Known) -> None:
        self.basis, self.signal, self.train, self.noise = of, signal, train, noise
        self.channels = [c for c in range(len(CHANNELS))
                         if any(n.sigma[:, c].any() for n in noise)]
        self._known = known

    def known(self, noise: Sequence[Autoregression]) -> _Known:
        """Return what was found of channels that another noise whitens alike."""
        return self._known.of({c for c in self.channels if all(
            a.same(b, c) for a, b in zip(self.noise, noise, strict=True))})

    def modes(self, c: int) -> _Modes:
        """Return a channel's whitened features, which are found at the first time they count."""
        if c not in self._known.modes:
            self._known.modes[c] = self._modes(c)
        return self._known.modes[c]

    def _modes(self, c: int) -> _Modes:
        scale = np.sqrt(self.basis.variance) * self.signal[c]
        white = [n.whiten_singly(rows.numbers, c, scale * rows.unit[:, 0])
                 if n.sigma[:, c].any() else np.zeros(rows.numbers.shape, dtype=np.float32)
                 for n, rows in zip(self.noise, self.basis.rows)]
        values, vectors = np.linalg.eigh(sum((w @ w.T).astype(float) for w in white))
        most = int(MEMORY / (2 * SHARING * sum(w.shape[1] for w in white)))
        kept = np.flatnonzero(values * max(FREE) ** 2 > LEAST_WEIGHT)[-most:]
        turn = vectors[:, kept]
        rows = [Compact.of(turn.T.astype(np.float32) @ w) for w in white]
        trained, held = np.sum([_squares(r, t) for r, t in zip(rows, self.train)], axis=0)
        return _Modes(rows, scale[:, np.newaxis] * turn, trained, trained + held)

    def factor(self, c: int, trained: bool, size: float) -> Array:
        """Return the Cholesky factor of a channel's information on its combinations."""
        key = c, trained, size
        factors = self._known.factors
        if key not in factors:
            modes = self.modes(c)
            information = modes.trained if trained else modes.all
            factors[key] = _factor(information + np.eye(len(information)) / size ** 2)
        return factors[key]

    def predicted(self, residual: Sequence[Array]) -> list[Array]:
        """
        Return what the features predict of a residual, in each channel as much as is likeliest.

        Parameters
        ----------
        residual : sequence of ndarray, shape (n, channels)

        Returns
        -------
        list of ndarray, shape (n, channels)
        """
        products = self.products([[] for _ in residual], residual)
        weights = products.likeliest()
        return self.of_weights(weights, [r.shape for r in residual])

    def of_weights(self, weights: Mapping[int, Array], shapes: Sequence[tuple[int, ...]]
                   ) -> list[Array]:
        """Sum the features of each recording with the weights of each channel."""
        out, channels = [np.zeros(shape) for shape in shapes], list(weights)
        if channels:
            together = np.stack(list(weights.values()))
            for one, rows, noise in zip(out, self.basis.rows, self.noise):
                one[:, channels] = np.where(noise.present[:, channels],
                                            rows.combined(together).T, 0.0)
        return out

    def products(self, columns: Sequence[Sequence[Column]], residual: Sequence[Array],
                 absent: bool = False) -> 'Products':
        """
        Return inner products of whitened columns, residual and discrepancy.

        Parameters
        ----------
        columns : sequence of sequence of Column
            Of each recording, as many in each.
        residual : sequence of ndarray, shape (n, channels)
        absent : bool
            Whether they are wanted for a size of 0 only.
        """
        k = len(columns[0])
        out = []
        for c in self.channels:
            there = [j for j in range(k) if any(c in one[j] for one in columns)]
            total = [_Sums.empty(len(there), 0 if absent else len(self.modes(c).trained))
                     for _ in range(2)]
            for i, (one, r, noise) in enumerate(zip(columns, residual, self.noise)):
                if noise.sigma[:, c].any():
                    given = [one[j].get(c) for j in there]
                    found = self._sums(c, i, r[:, c], given, absent)
                    total = [one.plus(more) for one, more in zip(total, found)]
            out.append(_Channel(c, np.array(there, dtype=np.intp), total[0],
                                total[0].plus(total[1])))
        return Products(self, k, out)

    def _sums(self, c: int, recording: int, residual: Array, given: Sequence[Compact | None],
              absent: bool) -> tuple['_Sums', '_Sums']:
        """
        Return inner products in one channel of one recording, over training blocks and the others.

        Columns are the same from one hypothesis to the next: only new ones, and the residual, are
        multiplied with the combinations.
        """
        known = {} if absent else self._known.crosses
        keys = [(c, recording, id(one)) for one in given]
        new = {j: one for j, one in enumerate(given) if one is not None and not (
            keys[j] in known and known[keys[j]].column() is one)}
        own, found = self._multiplied(c, recording, residual, given, list(new), absent)
        known.update({keys[j]: _Cross(ref(one), found[:, :, 1 + i].astype(np.float32))
                      for i, (j, one) in enumerate(new.items())})
        cross = np.zeros((*found.shape[:2], 1 + len(given)))
        cross[:, :, 0] = found[:, :, 0]
        for j, one in enumerate(given):
            if one is not None:
                cross[:, :, 1 + j] = known[keys[j]].products
        trained, held = (int(np.sum(part & self.noise[recording].rows[:, c]))
                         for part in (self.train[recording], ~self.train[recording]))
        return _Sums(own[0], cross[0], trained), _Sums(own[1], cross[1], held)

    def _multiplied(self, c: int, recording: int, residual: Array,
                    given: Sequence[Compact | None], new: Sequence[int], absent: bool
                    ) -> tuple[Array, Array]:
        """
        Multiply residual and columns with each other, and with the combinations.

        Returns
        -------
        own : ndarray, shape (2, k + 1, k + 1)
            Over training blocks, and over the others.
        cross : ndarray, shape (2, r, 1 + new)
            Of the residual and of new columns.
        """
        features = None if absent else self.modes(c).rows[recording]
        chosen = [0, *(1 + j for j in new)]
        own = np.zeros((2, 1 + len(given), 1 + len(given)))
        cross = np.zeros((2, len(features.numbers) if features else 0, len(chosen)))
        for rows, white in self.noise[recording].whiten_in_pieces(stacked(residual, given), c):
            single = white[chosen].astype(np.float32)
            for part, stretch in _stretches(self.train[recording], rows):
                here = slice(stretch.start - rows.start, stretch.stop - rows.start)
                own[part] += white[:, here] @ white[:, here].T
                if features:
                    cross[part] += (features.numbers[:, stretch].astype(np.float32)
                                    @ single[:, here].T)
        return own, cross * features.unit if features else cross


class _Sums(NamedTuple):
    """Inner products of (residual, columns) with themselves and with the combinations."""

    own: Array
    cross: Array
    n: int

    @classmethod
    def empty(cls, k: int, r: int) -> '_Sums':
        return cls(np.zeros((k + 1, k + 1)), np.zeros((r, k + 1)), 0)

    def plus(self, other: '_Sums') -> '_Sums':
        """Add those of other samples."""
        return _Sums(self.own + other.own, self.cross + other.cross, self.n + other.n)


class _Channel(NamedTuple):
    """One channel's sums over the training blocks and over all; which columns it has."""

    channel: int
    there: NDArray[np.intp]
    trained: _Sums
    all: _Sums


class Products:
    """
    Inner products from which Gram matrices follow for any size of the discrepancy.

    Parameters
    ----------
    k : int
        Columns.
    """

    def __init__(self, whitened: WhitenedDiscrepancy, k: int, channels: list[_Channel]) -> None:
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

    def _part(self, one: _Channel, trained: bool, size: float) -> tuple[Array, float]:
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

    def unexplained(self, x: Array, scales: Scales) -> tuple[Array, Array]:
        """
        Return what columns leave unexplained in each stream, in the order of STREAM_SLICES.

        Parameters
        ----------
        x : ndarray, shape (k,)
            Of the columns.

        Returns
        -------
        cost : ndarray, shape (streams,)
            Negative log-likelihood of all samples, less that of pure noise's constant.
        n : ndarray, shape (streams,)
            Samples.
        """
        cost, n = np.zeros((2, len(STREAM_SLICES)))
        for one in self.parts:
            stream = STREAM[one.channel]
            own, log_det = self._part(one, False, scales[stream])
            left = np.append(1.0, -x[one.there])
            cost[stream] += 0.5 * (float(left @ own @ left) + log_det)
            n[stream] += one.all.n
        return cost, n

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

    def _likeliest(self, one: _Channel) -> tuple[float, Array, Array, Array]:
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
