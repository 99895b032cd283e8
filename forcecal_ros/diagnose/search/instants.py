"""What hypotheses are worth that begin, or end, at any instant of a recording."""

from collections.abc import Sequence
from typing import NamedTuple

from forcecal_ros.diagnose.inputs.channels import CHANNELS
from forcecal_ros.diagnose.model.evidence import Prior
from forcecal_ros.diagnose.model.jacobian import Column
from forcecal_ros.diagnose.model.linearised import EFFECT, LinearisedModel
from forcecal_ros.geometry import Array
import numpy as np
from scipy.linalg import cho_factor, cho_solve

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
        self._m, self.length = m, length
        n = len(residuals[recording])
        self.blocks = np.arange(1, n // length) * length
        whole, others = np.zeros((1 + m + k,) * 2), np.zeros((1 + m + k,) * 2)
        parts = np.zeros((n // length, 1 + m + k, k))
        for i, (r, fixed, own) in enumerate(zip(residuals, beside, columns)):
            for c in range(len(CHANNELS)):
                if not model.noise[i].sigma[:, c].any():
                    continue
                there = [j for j, one in enumerate((*fixed, *own)) if c in one]
                stack = np.stack([r[:, c], *((*fixed, *own)[j][c] for j in there)])
                white = model.noise[i].whiten(stack.astype(float), c)
                index = np.array([0, *(1 + j for j in there)])
                products = white @ white.T
                whole[np.ix_(index, index)] += products
                if i != recording:
                    others[np.ix_(index, index)] += products
                    continue
                free = np.flatnonzero(index > m)
                if len(free):
                    parts[np.ix_(np.arange(len(parts)), index, index[free] - 1 - m)] += _by_parts(
                        white, white[free], length)
        self._factor = cho_factor(whole[1:1 + m, 1:1 + m] + np.diag(prior.precision))
        gradient = whole[1:1 + m, 0] - prior.precision * prior.centre
        self._left = cho_solve(self._factor, gradient)
        # the last samples, too few for a part, count with the last one
        total = (whole - others)[:, 1 + m:]
        after = total - np.cumsum(parts, axis=0)[:-1]
        self._whole, self._others, self._after = total, others[:, 1 + m:], after

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
        products = (self._whole - self._after if ends else self._after)[:, :, list(of)]
        if elsewhere:
            products = products + self._others[:, list(of)]
        m, p = self._m, len(of)
        rows = 1 + m + np.array(of)
        cross = products[:, 1:1 + m]
        taken = cho_solve(self._factor, np.moveaxis(cross, 1, 0).reshape(m, -1))
        taken = np.moveaxis(taken.reshape(m, len(products), p), 0, 1)
        inner = products[:, rows] - np.einsum('tmi,tmj->tij', cross, taken)
        inner = 0.5 * (inner + np.swapaxes(inner, 1, 2)) + EFFECT * np.eye(p)
        right = products[:, 0] - np.einsum('tmi,m->ti', cross, self._left)
        x = np.linalg.solve(inner, right[..., np.newaxis])[..., 0]
        volume = np.linalg.slogdet(inner / EFFECT)[1]
        return Fits(0.5 * np.einsum('ti,ti->t', x, right) - 0.5 * volume, x)


def _by_parts(left: Array, right: Array, length: int) -> Array:
    """Return inner products over each part, shape (parts, rows of left, rows of right)."""
    n = left.shape[1] // length
    a = np.moveaxis(left[:, :n * length].reshape(len(left), n, length), 1, 0)
    b = np.moveaxis(right[:, :n * length].reshape(len(right), n, length), 1, 0)
    return np.asarray(a @ np.swapaxes(b, 1, 2))
