"""Effects that begin or end during a recording: which, and at which instant."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.evidence import Prior
from forcecal_ros.diagnose.model.gates import Gate
from forcecal_ros.diagnose.model.hypotheses import (
    Atom,
    distinct_columns,
    for_a_part,
    Hypothesis,
)
from forcecal_ros.diagnose.model.jacobian import Column, column, combined, stacked
from forcecal_ros.diagnose.model.linearised import EFFECT, LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import (
    Candidate,
    Explained,
    JointFit,
    ModelComparison,
)
from forcecal_ros.sim.signals import BLOCK
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

TEMPERATURE = 2.0
"""Of log-likelihoods of instants, as of hypotheses: noise and form are not quite as modelled."""


def interval(log_likelihood: Array) -> tuple[int, int, int]:
    """Return, by position, where a 95 % interval begins, its likeliest instant, where it ends."""
    weight = np.cumsum(np.exp((log_likelihood - log_likelihood.max()) / TEMPERATURE))
    low, high = np.minimum(np.searchsorted(weight / weight[-1], (0.025, 0.975)),
                           len(weight) - 1).tolist()
    return low, int(log_likelihood.argmax()), high


class Fits(NamedTuple):
    """
    Fits of some columns that begin, or end, at each of some instants.

    Attributes
    ----------
    evidence : ndarray, shape (instants,)
        Log-evidence against that without them.
    x : ndarray, shape (instants, p)
        Coefficients.
    """

    evidence: Array
    x: Array


class _Beside(NamedTuple):
    """
    Inner products of columns over parts of recordings, beside what is fitted along: they add up.

    Attributes
    ----------
    inner : ndarray, shape (..., k, k)
        Among each other.
    taken : ndarray, shape (..., m, k)
        With what is fitted along, by the root of its information.
    right : ndarray, shape (..., k)
        With the residual that it leaves.
    """

    inner: Array
    taken: Array
    right: Array

    @classmethod
    def of(cls, products: Array, root: Array, left: Array) -> '_Beside':
        m = len(root)
        cross = np.moveaxis(products[..., 1:1 + m, :], -2, 0)
        taken = solve_triangular(root, cross.reshape(m, -1), lower=True).reshape(cross.shape)
        taken = np.moveaxis(taken, 0, -2)
        return cls(products[..., 1 + m:, :], taken, products[..., 0, :] - left @ taken)

    def some(self, columns: NDArray[np.intp]) -> '_Beside':
        return _Beside(self.inner[..., columns[:, np.newaxis], columns],
                       self.taken[..., columns], self.right[..., columns])

    def plus(self, other: '_Beside', times: float = 1.0) -> '_Beside':
        return _Beside(*(a + times * b for a, b in zip(self, other)))


class Instants:
    """
    Inner products of columns over what comes after each of some instants of one recording.

    A column that begins at an instant is whitened as all of it is, but for a few samples.

    Parameters
    ----------
    beside : sequence of sequence of Column
        What is fitted along all the time, of each recording.
    prior : Prior
        Of those.
    columns : sequence of sequence of Column
        What may begin or end, of each recording.
    residuals : sequence of ndarray, shape (n, channels)
    recording : int
        In which it begins or ends.
    length : int
        Blocks from one instant to the next.
    """

    def __init__(self, model: LinearisedModel, beside: Sequence[Sequence[Column]], prior: Prior,
                 columns: Sequence[Sequence[Column]], residuals: Sequence[Array],
                 recording: int, length: int) -> None:
        m, k = len(beside[0]), len(columns[0])
        n = len(residuals[recording])
        self.blocks = np.arange(n // length) * length
        whole, others = np.zeros((1 + m + k,) * 2), np.zeros((1 + m + k,) * 2)
        parts = np.zeros((1 + m + k, k, n // length))
        for i, (r, fixed, own) in enumerate(zip(residuals, beside, columns)):
            for c in range(len(CHANNELS)):
                if not model.noise[i].sigma[:, c].any():
                    continue
                there = [j for j, one in enumerate((*fixed, *own)) if c in one]
                index = np.array([0, *(1 + j for j in there)])
                free = np.flatnonzero(index > m)
                signals = stacked(r[:, c], [(*fixed, *own)[j][c] for j in there])
                for rows, white in model.noise[i].whiten_in_pieces(signals, c, length):
                    products = white @ white.T
                    whole[np.ix_(index, index)] += products
                    if i != recording:
                        others[np.ix_(index, index)] += products
                    elif len(free):
                        here = parts[..., rows.start // length:rows.stop // length]
                        here[np.ix_(index, index[free] - 1 - m)] += _by_parts(
                            white, white[free], length)
        root = cholesky(whole[1:1 + m, 1:1 + m] + np.diag(prior.precision), lower=True)
        gradient = whole[1:1 + m, 0] - prior.precision * prior.centre
        left = solve_triangular(root, gradient, lower=True)
        # the last samples, too few for a part, count with the last one
        total = (whole - others)[:, 1 + m:]
        before = np.cumsum(parts, axis=2) - parts
        after = np.moveaxis(total[..., np.newaxis] - before, 2, 0)
        self._whole, self._after, self._others = (
            _Beside.of(one, root, left) for one in (total, after, others[:, 1 + m:]))

    def fits(self, of: Sequence[int], ends: bool, elsewhere: bool) -> Fits:
        """
        Fit some of the columns.

        Parameters
        ----------
        of : sequence of int
            Which.
        ends : bool
            They act until each instant, not from it on.
        elsewhere : bool
            They act in the other recordings.
        """
        chosen = np.array(of)
        there = self._after.some(chosen)
        if ends:
            there = self._whole.some(chosen).plus(there, -1.0)
        if elsewhere:
            there = there.plus(self._others.some(chosen))
        inner = there.inner - np.swapaxes(there.taken, 1, 2) @ there.taken
        inner = 0.5 * (inner + np.swapaxes(inner, 1, 2)) + EFFECT * np.eye(len(chosen))
        x = np.linalg.solve(inner, there.right[..., np.newaxis])[..., 0]
        volume = np.linalg.slogdet(inner / EFFECT)[1]
        return Fits(0.5 * np.einsum('ti,ti->t', x, there.right) - 0.5 * volume, x)


def _by_parts(left: Array, right: Array, length: int) -> Array:
    """Return inner products over each part, shape (rows of left, rows of right, parts)."""
    n = left.shape[1] // length
    a = np.moveaxis(left[:, :n * length].reshape(len(left), n, length), 1, 0)
    b = np.moveaxis(right[:, :n * length].reshape(len(right), n, length), 1, 0)
    return np.moveaxis(a @ np.swapaxes(b, 1, 2), 0, 2)


class Instant(NamedTuple):
    """An instant, and between which it lies with 95 % [s]."""

    at: float
    low: float
    high: float


def screen_change_points(comparison: ModelComparison, found: Sequence[Hypothesis]
                         ) -> list[Candidate]:
    """
    Find the likeliest change point of each hypothesis, as linear as its columns are.

    Of two change points, likeliest beside the noise and beside white noise, the better one beside
    all that is explained already counts: noise that is fitted to a residual in which an effect
    begins takes its beginning for its own, and white noise what else is slow for an effect.

    Parameters
    ----------
    comparison : ModelComparison
        Of what is explained already.
    found : sequence of Hypothesis
        Of :func:`~forcecal_ros.diagnose.model.hypotheses.everywhere`.

    Returns
    -------
    list of Candidate
        The likeliest first.
    """
    model = comparison.model
    distinct = distinct_columns(found)
    places = {one: j for j, one in enumerate(distinct)}
    several = [[columns[k] for columns in distinct.values()] for k in range(len(model.datasets))]
    beside = [[*own, *more] for own, more in zip(model.jacobian, comparison.extra)]
    alone = replace(model, noise=model.white_noise(model.residuals), discrepancy=None)
    out: dict[str, Candidate] = {}
    for beside_noise in (model, alone):
        best: dict[str, tuple[float, Hypothesis]] = {}
        for recording, dataset in enumerate(model.datasets):
            n = len(dataset.groups)
            # blocks from one instant to the next: 0.1 s up to a minute, the error that is allowed
            length = max(25, -(-n // 600))
            if n < 4 * length:
                continue
            instants = Instants(beside_noise, beside, comparison.null_prior, several,
                                model.residuals, recording, length)
            for h in found:
                for evidence, one in _changes(model, instants, h, places, recording):
                    if h.name not in best or evidence > best[h.name][0]:
                        best[h.name] = evidence, one
        parts = [for_a_part(model, one) for _, one in best.values()]
        for t in comparison.screen(parts) if parts else ():
            name = t.effect.name
            if name not in out or t.evidence > out[name].evidence:
                out[name] = t
    return sorted(out.values(), key=lambda t: -t.evidence)


def _changes(model: LinearisedModel, instants: Instants, h: Hypothesis,
             places: Mapping[int, int], recording: int) -> Iterator[tuple[float, Hypothesis]]:
    """Give a hypothesis' change points in one recording, one for each start and way."""
    several = len(model.datasets) > 1
    start = model.datasets[recording].measured.start
    for atom in h.atoms:
        of = [places[id(c)] for c in atom.columns[0]]
        for ends, elsewhere in product((False, True), (False, True) if several else (False,)):
            evidence, x = instants.fits(of, ends, elsewhere)
            evidence = np.where(_possible(h, atom, x), evidence, -np.inf)
            evidence[0] = -np.inf  # all of a recording, which needs no change point
            b = int(np.argmax(evidence))
            if np.isfinite(evidence[b]):
                at = start + BLOCK * float(instants.blocks[b])
                yield float(evidence[b]), h._replace(
                    atoms=(atom,), gate=Gate(recording, at, ends, elsewhere),
                    times=2 * len(evidence) * len(h.atoms))


