"""Effects that were named, fitted once more where a simulation is straight about another point."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose.engine import Outcome
from forcecal_ros.diagnose.judge.named_effects import Parameter, parameters_of
from forcecal_ros.diagnose.judge.parameter_errors import (
    aliases,
    parameter_errors,
    recalibrations,
    with_taken,
)
from forcecal_ros.diagnose.result import patched_rig
from forcecal_ros.diagnose.search.model_comparison import joint_fit_if_finite
from forcecal_ros.diagnose.search.posterior import Posterior
import numpy as np


class Bent(NamedTuple):
    """
    How far a number would move if the simulation were fitted as it is, and not as a line.

    Attributes
    ----------
    shift, std : float
        In the nuisance's prior standard deviation; the latter of the number itself.
    """

    shift: float
    std: float


def refitted(outcome: Outcome) -> Outcome:
    """
    Fit the accepted effects anew, all that was linearised before taken again.

    Parameters
    ----------
    outcome : Outcome
        Whose simulations were tried at another point since.

    Returns
    -------
    Outcome
        With the same effects, its numbers those of the new fit; as it was where that diverges.
    """
    if outcome.selection is None or outcome.checks is None or not outcome.selection.accepted:
        return outcome
    model = replace(outcome.selection.model)
    model.linearise()
    now = joint_fit_if_finite(model, outcome.selection.accepted)
    if now is None:
        return outcome
    known = {a.name: parameters_of(now.model, a) for a in now.accepted}
    gap = outcome.diagnosis.gap
    errors = parameter_errors(now.comparison())
    numbers = with_taken(now.model, now.accepted, known, errors, gap.closed if gap else 1.0)
    effects = tuple(replace(e, parameters=numbers.get(e.name, e.parameters))
                    for e in outcome.diagnosis.effects)
    selection = outcome.selection._replace(model=now.model, accepted=tuple(now.accepted),
                                           jacobians=tuple(now.jacobians))
    return replace(outcome, diagnosis=replace(outcome.diagnosis, effects=effects),
                   rig=patched_rig(now.model, selection, outcome.checks), selection=selection,
                   recalibrations=recalibrations(now.model, errors),
                   aliases=aliases(now.model, errors),
                   explained=tuple(now.model.residuals))


def bent(selection: Posterior) -> dict[str, Bent]:
    """
    Say how far each nuisance would still move, where the simulation was run as it was found.

    Parameters
    ----------
    selection : Posterior
        Whose simulations now give at its point what a run of them gives, not what a line does.

    Returns
    -------
    dict of str to Bent
        Of each nuisance that is a number of an accepted effect.
    """
    line, model = selection.model, replace(selection.model)
    model.evaluate()
    found = model.fit_nuisances()
    shift = found.x - line.fit_nuisances().x
    std = np.sqrt(np.diag(found.covariance))
    return {n.name: Bent(float(x), float(s))
            for n, x, s in zip(model.nuisances, shift, std) if n.name in model.released}


def widened(outcome: Outcome, off: Mapping[str, Bent]) -> Outcome:
    """
    Add to the standard errors of a simulator's numbers what a line leaves wrong in them.

    Parameters
    ----------
    off : mapping of str to Bent
        By the name of the number, which is that of its effect.
    """
    effects = tuple(replace(e, parameters={k: _wider(p, off[e.name])
                                           for k, p in e.parameters.items()})
                    if e.name in off else e for e in outcome.diagnosis.effects)
    return replace(outcome, diagnosis=replace(outcome.diagnosis, effects=effects))


def _wider(p: Parameter, by: Bent) -> Parameter:
    return replace(p, std=p.std * float(np.hypot(1.0, by.shift / by.std))) if by.std else p
