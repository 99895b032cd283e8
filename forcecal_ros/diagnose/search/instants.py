"""What hypotheses are worth that begin, or end, at any instant of a recording."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.compact import stacked
from forcecal_ros.diagnose.model.evidence import Prior
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.diagnose.model.linearised import EFFECT, LinearisedModel
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

COVERED = 0.95
"""Probability that the interval of an instant covers."""


def interval(log_likelihood: Array, temperature: float = 1.0) -> tuple[int, int, int]:
    """Return, by position, where an interval begins, its likeliest instant, where it ends."""
    weight = np.cumsum(np.exp((log_likelihood - log_likelihood.max()) / temperature))
    share, last = weight / weight[-1], len(weight) - 1
    low, high = (min(last, int(np.searchsorted(share, 0.5 + sign * 0.5 * COVERED)))
                 for sign in (-1.0, 1.0))
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
        self.length = length
        n = len(residuals[recording])
        self.blocks = np.arange(1, n // length) * length
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
        np.cumsum(parts, axis=2, out=parts)
        after = np.subtract(total[..., np.newaxis], parts, out=parts)[..., :-1]
        after = np.moveaxis(after, 2, 0)
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
