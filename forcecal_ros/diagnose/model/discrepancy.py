"""
What no model has: a smooth function of the motion beside noise, integrated out.

[KennedyOHagan2001], [BrynjarsdottirOHagan2014]: every channel carries, in addition to noise and
nuisances, a combination of the basis' features, the same in all recordings, its weights normal
with a standard deviation that is a small part of the channel's signal. What of a hypothesis such
a function could do as well counts for little, and what it does beyond counts in full.

A fit allows for a small discrepancy, the same part of the signal in all channels of a stream, so
that an effect does not count for nothing. What is there may be larger, and may have the effect's
own shape: then part of it goes into the effect's numbers (:meth:`Products.spread`), and out of
what is left.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, combinations_with_replacement, product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import Autoregression, pieces
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.evidence import Gram
from forcecal_ros.diagnose.model.jacobian import Column, Compact, stacked
from forcecal_ros.sim.signals import BLOCK, block_means, RATE, Signals
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, LinAlgError, solve_triangular

Scales = tuple[float, ...]
"""Part of the signal that a discrepancy has in each stream, in the order of STREAM_SLICES."""

SCALES = (0.0, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3)
"""
Parts of its channels' signals that a discrepancy may have in a stream; the evidence decides which.

Were 1 % allowed, many an effect would be no more than such a function; beside a larger background
effects are weighed by what they explain of the misfit, and leave.
"""

NO_DISCREPANCY: Scales = (0.0,) * len(STREAM_SLICES)
"""Scales that represent no discrepancy in any stream."""

NOISE_SCALES = (*SCALES, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Scales of a discrepancy, channel by channel, where it is removed to estimate the noise."""

STREAM = tuple(i for i, name in enumerate(STREAM_SLICES) for c in CHANNELS if c.stream == name)
"""Place of each channel's stream among the scales."""

FEATURE_SAMPLES = 6.25e6
"""
Numbers that the whitened features of a channel may take, of two bytes each, so that 16 channels
need 200 MB (joints share theirs): of a pair of a minute each two hundred combinations are kept,
of ten minutes the forty strongest.
"""

BoolArray = NDArray[np.bool_]


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
           np.linalg.norm(wrench[:3], axis=0), np.linalg.norm(wrench[3:], axis=0)]
    yield [*contact, *np.sqrt(np.abs(contact)), *contact ** 2,
           (np.abs(contact).max(axis=0) > 0.0).astype(float)]
    yield list(changing)
    yield list(np.gradient(changing, BLOCK, axis=1))
    # what a sensor or mount remembers of its load for so long [s]: foam, glue, thermal
    yield [_remembered(row, t) for t in (0.1, 0.5, 2.0) for row in loads]
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
    # half periods of a minute's drift down to five seconds
    return ([np.cos(np.pi * k * t / (n * BLOCK)) for k in range(13)],
            [wave(rate * (start + t)) for rate in turns for wave in (np.sin, np.cos)])


def _means(values: Array) -> Array:
    """Return block means, channels first."""
    return block_means(values).T


def _products(rows: Array) -> list[Array]:
    return [rows[i] * rows[j] for i, j in combinations_with_replacement(range(len(rows)), 2)]


def _bumps(position: Array) -> list[Array]:
    out, n = [], 7  # a fifth of a robot's cell between two of them
    for row in position:
        low, high = float(row.min()), float(row.max())
        width = (high - low) / (n - 1) if high > low else 1.0
        out += [np.exp(-0.5 * ((row - c) / width) ** 2) for c in np.linspace(low, high, n)]
    return out


def _turning_over(rates: Array) -> list[Array]:
    rms = np.sqrt(np.mean(rates ** 2, axis=1, keepdims=True))
    # friction turns over at a twentieth of the usual speed
    return list(np.tanh(rates / np.where(rms > 0.0, 0.05 * rms, 1.0)))


def _remembered(row: Array, memory: float) -> Array:
    """Return a signal behind a first-order lag, in equilibrium at the beginning."""
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    a = float(np.exp(-BLOCK / memory))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], row, zi=[a * row[0]])[0])


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
            self._kept = kept = WhitenedDiscrepancy(self, list(noise), kept)
        return kept


