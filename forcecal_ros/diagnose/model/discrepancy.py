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
from weakref import ref

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import Autoregression, pieces
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.evidence import Gram
from forcecal_ros.diagnose.model.jacobian import Column, Compact, stacked
from forcecal_ros.sim.signals import BLOCK, block_means, RATE, Signals
import numpy as np
from numpy.typing import NDArray

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

WEIGHED_AT_ONCE = 10 ** 6
"""Samples of all signals that are multiplied by features together, so that they take 8 MB."""

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
        self._last: WhitenedDiscrepancy | None = None

    def whitened(self, noise: Sequence[Autoregression]) -> 'WhitenedDiscrepancy':
        """Return it whitened by a noise: the last one, which takes time, is kept."""
        last = self._last
        if last is None or any(a is not b for a, b in zip(last.noise, noise, strict=True)):
            self._last = last = WhitenedDiscrepancy(self, list(noise), last)
        return last


class Modes(NamedTuple):
    """
    Combinations of a channel's features that data tell apart.

    ``weights``: features to combinations, (k, k); ``information``: on each of these, (k,).
    """

    weights: Array
    information: Array

    def precision(self, size: float) -> Array:
        """Return it for each combination, a prior of that size included, shape (k,)."""
        return np.asarray(self.information + 1.0 / size ** 2)


