"""Standard errors of an effect's numbers that hold beside what no library has."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.judge.parameter_errors import Errors
from forcecal_ros.diagnose.model.gates import nuisances_of
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import Accepted
import numpy as np

LIKE = 0.3
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
    left, out = LIKE * float(np.clip(1.0 - closed, 0.0, 1.0)), {}
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
