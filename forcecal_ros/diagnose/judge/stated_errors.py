"""Standard errors of an effect's numbers that hold beside what no library has."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from forcecal_ros.diagnose.judge.gap import Errors
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.model.gates import nuisances_of
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.fitted import Accepted
import numpy as np

Numbers = dict[str, dict[str, Parameter]]


def with_taken(model: LinearisedModel, accepted: Sequence[Accepted],
               numbers: Mapping[str, Mapping[str, Parameter]], errors: Errors) -> Numbers:
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

    Returns
    -------
    dict of str to dict of str to Parameter
        The same where there is no discrepancy.
    """
    if errors.taken is None:
        return {name: dict(own) for name, own in numbers.items()}
    known = np.diag(errors.covariance)
    more = np.sqrt(1.0 + np.diag(errors.taken) / np.where(known > 0.0, known, np.inf))
    out: Numbers = {}
    for name, own in _columns(model, accepted).items():
        out[name] = {key: replace(p, std=p.std * float(more[own[key]])) if key in own else p
                     for key, p in numbers[name].items()}
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
