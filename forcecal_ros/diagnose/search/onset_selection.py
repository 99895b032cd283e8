"""Whether an effect that begins or ends during a recording explains it better."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.diagnose.model.gates import BIAS
from forcecal_ros.diagnose.model.hypotheses import everywhere, for_a_part, Hypothesis
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.acceptance import (
    acceptable,
    LEAST_LONG_MEMORY_RATIO,
    long_memory_likelihood_ratio,
    ranked,
    SIMILAR,
)
from forcecal_ros.diagnose.search.bias_steps import Event
from forcecal_ros.diagnose.search.fitted import Accepted
from forcecal_ros.diagnose.search.joint_fit import joint_fit_if_finite, JointFit, without_effect
from forcecal_ros.diagnose.search.onsets import (
    Instant,
    instant_of,
    INSTANTS,
    likeliest_onsets,
    moved,
    Onset,
)
from forcecal_ros.diagnose.search.selection import select, Selection
import numpy as np

MOST = 2
"""Effects that begin or end, looked for in one diagnosis."""

TRIES = 3
"""Onsets that are fitted in full."""

LEAST = LEAST_LONG_MEMORY_RATIO + float(np.log(INSTANTS))
"""Log-likelihood ratio that an onset needs: what any effect does, and as many instants tried."""


CERTAIN = float(np.sqrt(2.0 * LEAST))
"""Standard errors of a number of an onset whose likelihood ratio is the least."""


class Found(NamedTuple):
    """
    Outcome of the search with effects that begin or end.

    Attributes
    ----------
    model : LinearisedModel
        Without effects; with the steps of the wrench's bias.
    events : tuple of Event
        Those steps.
    instants : dict of str to Instant
        Of each effect that begins or ends.
    """

    model: LinearisedModel
    selection: Selection
    events: tuple[Event, ...]
    instants: dict[str, Instant]


def with_onsets(bare: LinearisedModel, without_steps: LinearisedModel, now: Found,
                hypotheses: Sequence[Hypothesis]) -> Found:
    """
    Let effects begin or end as long as that explains the recordings better.

    Parameters
    ----------
    bare : LinearisedModel
        Without what is known before any model.
    without_steps : LinearisedModel
        The model without steps of the bias, which an onset may take the place of.
    now : Found
        With effects that act all the time.
    hypotheses : sequence of Hypothesis
        As they act all the time.
    """
    free = everywhere(now.model, hypotheses)
    for _ in range(MOST):
        other = _one_more(bare, without_steps, now, hypotheses, free)
        if other is None:
            break
        now = other
    return now


def _one_more(bare: LinearisedModel, without_steps: LinearisedModel, now: Found,
              hypotheses: Sequence[Hypothesis], free: Sequence[Hypothesis]) -> Found | None:
    """Add the likeliest onset, and search for all that acts besides anew."""
    selection, taken = now.selection, set(now.instants)
    candidates = [h for h in free if h.name not in taken]
    explained = JointFit(selection.model, list(selection.accepted), list(selection.jacobians))
    starts = [(now, explained)]
    if not taken:
        plain = now._replace(model=_white(without_steps), events=())
        starts.append((plain, JointFit(plain.model, [], [])))
    fitted = [one for start, fit in starts
              for one in _fitted(start, fit, selection.model, candidates)]
    if not fitted:
        return None
    ratio, start, fit, onset = max(fitted, key=lambda one: one[0])
    return None if ratio < LEAST else _searched(bare, now, start, fit, onset, hypotheses, free)


def _white(model: LinearisedModel) -> LinearisedModel:
    """
    Take the noise for white.

    One that was fitted to a residual in which an effect begins whitens its beginning away.
    """
    return replace(model, noise=model.white_noise(model.residuals))


def _fitted(start: Found, now: JointFit, before: LinearisedModel,
            candidates: Sequence[Hypothesis]) -> list[tuple[float, Found, JointFit, Onset]]:
    """Fit the likeliest onsets, each with what it brings over the explanation so far."""
    onsets = likeliest_onsets(now, candidates)[:TRIES]
    least = max(LEAST_LONG_MEMORY_RATIO, SIMILAR * onsets[0].evidence) if onsets else 0.0
    # all of them beside one noise: to whiten features by another takes as long as a fit
    fits = [(onset, _as_found(now, onset)) for onset in onsets if onset.evidence >= least]
    out = []
    for onset, fit in fits:
        fit = fit and _refitted(fit, onset.name, before)
        if fit is not None and _shown(fit.model, fit.accepted, onset.name):
            out.append((long_memory_likelihood_ratio(before, fit.model), start, fit, onset))
    return out


def _as_found(now: JointFit, onset: Onset) -> JointFit | None:
    """Fit an onset beside all that is explained already, and the noise to what is left."""
    model = replace(now.model, gates={**now.model.gates, onset.name: onset.gate},
                    library={**now.model.library, BIAS.name: BIAS})
    others = [a for a in now.accepted if a.name != onset.name]
    fit = joint_fit_if_finite(model, [*others, onset.accepted()])
    if fit is not None:
        fit.model.refit_noise(np.zeros(len(model.nuisances)))
    return fit


def _shown(model: LinearisedModel, accepted: Sequence[Accepted], name: str) -> bool:
    """
    Say whether a number of an effect stands as far from nothing as its likelihood ratio says.

    Where a simulation is as inexact as measured motion is, an effect at the end of its range, or
    of a size that nothing tells, can make a likelihood larger: that is none.
    """
    own = next((a for a in accepted if a.name == name), None)
    if own is None:
        return False
    return any(not q.shapes and std > 0.0 and q.low < value < q.high
               and abs(value - q.nominal) > CERTAIN * std
               for q, value, std in zip(model.library[name].parameters, own.theta, own.std))


def _refitted(now: JointFit, name: str, before: LinearisedModel) -> JointFit | None:
    """Fit instant, effects and noise in turn; nothing where it brings nothing."""
    for last in (False, True):
        now = now._replace(model=moved(now.model, name, instant_of(now, name)))
        if long_memory_likelihood_ratio(before, now.model) < 0.0:
            return None
        now = joint_fit_if_finite(now.model, now.accepted) or now
        if not last:
            now.model.refit_noise(np.zeros(len(now.model.nuisances)))
    return now


def _accepted(start: LinearisedModel, fit: JointFit, onset: Hypothesis,
              found: Sequence[Hypothesis]) -> bool:
    """Say whether an onset brings beside the others what any effect has to."""
    tested = sum(h.ways for h in found)
    less = without_effect(start, fit, onset.name)
    return any(acceptable(t, tested) for t in ranked(less.comparison(), [onset], tested))


def _searched(bare: LinearisedModel, now: Found, start: Found, fit: JointFit, onset: Onset,
              hypotheses: Sequence[Hypothesis], free: Sequence[Hypothesis]) -> Found | None:
    """Search with an onset among the hypotheses; nothing where it is not borne out."""
    gates = {**{n: now.selection.model.gates[n] for n in now.instants},
             onset.name: fit.model.gates[onset.name]}
    model = replace(start.model, gates=gates, library=fit.model.library, noise=fit.model.noise)
    by_name = {h.name: for_a_part(model, h, gates[h.name]) for h in free if h.name in gates}
    found = [*(h for h in hypotheses if h.name not in by_name), *by_name.values()]
    if not _accepted(model, fit, by_name[onset.name], found):
        return None
    selection = select(model, found, bare, free, fit)
    named = {a.name for a in selection.accepted}
    instants = {}
    for name in named & set(selection.model.gates):
        jointly = JointFit(selection.model, list(selection.accepted), list(selection.jacobians))
        instants[name] = instant_of(jointly, name)
        selection = selection._replace(model=moved(selection.model, name, instants[name]))
    ratio = long_memory_likelihood_ratio(now.selection.model, selection.model)
    if len(instants) <= len(now.instants) or ratio < LEAST \
            or not all(_shown(selection.model, selection.accepted, n) for n in instants):
        return None
    return Found(start.model, selection, start.events, instants)