class Modes(NamedTuple):
    """
    Whitened features of one channel, as few combinations as matter.

    ``rows``: of each recording, (r, n); ``weights``: features to combinations, (k, r).
    """

    rows: list[Compact]
    weights: Array


class WhitenedDiscrepancy:
    """
    A discrepancy, whitened by a given noise.

    Parameters
    ----------
    noise : list of Autoregression
        Of each recording.
    before : WhitenedDiscrepancy, optional
        By another noise: what it found of channels whose noise is the same holds.
    """

    def __init__(self, of: Discrepancy, noise: list[Autoregression],
                 before: 'WhitenedDiscrepancy | None') -> None:
        self.basis, self.signal, self.train, self.noise = of.basis, of.signal, of.train, noise
        self.channels = [c for c in range(len(CHANNELS))
                         if any(n.sigma[:, c].any() for n in noise)]
        self.found: dict[int, Modes] = {}
        self.factors: dict[tuple[int, bool, float], Array] = {}
        if before is not None:
            same = {c for c in before.channels if all(
                a.same(b, c) for a, b in zip(before.noise, noise, strict=True))}
            self.found = {c: modes for c, modes in before.found.items() if c in same}
            self.factors = {key: one for key, one in before.factors.items() if key[0] in same}

    def modes(self, c: int) -> Modes:
        """Return a channel's whitened features, which are found at the first time they count."""
        if c not in self.found:
            self.found[c] = self._strongest(c)
        return self.found[c]

    def _strongest(self, c: int) -> Modes:
        scale = np.sqrt(self.basis.variance) * self.signal[c]
        white = [n.whiten_singly(rows.numbers, c, scale * rows.unit[:, 0])
                 if n.sigma[:, c].any() else np.zeros(rows.numbers.shape, dtype=np.float32)
                 for n, rows in zip(self.noise, self.basis.rows)]
        values, vectors = np.linalg.eigh(sum((w @ w.T).astype(float) for w in white))
        most = int(FEATURE_SAMPLES / sum(w.shape[1] for w in white))
        # one whose variance is below a thousandth of its noise's shows nothing
        kept = np.flatnonzero(values * max(NOISE_SCALES) ** 2 > 1e-3)[-most:]
        turn = vectors[:, kept]
        return Modes([Compact.of(turn.T.astype(np.float32) @ w) for w in white],
                     scale[:, np.newaxis] * turn)

    def factor(self, c: int, size: float, training: bool) -> Array:
        """Return the Cholesky factor of a channel's information on its combinations."""
        key, factors = (c, training, size), self.factors
        if key not in factors:
            if (flat := (c, training, np.inf)) not in factors:
                factors[flat] = np.sum([
                    _square(rows, train if training else np.ones_like(train))
                    for rows, train in zip(self.modes(c).rows, self.train)], axis=0)
            information = factors[flat]
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
        return self.of_weights(products.weights(products.likeliest_sizes()))

    def of_weights(self, weights: Mapping[int, Array]) -> list[Array]:
        """Sum the features of each recording with the weights of each channel."""
        out, channels = [np.zeros(n.present.shape) for n in self.noise], list(weights)
        if channels:
            together = np.stack(list(weights.values()))
            for one, rows, noise in zip(out, self.basis.rows, self.noise):
                one[:, channels] = np.where(noise.present[:, channels],
                                            rows.combined(together).T, 0.0)
        return out

    def unseen(self, sizes: Mapping[int, float]) -> Array:
        """
        Return by how much a discrepancy may differ from what training blocks say of it.

        Parameters
        ----------
        sizes : mapping of int to float
            Part of its signal that each channel has.

        Returns
        -------
        ndarray, shape (channels,)
            Mean square over the held-out blocks.
        """
        out = np.zeros(len(CHANNELS))
        gram = np.sum([_square(rows, ~train) for rows, train in zip(
            self.basis.rows, self.train)], axis=0) / max(
                1, sum(int((~train).sum()) for train in self.train))
        for c, size in sizes.items():
            if size:
                weights = self.modes(c).weights
                out[c] = np.trace(cho_solve((self.factor(c, size, True), True),
                                            weights.T @ gram @ weights))
        return out

    def products(self, columns: Sequence[Sequence[Column]], residual: Sequence[Array],
                 absent: bool = False, training: bool = False) -> 'Products':
        """
        Return inner products of whitened columns, residual and discrepancy.

        Parameters
        ----------
        columns : sequence of sequence of Column
            Of each recording, as many in each.
        residual : sequence of ndarray, shape (n, channels)
        absent : bool
            Whether they are needed for a size of 0 only.
        training : bool
            Over the training blocks; else over all.
        """
        k, out = len(columns[0]), []
        for c in self.channels:
            there = [j for j in range(k) if any(c in one[j] for one in columns)]
            total = ChannelSums(c, np.array(there, dtype=np.intp),
                                np.zeros((1 + len(there),) * 2), np.zeros(
                (0 if absent else self.modes(c).weights.shape[1], 1 + len(there))), 0)
            for i, (one, r, noise) in enumerate(zip(columns, residual, self.noise)):
                if noise.sigma[:, c].any():
                    rows = self.train[i] if training else np.ones_like(self.train[i])
                    own, cross = self._sums(c, i, r[:, c], [one[j].get(c) for j in there], absent,
                                            rows)
                    total = total._replace(own=total.own + own, cross=total.cross + cross,
                                           n=total.n + int(np.sum(rows & noise.rows[:, c])))
            out.append(total)
        return Products(self, k, out, training)

    def _sums(self, c: int, recording: int, residual: Array, given: Sequence[Compact | None],
              absent: bool, rows: BoolArray) -> tuple[Array, Array]:
        """
        Return inner products in one channel of one recording, over some blocks.

        Returns
        -------
        own : ndarray, shape (1 + k, 1 + k)
            Of the residual and of columns with each other.
        cross : ndarray, shape (r, 1 + k)
            Of the combinations with them.
        """
        # an effect in all recordings and in this one alone has one column here
        there = {id(one): one for one in given if one is not None}
        features = None if absent else self.modes(c).rows[recording]
        own = np.zeros((1 + len(there),) * 2)
        cross = np.zeros((len(features.numbers) if features else 0, len(own)))
        for part, white in self.noise[recording].whiten_in_pieces(
                stacked(residual, list(there.values())), c):
            kept = rows[part]
            white = white if kept.all() else white * kept
            own += white @ white.T
            if features:
                cross += features.numbers[:, part].astype(np.float32) @ white.astype(np.float32).T
        if features:
            cross *= features.unit
        places = {key: 1 + j for j, key in enumerate(there)}
        place = np.array([0, *(places.get(id(one), -1) for one in given)])
        return (np.where((place < 0) | (place < 0)[:, np.newaxis], 0.0,
                         own[np.ix_(place, place)]), np.where(place < 0, 0.0, cross[:, place]))


