"""How well numbers are known, beside noise and what no library has, and what that leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autoregression import pieces
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.gates import nuisances_of
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import Accepted, ModelComparison
import numpy as np
from scipy.sparse.csgraph import connected_components


class Errors(NamedTuple):
    """
    How well the parameters are known, and what is beside them.

    Attributes
    ----------
    grams : ndarray, shape (channels, k, k)
        Mean products of the parameters' columns over the held-out blocks, not whitened.
    covariance : ndarray, shape (k, k)
        By noise, and a discrepancy as the fit assumed it.
    taken : ndarray, shape (k, k), optional
        By what of a larger discrepancy has the columns' own shape.
    predicted : list of ndarray, shape (n, channels)
        That discrepancy in each recording, by the training blocks.
    unseen : ndarray, shape (channels,)
        Mean square over the held-out blocks by which that may be wrong.
    marginal : ndarray, shape (k, k)
        Covariance whatever the other parameters are, by noise and by what was taken.
    """

    grams: Array
    covariance: Array
    taken: Array | None = None
    predicted: Sequence[Array] = ()
    unseen: Array = np.zeros(len(CHANNELS))
    marginal: Array = np.zeros((0, 0))

    def of_parameters(self, rng: np.random.Generator | None = None) -> Array:
        """
        Mean square that wrong parameters leave in each channel, shape (channels,).

        Parameters
        ----------
        rng : numpy.random.Generator, optional
            Draws the parameters; else what is expected of them.
        """
        return _mean_squares(self.grams, self.covariance, rng)

    def of_discrepancy(self, left: Array, rng: np.random.Generator | None = None) -> Array:
        """
        Mean square of a discrepancy that was taken for effects, or missed.

        Parameters
        ----------
        left : ndarray, shape (channels,)
            Mean square of what effects leave on held-out blocks: no more was missed.
        rng : numpy.random.Generator, optional
            Draws what was taken; else what is expected of it.

        Returns
        -------
        ndarray, shape (channels,)
        """
        if self.taken is None:
            return np.zeros(len(self.grams))
        return _mean_squares(self.grams, self.taken, rng) + np.minimum(self.unseen, left)


def _mean_squares(grams: Array, covariance: Array, rng: np.random.Generator | None) -> Array:
    """Return what parameters of a covariance leave in each channel, shape (channels,)."""
    if rng is not None:
        values, vectors = np.linalg.eigh(covariance)
        x = vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(len(values)))
        covariance = np.outer(x, x)
    return np.asarray(np.einsum('cij,ij->c', grams, covariance))


def parameter_errors(comparison: ModelComparison) -> Errors:
    """
    Estimate what wrong parameters leave on held-out blocks.

    Parameters
    ----------
    comparison : ModelComparison
        At the joint fit.
    """
    model, covariance, k = comparison.model, comparison.null.covariance, comparison.base
    grams, n = np.zeros((len(CHANNELS), k, k)), np.zeros(len(CHANNELS))
    for i, dataset in enumerate(model.datasets):
        columns = [*model.jacobian[i], *comparison.extra[i]]
        n += dataset.measured.present[dataset.held].sum(axis=0)
        for c in range(len(CHANNELS)):
            there = [j for j in range(k) if c in columns[j]]
            if there and dataset.held.any():
                for part in pieces(len(dataset.held)):
                    held = dataset.held[part]
                    rows = np.stack([columns[j][c].values(part)[held] for j in there], dtype=float)
                    grams[c][np.ix_(there, there)] += rows @ rows.T
    grams /= np.maximum(1.0, n)[:, np.newaxis, np.newaxis]
    if model.discrepancy_scales == NO_DISCREPANCY:
        return Errors(grams, covariance, marginal=comparison.marginal_covariance(np.zeros((k, k))))
    products = model.products(comparison.extra)
    sizes = products.likeliest_sizes()
    more = products.spread(comparison.scales, sizes)
    return Errors(grams, covariance, covariance @ more @ covariance, model.predicted(sizes),
                  model.whitened_discrepancy().unseen(sizes), comparison.marginal_covariance(more))


def recalibrations(model: LinearisedModel, errors: Errors) -> dict[str, tuple[float, float]]:
    """Return how far each nuisance moved, and its standard error whatever the others are."""
    std = np.sqrt(np.diag(errors.marginal))
    return {n.name: (float(x * size), float(s * size)) for n, x, s, size in zip(
        model.nuisances, model.centre, std, model.prior_std)}


def aliases(model: LinearisedModel, errors: Errors) -> tuple[frozenset[str], ...]:
    """Return groups of nuisances of which each is an alias of another one."""
    m = len(model.nuisances)
    std = np.sqrt(np.diag(errors.marginal))[:m]
    free = np.where(std > 0.0, std, np.inf)
    # correlation from which numbers are an alias: each is known 2.3 times worse than by itself
    tied = np.abs(errors.marginal[:m, :m]) > 0.9 * np.outer(free, free)
    count, group = connected_components(tied)
    names = np.array([n.name for n in model.nuisances])
    return tuple(frozenset(names[group == i].tolist()) for i in range(count)
                 if np.sum(group == i) > 1)


OWN_SHAPE = 0.3
"""
Part of what is left beside a discrepancy, in that of the misfit, by which an effect is stated too
large or too small: the root mean square in ten cases of two opened parts of the blind check, as if
what is left went eleven ways, one of which is the effect's.
"""

Numbers = dict[str, dict[str, Parameter]]


def with_taken(model: LinearisedModel, accepted: Sequence[Accepted],
               numbers: Mapping[str, Mapping[str, Parameter]], errors: Errors, closed: float
               ) -> Numbers:
    """
    Add to standard errors what of a discrepancy may have been taken for the effect.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit.
    accepted : sequence of Accepted
        In the order of the fit.
    numbers : mapping of str to mapping of str to Parameter
        Of each effect, errors as the fit knows them.
    closed : float
        Share of the misfit that is explained.

    Returns
    -------
    dict of str to dict of str to Parameter
        The same where there is no discrepancy.
    """
    if errors.taken is None:
        return {name: dict(own) for name, own in numbers.items()}
    known = np.diag(errors.covariance)
    more = np.sqrt(1.0 + np.diag(errors.taken) / np.where(known > 0.0, known, np.inf))
    left, out = OWN_SHAPE * float(np.clip(1.0 - closed, 0.0, 1.0)), {}
    for name, own in _columns(model, accepted).items():
        nominal = {q.name: q.nominal for q in model.library[name].parameters if not q.shapes}
        out[name] = {key: replace(p, std=float(np.hypot(
            p.std * more[own[key]], left * (p.value - nominal.get(key, p.value)))))
            if key in own and p.std else p for key, p in numbers[name].items()}
    return out


def _columns(model: LinearisedModel, accepted: Sequence[Accepted]) -> dict[str, dict[str, int]]:
    """Return the column of each number of each effect: nuisances come first."""
    position, out = len(model.nuisances), {}
    for a in accepted:
        quantities = model.library[a.name].parameters
        if len(a.theta):
            out[a.name] = {quantities[i].name: position + j for j, i in enumerate(a.free)}
            position += len(a.free)
        else:
            out[a.name] = {q.name: i for i, q in zip(
                nuisances_of(model.nuisances, model.library[a.name]), quantities)}
    return out