def _possible(h: Hypothesis, atom: Atom, x: Array) -> Array:
    """Say at which instants one number alone is within its limits; several are clipped."""
    if len(atom.free) > 1:
        return np.ones(len(x), dtype=bool)
    q = h.effect.parameters[atom.free[0]]
    value = q.nominal + x[:, 0] * (atom.start[atom.free[0]] - q.nominal)
    return np.asarray((value >= q.low - 1e-12) & (value <= q.high + 1e-12))


def instant_of(now: JointFit, name: str) -> Instant | None:
    """
    Find the instant at which an accepted effect begins or ends, to a sample where that shows.

    Parameters
    ----------
    now : JointFit
        With the effect, beginning or ending near there; nothing where it does neither.
    """
    model, gate = now.model, now.model.gates[name]
    if gate.instant is None:
        return None
    added = [column(model.added(name, model.effects, i), model.level)
             for i in range(len(model.datasets))]
    rows = [gate.rows(one.measured, i) for i, one in enumerate(model.datasets)]
    residuals = [r + a * combined([c], np.ones(1), len(r))
                 for r, a, c in zip(model.residuals, rows, added)]
    predicted = model.whitened_discrepancy().predicted(model.residuals)
    residuals = [r - p for r, p in zip(residuals, predicted)]
    explained = Explained(model, [j for j in now.jacobians if j.name != name])
    beside = [[*own, *more] for own, more in zip(model.jacobian, explained.extra)]
    i, one = gate.recording, model.datasets[gate.recording].measured
    coarse = Instants(model, beside, explained.null_prior, [[c] for c in added], residuals, i, 1)
    evidence = coarse.fits([0], gate.ends, gate.elsewhere).evidence
    t = one.start + BLOCK * coarse.blocks
    low, at, high = interval(evidence)
    # among more than 50 blocks its samples are not told apart
    closer = None if high - low > 50 else _to_a_sample(
        model, gate, added[i], residuals[i], t[low], t[high])
    return closer or Instant(float(t[at]), float(t[low]), float(t[high]))