def _square(features: Compact, blocks: BoolArray) -> Array:
    """Return inner products of features over some blocks, shape (k, k)."""
    out = np.zeros((len(features.numbers),) * 2)
    for part in pieces(len(blocks)):
        # nearly orthogonal, so that single precision keeps even the faint ones
        rows = features.values(part)[:, blocks[part]]
        out += rows @ rows.T
    return out


class ChannelSums(NamedTuple):
    """
    One channel's inner products, and which columns it has.

    ``own``: of residual and columns with themselves; ``cross``: with the combinations; ``n``:
    samples.
    """

    channel: int
    there: NDArray[np.intp]
    own: Array
    cross: Array
    n: int


class Products:
    """
    Inner products from which Gram matrices follow for any size of the discrepancy.

    Parameters
    ----------
    k : int
        Columns.
    training : bool
        They are those of the training blocks.
    """

    def __init__(self, whitened: WhitenedDiscrepancy, k: int, parts: list[ChannelSums],
                 training: bool) -> None:
        self.whitened, self.k, self.parts, self._training = whitened, k, parts, training
        self._streams: dict[tuple[int, float], Gram] = {}

    def at(self, scales: Scales) -> Gram:
        """
        Integrate the discrepancy out.

        Parameters
        ----------
        scales : tuple of float
            Part of the signals in each stream; 0: there is none.
        """
        total = Gram(np.zeros((self.k, self.k)), np.zeros(self.k), 0.0, 0)
        for stream in self.streams():
            total += self._of_stream(stream, scales[stream])
        return total

    def _of_stream(self, stream: int, size: float) -> Gram:
        """Return one stream's Gram; a search for the best sizes changes one after the other."""
        key, k = (stream, size), self.k
        if key not in self._streams:
            matrix, vector, square, n, log_det = np.zeros((k, k)), np.zeros(k), 0.0, 0, 0.0
            for one in (one for one in self.parts if STREAM[one.channel] == stream):
                own, more = self._part(one, size)
                matrix[np.ix_(one.there, one.there)] += own[1:, 1:]
                vector[one.there] += own[1:, 0]
                square += float(own[0, 0])
                n += one.n
                log_det += more
            self._streams[key] = Gram(matrix, vector, square, n, log_det)
        return self._streams[key]

    def _part(self, one: ChannelSums, size: float) -> tuple[Array, float]:
        """Return one channel's products beside a discrepancy, and its logarithm."""
        if size == 0.0 or not len(one.cross):
            return one.own, 0.0
        factor = self.whitened.factor(one.channel, size, self._training)
        taken = solve_triangular(factor, one.cross, lower=True, check_finite=False)
        return one.own - taken.T @ taken, 2.0 * float(np.log(np.diag(factor) * size).sum())

    def streams(self) -> list[int]:
        """List the streams, by their place among scales, that there are."""
        return sorted({STREAM[one.channel] for one in self.parts})

    def likeliest_sizes(self) -> dict[int, float]:
        """Return the likeliest part of its signal that each channel's discrepancy has, 0: none."""
        out = {}
        for one in self.parts:
            alone = one._replace(own=one.own[:1, :1], cross=one.cross[:, :1])
            lost = [float(own[0, 0]) + more
                    for own, more in (self._part(alone, size) for size in NOISE_SCALES)]
            out[one.channel] = NOISE_SCALES[int(np.argmin(lost))]
        return out

    def weights(self, sizes: Mapping[int, float]) -> dict[int, Array]:
        """
        Return the features' likeliest weights, shape (k,) each.

        Parameters
        ----------
        sizes : mapping of int to float
            Part of its signal that each channel has.
        """
        out = {}
        for one in self.parts:
            size = sizes.get(one.channel, 0.0)
            if size and len(one.cross):
                factor = self.whitened.factor(one.channel, size, self._training)
                out[one.channel] = self.whitened.modes(one.channel).weights @ cho_solve(
                    (factor, True), one.cross[:, 0])
        return out

    def spread(self, assumed: Scales, sizes: Mapping[int, float]) -> Array:
        """
        Return how products of columns and residual vary by a larger discrepancy than assumed.

        Parameters
        ----------
        assumed : tuple of float
            Part of the signals in each stream that the fit allowed for.
        sizes : mapping of int to float
            Part of its signal that each channel has.

        Returns
        -------
        ndarray, shape (k, k)
            Covariance beyond what that fit knows of; 0 where no channel has more.
        """
        out = np.zeros((self.k, self.k))
        for one in self.parts:
            size, known = sizes.get(one.channel, 0.0), assumed[STREAM[one.channel]]
            if size > known:
                cross = one.cross[:, 1:]
                if known:
                    factor = self.whitened.factor(one.channel, known, self._training)
                    cross = cho_solve((factor, True), cross) / known ** 2
                out[np.ix_(one.there, one.there)] += (size ** 2 - known ** 2) * cross.T @ cross
        return out

    def improve(self, evidence: Callable[[Gram], float], start: Scales) -> Scales:
        """Improve the scales of a discrepancy by log-evidence, stream by stream."""
        best, most, known = start, evidence(self.at(start)), {start}
        before: Scales = ()
        while best != before:
            before = best
            for i, size in product(self.streams(), SCALES):
                tried = (*best[:i], size, *best[i + 1:])
                if tried not in known and (value := evidence(self.at(tried))) > most:
                    best, most = tried, value
                known.add(tried)
        return best