class _Kept:
    """
    Inner products in one channel of one recording: of a residual, and of columns.

    Those of columns hold as long as these are in use; NaN where nothing has asked for them.

    Attributes
    ----------
    own : ndarray, shape (1 + k, 1 + k)
        With each other, the residual first.
    cross : ndarray, shape (features, 1 + k)
        With the features.
    """

    def __init__(self, features: int) -> None:
        self._columns: list[ref[Compact]] = []
        self.own, self.cross = np.zeros((1, 1)), np.zeros((features, 1))

    def places(self, asked: Sequence[Compact]) -> NDArray[np.intp]:
        """Return where columns are; new ones come last, and those out of use leave."""
        there = [i for i, one in enumerate(self._columns) if one() is not None]
        known = {id(self._columns[i]()): 1 + place for place, i in enumerate(there)}
        new = list({id(one): one for one in asked if id(one) not in known}.values())
        known |= {id(one): 1 + len(there) + j for j, one in enumerate(new)}
        if new or len(there) < len(self._columns):
            self._columns = [*(self._columns[i] for i in there), *map(ref, new)]
            left, more = [0, *(1 + i for i in there)], (0, len(new))
            self.own = np.pad(self.own[np.ix_(left, left)], (more, more), constant_values=np.nan)
            self.cross = np.pad(self.cross[:, left], ((0, 0), more), constant_values=np.nan)
        return np.array([known[id(one)] for one in asked], dtype=np.intp)

    def column(self, place: int) -> Compact:
        """Return the column at a place."""
        found = self._columns[place - 1]()
        assert found is not None
        return found

    def unknown(self, places: NDArray[np.intp], absent: bool) -> list[int]:
        """Return at which places signals are to be multiplied, so that all products are known."""
        missing = np.isnan(self.own[np.ix_(places, places)])
        new = np.diag(missing).copy()
        if not absent:
            new |= np.isnan(self.cross[:, places]).any(axis=0)
        new |= places == 0  # another residual
        missing &= ~(new | new[:, np.newaxis])
        while missing.any():
            most = int(missing.sum(axis=0).argmax())
            new[most] = True
            missing[most] = missing[:, most] = False
        return [int(i) for i in places[new]]


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
        self.features: dict[int, Array] = {}
        self.found: dict[tuple[int, bool], Modes] = {}
        self.kept: dict[tuple[int, bool, int], _Kept] = {}
        if before is not None:
            same = {c for c in before.channels if all(
                a.same(b, c) for a, b in zip(before.noise, noise, strict=True))}
            self.features = {c: one for c, one in before.features.items() if c in same}
            self.found = {key: one for key, one in before.found.items() if key[0] in same}
            self.kept = {key: one for key, one in before.kept.items() if key[0] in same}

    def modes(self, c: int, training: bool) -> Modes:
        """Return those of a channel, by all or training blocks, found when they first count."""
        key = c, training
        if key not in self.found:
            if c not in self.features:
                self.features[c] = self._of_features(c)
            scale = np.sqrt(self.basis.variance) * self.signal[c]
            values, vectors = np.linalg.eigh(
                self.features[c][int(training)] * np.outer(scale, scale))
            self.found[key] = Modes(scale[:, np.newaxis] * vectors, np.maximum(values, 0.0))
        return self.found[key]

    def _of_features(self, c: int) -> Array:
        """Return inner products of a channel's features, over all and over training blocks."""
        out = np.zeros((2, len(self.basis.variance), len(self.basis.variance)))
        for noise, rows, train in zip(self.noise, self.basis.rows, self.train):
            for part, white in noise.whiten_in_pieces(rows.values, c):
                square, some = white @ white.T, white[:, train[part]]
                out += [square, square if train[part].all() else some @ some.T]
        return out

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
        held_out = [rows.values()[:, ~train] for rows, train in zip(self.basis.rows, self.train)]
        gram = sum(r @ r.T for r in held_out) / max(1, sum(r.shape[1] for r in held_out))
        for c, size in sizes.items():
            if size:
                modes = self.modes(c, True)
                out[c] = np.sum(modes.weights * (gram @ modes.weights) / modes.precision(size))
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
        there = {c: [j for j in range(len(columns[0])) if any(c in one[j] for one in columns)]
                 for c in self.channels}
        features = 0 if absent else len(self.basis.variance)
        sums = {c: ChannelSums(c, np.array(js, dtype=np.intp), np.zeros((1 + len(js),) * 2),
                               np.zeros((features, 1 + len(js))), 0) for c, js in there.items()}
        for i, (one, r, noise) in enumerate(zip(columns, residual, self.noise)):
            asked = {c: [one[j][c] for j in there[c] if c in one[j]] for c in self.channels
                     if noise.sigma[:, c].any()}
            blocks = self._blocks(i, training)
            for c, (kept, places) in self._multiplied(i, asked, r, absent, training).items():
                rows = [0, *(1 + n for n, j in enumerate(there[c]) if c in one[j])]
                sums[c].own[np.ix_(rows, rows)] += kept.own[np.ix_(places, places)]
                if not absent:
                    sums[c].cross[:, rows] += kept.cross[:, places]
                sums[c] = sums[c]._replace(n=sums[c].n + int(np.sum(blocks & noise.rows[:, c])))
        if not absent:
            sums = {c: one._replace(cross=self.modes(c, training).weights.T @ one.cross)
                    for c, one in sums.items()}
        return Products(self, len(columns[0]), list(sums.values()), training)

    def _blocks(self, recording: int, training: bool) -> BoolArray:
        return self.train[recording] if training else np.ones_like(self.train[recording])

    def _multiplied(self, recording: int, asked: Mapping[int, Sequence[Compact]],
                    residual: Array, absent: bool, training: bool
                    ) -> dict[int, tuple[_Kept, NDArray[np.intp]]]:
        """Return each channel's inner products, and where those of residual and columns are."""
        blocks = self._blocks(recording, training)
        out, distinct, wanted = {}, {}, []
        for c, columns in asked.items():
            kept = self.kept.setdefault((c, training, recording), _Kept(len(self.basis.variance)))
            places = np.append(0, kept.places(columns))
            # an effect in all recordings and in this one alone has one column here
            out[c], distinct[c] = (kept, places), np.unique(places)
            wanted += [(c, i) for i in kept.unknown(distinct[c], absent)]
        at_once = max(1, WEIGHED_AT_ONCE // len(residual))
        for some in (wanted[i:i + at_once] for i in range(0, len(wanted), at_once)):
            weighed = np.empty((len(some), len(residual)))
            for row, (c, i) in zip(weighed, some):
                signal = out[c][0].column(i).values() if i else residual[:, c]
                row[:] = self.noise[recording].weigh(signal, c, blocks)
            if not absent:
                features = _product(self.basis.rows[recording].values, weighed)
            for c in dict(some):
                kept, here = out[c][0], np.array([c == one for one, _ in some])
                new = np.array([i for one, i in some if one == c])
                others = [kept.column(i) for i in distinct[c][1:]]
                products = _product(stacked(residual[:, c], others), weighed[here])
                kept.own[np.ix_(distinct[c], new)] = products
                kept.own[np.ix_(new, distinct[c])] = products.T
                if not absent:
                    kept.cross[:, new] = features[:, here]
        return out


def _product(rows: Callable[[slice], Array | NDArray[np.float32]], others: Array) -> Array:
    """Return inner products of signals, shape (k, n) piece by piece, with others, (m, n)."""
    return np.asarray(sum(rows(part) @ others[:, part].T for part in pieces(others.shape[1])))


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
        root = np.sqrt(self.whitened.modes(one.channel, self._training).precision(size))
        taken = one.cross / root[:, np.newaxis]
        return one.own - taken.T @ taken, 2.0 * float(np.log(root * size).sum())

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
                modes = self.whitened.modes(one.channel, self._training)
                out[one.channel] = modes.weights @ (one.cross[:, 0] / modes.precision(size))
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
                    modes = self.whitened.modes(one.channel, self._training)
                    cross = cross / (known ** 2 * modes.precision(known))[:, np.newaxis]
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
