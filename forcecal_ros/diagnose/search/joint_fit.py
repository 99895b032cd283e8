"""Accepted effects and nuisances refitted together."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.model.hypotheses import (
    bounds_of,
    effect_jacobian,
    EffectJacobian,
    values_of,
)
from forcecal_ros.diagnose.model.linearised import Diverged, LinearisedModel
from forcecal_ros.diagnose.search.model_comparison import Accepted, Explained, ModelComparison
import numpy as np

ROUNDS = 10
"""Gauss-Newton steps of a joint refit, at most: a resonance that starts an octave off takes 8."""

SETTLED = 0.1
"""Log-posterior that a step has to bring for another one to follow: half a standard error."""

SHORTEST = 0.02
"""Fraction of a Gauss-Newton step below which it is given up."""


class JointFit(NamedTuple):
    """
    Accepted effects, nuisances and noise as fitted together.

    Attributes
    ----------
    model : LinearisedModel
        With the effects, evaluated there.
    jacobians : list of EffectJacobian
        Of the effects that have parameters of their own.
    """

    model: LinearisedModel
    accepted: list[Accepted]
    jacobians: list[EffectJacobian]

    def explained(self) -> Explained:
        """Return what it explains, as columns."""
        return Explained(self.model, self.jacobians)

    def comparison(self) -> ModelComparison:
        """Weigh it, and further hypotheses beside it."""
        return ModelComparison(self.model, self.jacobians)


def joint_fit(model: LinearisedModel, accepted: Sequence[Accepted], step: Array | None = None
              ) -> JointFit:
    """
    Refit accepted effects and nuisances together, the discrepancy as large as is likeliest.

    Parameters
    ----------
    step : ndarray, shape (m,), optional
        Of the nuisances, to begin with.
    """
    released = frozenset(n for a in accepted for n in a.released)
    out = replace(model, released=released, effects=_effects(model, accepted),
                  centre=model.centre if step is None else model.moved(step))
    m, now = len(model.nuisances), list(accepted)
    out.retake(released)
    jacobians: list[EffectJacobian] = []
    for _ in range(ROUNDS):
        jacobians = [_jacobian(out, a) for a in now if len(a.theta)]
        comparison = ModelComparison(out, jacobians)
        out.discrepancy_scales = comparison.scales
        before, fraction, gained = out.log_posterior(comparison.every.square), 1.0, -np.inf
        while fraction > SHORTEST:
            moved = _moved(now, jacobians, comparison, fraction)
            tried = replace(out, centre=out.moved(fraction * comparison.null.x[:m]),
                            effects=_effects(out, moved))
            if _evaluates(tried):
                gained = tried.log_posterior() - before
                if gained > -SETTLED:
                    out, now = tried, moved
                    break
            fraction *= 0.3
        if gained < SETTLED:
            break
        if out.is_far(comparison.null.x[:m]):
            out.linearise()
        elif released:
            out.retake(released)
    return JointFit(out, now, jacobians)


def _evaluates(model: LinearisedModel) -> bool:
    """Simulate at the centre; say whether that is finite."""
    try:
        model.evaluate()
    except Diverged:
        return False
    return True


def joint_fit_if_finite(model: LinearisedModel, accepted: Sequence[Accepted],
                        step: Array | None = None) -> JointFit | None:
    """Refit as :func:`joint_fit` does; give nothing where a simulation diverges."""
    try:
        return joint_fit(model, accepted, step)
    except Diverged:
        return None


def without_effect(start: LinearisedModel, now: JointFit, name: str) -> JointFit:
    """
    Take one effect out; noise stays as it is, nuisances are fitted anew.

    Parameters
    ----------
    start : LinearisedModel
        Without any effect.
    now : JointFit
        With the accepted ones.
    """
    model, others = now.model, [a for a in now.accepted if a.name != name]
    if not others:
        return JointFit(replace(start, noise=model.noise), [], [])
    released = frozenset(n for a in others for n in a.released)
    out = replace(model, released=released, effects=_effects(model, others))
    prior = out.prior()
    out.centre = np.clip(model.centre, prior.low, prior.high)
    out.retake(released)
    out.centre = out.moved(out.fit_nuisances().x)
    out.evaluate()
    return JointFit(out, others, [_jacobian(out, a) for a in others if len(a.theta)])


def _moved(accepted: Sequence[Accepted], jacobians: Sequence[EffectJacobian],
           comparison: ModelComparison, fraction: float) -> list[Accepted]:
    """Go a fraction of the way to the best parameters of all accepted effects."""
    by_name = {t.name: t for t in jacobians}
    x, variance = comparison.null.x, np.diag(comparison.null.covariance)
    position, out = len(comparison.model.nuisances), []
    for a in accepted:
        if len(a.theta):
            part, units = slice(position, position + len(a.free)), by_name[a.name].units
            low, high = bounds_of(comparison.model.library[a.name])
            theta, std = a.theta.copy(), np.zeros(len(a.theta))
            theta[a.free] += fraction * x[part] * units
            std[a.free] = units * np.sqrt(variance[part])
            a = a._replace(theta=np.clip(theta, low, high), std=std)
            position += len(a.free)
        out.append(a)
    return out


def _effects(model: LinearisedModel, accepted: Sequence[Accepted]) -> dict[str, dict[str, float]]:
    return {a.name: values_of(model.library[a.name], a.theta)
            for a in accepted if len(a.theta)}


def _jacobian(model: LinearisedModel, a: Accepted) -> EffectJacobian:
    return effect_jacobian(model, a.name, a.theta, a.free, model.residuals,
                           range(len(model.datasets)))