def _to_a_sample(model: LinearisedModel, gate: Gate, added: Column, residual: Array, low: float,
                 high: float) -> Instant | None:
    """Try the stamp of each sample between two instants; nothing where there is none."""
    measured, noise = model.datasets[gate.recording].measured, model.noise[gate.recording]
    signals = {c: one.values() for c, one in added.items()}
    most = max(signals, key=lambda c: float(np.ptp(signals[c]) / model.level[c]))
    stream = CHANNELS[most].stream
    t = measured.times(stream)
    near = np.flatnonzero((t > low - 10 * BLOCK) & (t < high + 10 * BLOCK))
    near = near[near > 0]
    if not len(near):
        return None
    acts = np.stack([measured.since(stream, s) for s in t[near]])
    if gate.ends:
        acts = 1.0 - acts
    slices = STREAM_SLICES[stream]
    product_, square = np.zeros(len(near)), np.full(len(near), 1e-12)
    for c in (c for c in signals if slices.start <= c < slices.stop):
        white = noise.whiten(np.concatenate([residual[np.newaxis, :, c], acts * signals[c]]), c)
        product_ += white[1:] @ white[0]
        square += np.sum(white[1:] ** 2, axis=1)
    # its size is known from all of the recording: only where it begins or ends is asked
    first, best, last = interval(product_ - 0.5 * square)
    before, at = t[near - 1], t[near]
    return Instant(float(0.5 * (before[best] + at[best])), float(before[first]), float(at[last]))


def moved(model: LinearisedModel, name: str, instant: Instant) -> LinearisedModel:
    """Let an effect begin or end at another instant."""
    gates = {**model.gates, name: model.gates[name]._replace(instant=instant.at)}
    return model.evaluated(np.zeros(len(model.nuisances)), gates=gates) or model
