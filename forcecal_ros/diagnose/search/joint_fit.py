"""Accepted effects, nuisances and noise refitted together."""

from collections.abc import Sequence
from dataclasses import replace

from forcecal_ros.diagnose.model.effect_jacobian import Tangent, tangent
from forcecal_ros.diagnose.model.hypotheses import bounds_of, values_of
from forcecal_ros.diagnose.model.linearised import Diverged, Problem
from forcecal_ros.diagnose.search.fitted import Accepted
from forcecal_ros.diagnose.search.model_comparison import Bench
from forcecal_ros.effects.nuisances import LIMIT
from forcecal_ros.geometry import Array
import numpy as np

ROUNDS = 3
"""Gauss-Newton steps of a joint refit."""

FAR = 2.0
"""Step of the nuisances, in spreads, after which their columns are taken anew."""

SHORTEST = 0.02
"""Fraction of such a step below which it is given up."""


def joint(problem: Problem, accepted: Sequence[Accepted], step: Array | None = None
          ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """
    Refit accepted effects and nuisances together, the discrepancy as large as is likeliest.

    Parameters
    ----------
    problem : Problem
    accepted : sequence of Accepted
    step : ndarray, shape (m,), optional
        Of the nuisances, to begin with.

    Returns
    -------
    problem : Problem
    accepted : list of Accepted
    tangents : list of Tangent
    """
    released = frozenset(n for a in accepted for n in a.released)
    out = replace(problem, released=released, effects=_effects(problem, accepted),
                  centre=problem.centre if step is None else problem.moved(step))
    m, now = len(problem.nuisances), list(accepted)
    if released != problem.released:
        out.linearise()
    else:
        out.settle()
    tangents: list[Tangent] = []
    for _ in range(ROUNDS):
        tangents = [_tangent(out, a) for a in now if len(a.theta)]
        bench = Bench(out, tangents)
        out.allowed = bench.sizes
        before, fraction = out.standing(), 1.0
        while fraction > SHORTEST:
            moved = _moved(now, tangents, bench, fraction)
            tried = replace(out, centre=out.moved(fraction * bench.null.x[:m]),
                            effects=_effects(out, moved))
            if _settles(tried) and tried.standing() > before - 0.1:
                out, now = tried, moved
                break
            fraction *= 0.3
        step = np.abs(bench.null.x)
        if fraction <= SHORTEST \
                or (step[m:].max(initial=0.0) < 1e-3 and step[:m].max(initial=0.0) < 0.1):
            break
        if (released and step[:m].max() > FAR) or out.is_far(step[:m]):
            out.linearise()
    return out, now, tangents


def _settles(problem: Problem) -> bool:
    """Simulate at the centre; say whether that is finite."""
    try:
        problem.settle()
    except Diverged:
        return False
    return True


def joint_if_finite(problem: Problem, accepted: Sequence[Accepted], step: Array | None = None
                    ) -> tuple[Problem, list[Accepted], list[Tangent]] | None:
    """Refit as :func:`joint` does; give nothing where a simulation diverges."""
    try:
        return joint(problem, accepted, step)
    except Diverged:
        return None


def without(start: Problem, problem: Problem, accepted: Sequence[Accepted], name: str
            ) -> tuple[Problem, list[Accepted], list[Tangent]]:
    """
    Take one effect out; noise stays as it is, nuisances are fitted anew.

    Parameters
    ----------
    start, problem : Problem
        Without any effect, and with the accepted ones.
    accepted : list of Accepted
    name : str

    Returns
    -------
    problem : Problem
    accepted : list of Accepted
    tangents : list of Tangent
    """
    rest = [a for a in accepted if a.name != name]
    if not rest:
        return replace(start, noise=problem.noise), [], []
    released = frozenset(n for a in rest for n in a.released)
    bound = np.array([np.inf if n.name in released else LIMIT for n in problem.nuisances])
    out = replace(problem, released=released, effects=_effects(problem, rest),
                  centre=np.clip(problem.centre, -bound, bound))
    if released != problem.released:
        out.linearise()
    else:
        out.settle()
    out.centre = out.moved(out.fit_nuisances().x)
    out.settle()
    return out, rest, [_tangent(out, a) for a in rest if len(a.theta)]


def _moved(accepted: Sequence[Accepted], tangents: Sequence[Tangent], bench: Bench,
           fraction: float) -> list[Accepted]:
    """Go a fraction of the way to the best parameters of all accepted effects."""
    by_name = {t.name: t for t in tangents}
    x, variance = bench.null.x, np.diag(bench.null.covariance)
    position, out = len(bench.problem.nuisances), []
    for a in accepted:
        if len(a.theta):
            part, units = slice(position, position + len(a.free)), by_name[a.name].units
            low, high = bounds_of(bench.problem.library[a.name])
            theta, std = a.theta.copy(), np.zeros(len(a.theta))
            theta[a.free] += fraction * x[part] * units
            std[a.free] = units * np.sqrt(variance[part])
            a = a._replace(theta=np.clip(theta, low, high), std=std)
            position += len(a.free)
        out.append(a)
    return out


def _effects(problem: Problem, accepted: Sequence[Accepted]) -> dict[str, dict[str, float]]:
    return {a.name: values_of(problem.library[a.name], a.theta)
            for a in accepted if len(a.theta)}


def _tangent(problem: Problem, a: Accepted) -> Tangent:
    return tangent(problem, a.name, a.theta, a.free, problem.blocks,
                   range(len(problem.cases)))
