"""
What no model has: a smooth function of the motion beside noise, integrated out.

[KennedyOHagan2001], [BrynjarsdottirOHagan2014]: every channel carries, in addition to noise and
nuisances, a combination of the basis' features, the same in all recordings, its weights normal
with a standard deviation that is a small part of the channel's signal. What of a hypothesis such
a function could do as well counts for little, and what it does beyond counts in full.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple
from weakref import ref

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import Autoregression
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.basis import Basis
from forcecal_ros.diagnose.model.compact import Compact, stacked
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.diagnose.model.products import ChannelSums, Modes, Products, Sums
from forcecal_ros.diagnose.model.scales import FREE
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, LinAlgError

LEAST_WEIGHT = 1e-3
"""Variance of a combination of features, in its noise's, below which it shows nothing."""

MEMORY = 2e8
"""
Bytes that whitened features may take: of a pair of a minute each two hundred combinations are
kept, of ten minutes the forty strongest.
"""

STRETCH = 1024
"""Blocks of features that are multiplied at once: two hundred features fill a cache."""

SHARING = 16
"""Channels that share that memory: all but those of joints, whose features are the same."""

BoolArray = NDArray[np.bool_]


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

    modes: dict[int, Modes]
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

    def modes(self, c: int) -> Modes:
        """Return a channel's whitened features, which are found at the first time they count."""
        if c not in self._known.modes:
            self._known.modes[c] = self._modes(c)
        return self._known.modes[c]

    def _modes(self, c: int) -> Modes:
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
        return Modes(rows, scale[:, np.newaxis] * turn, trained, trained + held)

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
                 absent: bool = False) -> Products:
        """
        Return inner products of whitened columns, residual and discrepancy.

        Parameters
        ----------
        columns : sequence of sequence of Column
            Of each recording, as many in each.
        residual : sequence of ndarray, shape (n, channels)
        absent : bool
            Whether they are needed for a size of 0 only.
        """
        k = len(columns[0])
        out = []
        for c in self.channels:
            there = [j for j in range(k) if any(c in one[j] for one in columns)]
            total = [Sums.empty(len(there), 0 if absent else len(self.modes(c).trained))
                     for _ in range(2)]
            for i, (one, r, noise) in enumerate(zip(columns, residual, self.noise)):
                if noise.sigma[:, c].any():
                    given = [one[j].get(c) for j in there]
                    found = self._sums(c, i, r[:, c], given, absent)
                    total = [one.plus(more) for one, more in zip(total, found)]
            out.append(ChannelSums(c, np.array(there, dtype=np.intp), total[0],
                                total[0].plus(total[1])))
        return Products(self, k, out)

    def _sums(self, c: int, recording: int, residual: Array, given: Sequence[Compact | None],
              absent: bool) -> tuple[Sums, Sums]:
        """
        Return inner products in one channel of one recording, over training blocks and the others.

        Columns are the same from one hypothesis to the next: only new ones, and the residual, are
        multiplied with the combinations.
        """
        known = {} if absent else self._known.crosses
        # an effect in all recordings and in this one alone has one column here
        there = {id(one): one for one in given if one is not None}
        some, keys = list(there.values()), [(c, recording, key) for key in there]
        new = {j: one for j, one in enumerate(some) if not (
            keys[j] in known and known[keys[j]].column() is one)}
        own, found = self._multiplied(c, recording, residual, some, list(new), absent)
        known.update({keys[j]: _Cross(ref(one), found[:, :, 1 + i].astype(np.float32))
                      for i, (j, one) in enumerate(new.items())})
        cross = np.stack([found[:, :, 0], *(known[key].products for key in keys)], axis=2)
        places = {key: 1 + j for j, key in enumerate(there)}
        full = np.array([0, *(1 + j for j, one in enumerate(given) if one is not None)])
        place = np.array([0, *(places[id(one)] for one in given if one is not None)])
        out = []
        for i, part in enumerate((self.train[recording], ~self.train[recording])):
            sums = Sums.empty(len(given), cross.shape[1])
            sums.own[np.ix_(full, full)] = own[i][np.ix_(place, place)]
            sums.cross[:, full] = cross[i][:, place]
            out.append(sums._replace(n=int(np.sum(part & self.noise[recording].rows[:, c]))))
        return out[0], out[1]

    def _multiplied(self, c: int, recording: int, residual: Array,
                    given: Sequence[Compact], new: Sequence[int], absent: bool
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
