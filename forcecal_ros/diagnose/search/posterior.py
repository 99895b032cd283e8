"""
The posterior over explanations of recordings: nothing, one effect, several.

Every explanation is scored by the marginal likelihood of all data, nuisances and discrepancy
integrated out. Effects that act all the time and effects that begin or end are candidates of the
same table. The best are fitted on simulations, beside what is explained; each effect is tried to
be removed or exchanged again. One calibration then states how probable each effect is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate, count
from types import MappingProxyType
from typing import NamedTuple

from forcecal_ros.diagnose.model.discrepancy import NO_DISCREPANCY
from forcecal_ros.diagnose.model.evidence import Earlier, FIRST_RECORDING
from forcecal_ros.diagnose.model.gates import BIAS, kind_of
from forcecal_ros.diagnose.model.hypotheses import (
    EffectJacobian,
    everywhere,
    Hypothesis,
    in_one_recording,
    left_out,
)
from forcecal_ros.diagnose.model.linearised import LinearisedModel
from forcecal_ros.diagnose.search.calibration import (
    Calibration,
    Features,
    features_of,
    stored,
)
from forcecal_ros.diagnose.search.change_points import (
    Instant,
    instant_of,
    moved,
    screen_change_points,
)
from forcecal_ros.diagnose.search.model_comparison import (
    Accepted,
    Candidate,
    joint_fit_if_finite,
    JointFit,
    WORTHWHILE,
)
from forcecal_ros.diagnose.verdict import NAMED, UNKNOWN
from forcecal_ros.sim.signals import BLOCK
import numpy as np

REFINED = 4
"""Effects that are fitted on simulations beside each explanation."""

MOST_EFFECTS = 4
"""Effects of one explanation, at most."""

WORTH = 8.0
"""Log-evidence that an effect has to bring: 3,000 to one, for some hundred that are tried."""

SHADOW = 0.5
"""Share of what an effect brought that another has to bring in its place, by the linear screen."""


class Explanation(NamedTuple):
    """
    Effects as fitted together, and what they are worth.

    Attributes
    ----------
    evidence : float
        Log marginal likelihood of all data, beside the noise of ``fit``; the number of ways that
        were tried is allowed for.
    missing : float
        Log-evidence that a model without any flaw would have more.
    ways : mapping of str to float
        Logarithm of the number of ways in which each effect was tried.
    """

    fit: JointFit
    evidence: float
    missing: float
    ways: Mapping[str, float] = MappingProxyType({})

    @property
    def names(self) -> frozenset[str]:
        """The effects, by name."""
        return frozenset(a.name for a in self.fit.accepted)

    @property
    def score(self) -> float:
        """Log-evidence, less what each effect and each change point has to bring."""
        return self.evidence - WORTH * (len(self.fit.accepted) + len(self.fit.model.gates))


class Posterior(NamedTuple):
    """
    Outcome of the search.

    Attributes
    ----------
    model : LinearisedModel
        With the accepted effects, at the joint fit.
    features : dict of str to Features
        Of each accepted effect, or of what comes closest: what its probability follows from.
    alternatives : dict of str to dict of str to float
        Log-evidence of each other effect in the place of one of these, against that one.
    discrepancy_evidence : float
        Log-likelihood of a discrepancy, and of what else is unexplained.
    instants : dict of str to Instant or None
        When effects begin or end that do not act all the time; None: in one recording alone.
    closest : JointFit, optional
        The likeliest of what comes closest, if none was accepted.
    """

    model: LinearisedModel
    accepted: tuple[Accepted, ...]
    jacobians: tuple[EffectJacobian, ...]
    features: Mapping[str, Features] = MappingProxyType({})
    alternatives: Mapping[str, Mapping[str, float]] = MappingProxyType({})
    discrepancy_evidence: float = 0.0
    instants: Mapping[str, Instant | None] = MappingProxyType({})
    closest: JointFit | None = None

    def earlier(self) -> Earlier:
        """Return what a further recording continues from: none where effects come and go."""
        if self.instants:
            return FIRST_RECORDING
        names = frozenset(self.features)
        found = {names: 0.0}
        for name, others in self.alternatives.items():
            found[names - {name}] = -self.features[name].gain
            found |= {names - {name} | {other}: e for other, e in others.items()}
        missing = max((f.missing for f in self.features.values()),
                      default=self.discrepancy_evidence)
        best = max(found.values())
        return Earlier({names: e - best for names, e in found.items()}, missing)

    @property
    def beside_discrepancy(self) -> bool:
        """Whether the effects were weighed beside a discrepancy."""
        return self.model.discrepancy_scales != NO_DISCREPANCY


class _Table:
    """All effects, for all of the time, in one recording alone, and from or until an instant."""

    def __init__(self, model: LinearisedModel, found: Sequence[Hypothesis]) -> None:
        self.parts = {h.name: h for h in everywhere(model, found)}
        self.found = [*found, *in_one_recording(model, list(self.parts.values()))]
        self.taken_up = [name for name, h in self.parts.items() if h.effect.nuisance
                         and not model.datasets[0].simulation.from_accelerometer]

    def candidates(self, now: JointFit) -> list[Candidate]:
        """List what may be added to an explanation, the likeliest first, by linear evidence."""
        model, taken = now.model, {a.name for a in now.accepted}
        comparison, step = now.comparison(), _further_step(model)
        screened = comparison.screen([_renamed(h, step) for h in self.found
                                      if h.name not in taken or h.name == BIAS.name])
        # of an effect that begins or ends a part shows as if it acted longer, unless a number of
        # the model takes up its mean
        likely = list(dict.fromkeys(t.effect.name for t in screened if t.evidence > WORTH))
        begin = {BIAS.name, *({*likely[:2 * REFINED], *self.taken_up} - taken)}
        parts = [_renamed(h, step) for name, h in self.parts.items()
                 if name in begin and not h.effect.begins_anew]
        found: dict[str, Candidate] = {}
        for some in ([t for t in screened if t.gate is None], [t for t in screened if t.gate],
                     screen_change_points(comparison, parts)):
            # what acts all the time needs no recording alone, and what acts in that no instant
            before = dict(found)
            for t in reversed(some):
                other = before.get(t.effect.name)
                if other is None:
                    found[t.effect.name] = t
                elif t.evidence > other.evidence + WORTH:
                    found[t.effect.name] = t._replace(otherwise=other)
        return sorted((t._replace(evidence=t.evidence - model.earlier.of(taken)
                                  + model.earlier.of({*taken, t.effect.name}))
                       for t in found.values()), key=lambda t: -t.evidence)


def _renamed(h: Hypothesis, step: str) -> Hypothesis:
    """Give the next step of a bias its name."""
    return h._replace(name=step) if h.name == BIAS.name else h


def _further_step(model: LinearisedModel) -> str:
    """Name the next step of a bias: a recording may have several."""
    names = (BIAS.name if n == 1 else f'{BIAS.name}.{n}' for n in count(1))
    return next(name for name in names if name not in model.effects)


def weigh(fit: JointFit, ways: Mapping[str, float] = MappingProxyType({})) -> Explanation:
    """Score an explanation beside its noise, and by what earlier recordings found."""
    comparison, earlier = fit.comparison(), fit.model.earlier
    fit.model.discrepancy_scales = comparison.scales
    known = earlier.of({a.name for a in fit.accepted}) - sum(
        ways.get(a.name, 0.0) for a in fit.accepted)
    return Explanation(fit, comparison.null_evidence + known,
                       comparison.missing_evidence + earlier.missing, ways)


def extended(parent: Explanation, table: _Table, known: set[frozenset[str]],
             least: float = 0.0) -> list[Explanation]:
    """
    Add one effect to an explanation: the likeliest few, fitted on simulations.

    Parameters
    ----------
    known : set of frozenset of str
        Explanations that are fitted already; those fitted here are added.
    least : float
        Log-evidence that an effect has to bring by the linear screen, ``WORTHWHILE`` in any case:
        from there, its fit may lead to what is worth its place.
    """
    now, least, fits = parent.fit, max(least, WORTHWHILE), []
    likely = [t for t in table.candidates(now) if t.evidence > least]
    for t, begun in _by_first_step(parent, likely):
        names = parent.names | {t.effect.name}
        if names in known:
            continue
        known.add(names)
        for one in (t, *(n for n in t.nested if n.evidence > WORTHWHILE)):
            fit, other = _continued(now, one, begun if one is t else None), one.otherwise
            if fit is None and other and other.evidence > least:
                one, fit = other, _continued(now, other, None)
            fits.append((one, fit))
    return [weigh(fit, {**parent.ways, t.effect.name: float(np.log(t.ways))})
            for t, fit in fits if fit is not None]


def _by_first_step(parent: Explanation, likely: Sequence[Candidate]
                   ) -> list[tuple[Candidate, JointFit | None]]:
    """
    Choose candidates to fit: beside nothing, by the first step of the fit where many are likely.

    Of what depends on products of its parameters, as a cable's torque does on its pull and its
    point, the columns show little: they were taken where it is small. What acts for a part of the
    time keeps its place by the columns.
    """
    if parent.names or len(likely) <= REFINED:
        return [(t, None) for t in likely[:REFINED]]
    begun: list[tuple[float, Candidate, JointFit | None]] = []
    for t in likely[:2 * REFINED]:
        fit = None if t.gate else _with(parent.fit, t, 1)
        if fit:
            gained = weigh(fit).evidence - parent.evidence - float(np.log(t.ways))
            begun.append((gained, t, fit))
        elif t.gate:
            begun.append((t.evidence, t, None))
    return [(t, fit) for _, t, fit in sorted(begun, key=lambda one: -one[0])[:REFINED]]


def _continued(now: JointFit, t: Candidate, begun: JointFit | None) -> JointFit | None:
    """Fit a candidate beside an explanation, from where its first step led."""
    if t.gate and t.gate.instant is not None:
        return _with_change_point(now, t)
    return joint_fit_if_finite(begun.model, begun.accepted) if begun else _with(now, t)


def _with(now: JointFit, t: Candidate, rounds: int = 10) -> JointFit | None:
    """Fit a candidate beside an explanation; None if its simulation diverges."""
    model, name = now.model, t.effect.name
    gates = {n: g for n, g in model.gates.items() if n in model.effects}
    if t.gate is not None:
        gates[name] = t.gate
    library = {**model.library, name: BIAS} if kind_of(name) == BIAS.name else model.library
    model = replace(model, gates=gates, library=library, discrepancy_scales=t.scales)
    return joint_fit_if_finite(model, [*now.accepted, t.effect], t.nuisances, rounds)


def _with_change_point(now: JointFit, t: Candidate) -> JointFit | None:
    """
    Fit a candidate that begins or ends, once its change point is found beside white noise alone.

    Noise and a discrepancy that are fitted to a residual in which an effect begins take its
    beginning for their own.
    """
    model = now.model
    alone = replace(model, noise=model.white_noise(model.residuals), discrepancy=None)
    fit = _with(now._replace(model=alone), t._replace(scales=NO_DISCREPANCY))
    if fit is None:
        return None
    instant = instant_of(fit, t.effect.name)
    assert t.gate is not None and instant is not None
    length = BLOCK * len(model.datasets[t.gate.recording].groups)
    if instant.high - instant.low > 0.5 * length:
        return None  # a change point that the recording does not locate is none
    placed = moved(fit.model, t.effect.name, instant)
    return joint_fit_if_finite(replace(placed, noise=model.noise, discrepancy=model.discrepancy),
                               fit.accepted)


def _without(start: LinearisedModel, now: Explanation, name: str) -> Explanation:
    """Remove an effect and fit the others anew, noise as it is."""
    model, others = now.fit.model, [a for a in now.fit.accepted if a.name != name]
    if not others:
        return weigh(JointFit(replace(start, noise=model.noise), [], []), now.ways)
    # where the others do not fit without it, nothing is known of what it brings
    return weigh(joint_fit_if_finite(model, others) or now.fit, now.ways)


def _exchanged(start: LinearisedModel, full: Explanation, table: _Table,
               known: set[frozenset[str]]) -> list[Explanation]:
    """Remove each effect whose part the newest may have, and add others in its place."""
    out = []
    for a in full.fit.accepted[:-1]:
        shorter = _without(start, full, a.name)
        least = SHADOW * (full.evidence - shorter.evidence)
        out += [shorter, *extended(shorter, table, known, least)]
    return out


def _chosen(start: LinearisedModel, found: Sequence[Explanation], best: Explanation
            ) -> tuple[Explanation, dict[str, Features]]:
    """
    Choose the explanation of the highest score among those found, and weigh each of its effects.

    Parameters
    ----------
    best : Explanation
        What is explained already, for which none with an effect less has to be fitted again.
    """
    pool, now = found, max(found, key=lambda one: one.evidence)
    while True:
        now = _all_the_time(now)
        less = {name: best if now.names - {name} == best.names else _without(start, now, name)
                for name in now.names}
        pool = [one for one in (*pool, *less.values())
                if one.names and one.names != now.names and one.score > now.score]
        if not pool:
            return now, features_of({name: now.evidence - one.evidence
                                     for name, one in less.items()}, now.missing)
        now = max(pool, key=lambda one: one.score)


def _all_the_time(now: Explanation) -> Explanation:
    """Remove the change point of the newest effect; keep it only where it is worth its place."""
    model, name = now.fit.model, now.fit.accepted[-1].name
    if name not in model.gates or model.library[name].nuisance:
        return now  # all the time it is a recalibrated number
    gates = {n: g for n, g in model.gates.items() if n != name}
    fit = joint_fit_if_finite(replace(model, gates=gates), now.fit.accepted)
    other = fit and weigh(fit, now.ways)
    return other if other and other.evidence > now.evidence - WORTH else now


def _linearised_anew(now: Explanation, nearby: bool = False) -> Explanation:
    """
    Run a simulator where a fit ended, linearise it in all its numbers if far, and fit on.

    Parameters
    ----------
    nearby : bool
        Whether it may have been run there meanwhile, for another explanation.
    """
    model = replace(now.fit.model)
    ran = model.settle(whole=True) or model.settle()
    if not (ran or nearby):
        return now
    model.linearise()
    before = model.log_posterior()
    fit = joint_fit_if_finite(model, now.fit.accepted)
    if fit is None:
        return now
    anew = weigh(fit, now.ways)
    further = ran and fit.model.log_posterior() > before + WORTHWHILE
    return _linearised_anew(anew) if further else anew


def _with_refitted_noise(best: Explanation) -> Explanation:
    """Fit the noise to the residual, and everything beside that noise, linearised there."""
    model = replace(best.fit.model)
    if any(n.name in model.released and n.acts_on == 'rig' for n in model.nuisances):
        model.linearise()  # a wall that is elsewhere bends what all others do
        model = (joint_fit_if_finite(model, best.fit.accepted) or best.fit).model
    model.refit_noise(np.zeros(len(model.nuisances)))
    fit = joint_fit_if_finite(model, best.fit.accepted) or best.fit
    return _linearised_anew(weigh(fit, best.ways))


def _completed(now: Explanation) -> Explanation:
    """Estimate numbers of the newest effect, too, that were left where they do nothing."""
    *others, newest = now.fit.accepted
    found = left_out(now.fit.model, newest.name, newest.theta, newest.free)
    screened = now.fit.comparison().screen(found) if found else []
    if not screened or screened[0].evidence < WORTHWHILE + np.log(len(found)):
        return now
    free = np.union1d(newest.free, screened[0].effect.free)
    fit = joint_fit_if_finite(now.fit.model, [*others, newest._replace(free=free)])
    other = fit and weigh(fit, now.ways)
    return _completed(other) if other and other.evidence > now.evidence + WORTHWHILE else now


def _likeliest(pool: Sequence[Explanation]) -> list[Explanation]:
    """Keep each set of effects once, the likeliest first."""
    out: dict[frozenset[str], Explanation] = {}
    for e in sorted(pool, key=lambda one: -one.score):
        out.setdefault(e.names, e)
    return list(out.values())


def _weighed_beside(start: LinearisedModel, best: Explanation, table: _Table
                    ) -> list[Explanation]:
    """
    Add effects to what is explained, the likeliest linearised where their fits ended.

    Others may fall short of the likeliest only because their simulator was linearised elsewhere.
    That is tested if they fall short by less than the likeliest gains where it is linearised anew.
    """
    known: set[frozenset[str]] = set()
    children = _likeliest(extended(best, table, known))
    if not children:
        return []
    first = children[0]
    rivals = [_linearised_anew(first)]
    gained = rivals[0].evidence - first.evidence
    rivals += [_linearised_anew(one, nearby=True) for one in children[1:]
               if one.evidence > first.evidence - gained]
    children = _likeliest([*rivals, *children])
    return _likeliest([*children, *_exchanged(start, children[0], table, known)])


def search(model: LinearisedModel, found: Sequence[Hypothesis]) -> Posterior:
    """
    Search for the explanations of recordings.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated, no effect accepted.
    found : sequence of Hypothesis
        Effects of the library, as they act all the time.
    """
    table = _Table(model, found)
    start = best = weigh(JointFit(model, [], []))
    features: dict[str, Features] = {}
    alternatives: dict[str, dict[str, float]] = {}
    closest: JointFit | None = None
    for _ in range(2 * MOST_EFFECTS):
        if len(best.names) == MOST_EFFECTS:
            break
        children, likely = _weighed_beside(start.fit.model, best, table), False
        if children:
            chosen, own = _chosen(start.fit.model, children, best)
            likely = chosen.evidence >= best.evidence + WORTH and min(
                map(stored().probability, own.values())) >= NAMED
            if likely or not best.names:
                features, closest = own, None if likely else chosen.fit
                alternatives = {name: _instead(chosen, children, name) for name in chosen.names}
        if likely:
            best = _completed(_with_refitted_noise(chosen))
        elif best.names or (anew := _linearised_anew(best)) is best:
            break
        else:  # what came closest was that to another explanation
            start, best, features, alternatives, closest = anew, anew, {}, {}, None
    return Posterior(best.fit.model, tuple(best.fit.accepted), tuple(best.fit.jacobians),
                     features, alternatives, best.fit.comparison().discrepancy_evidence,
                     {name: instant_of(best.fit, name) for name in best.names
                      if name in best.fit.model.gates}, closest)


def _instead(chosen: Explanation, others: Sequence[Explanation], name: str) -> dict[str, float]:
    """Return the log-evidence of others in the place of an effect, against that one."""
    rest = chosen.names - {name}
    return {next(iter(e.names - rest)): e.evidence - chosen.evidence for e in others
            if rest < e.names and len(e.names) == len(chosen.names) and name not in e.names}


ALIAS_ODDS = 0.05
"""Odds of another effect in the place of an accepted one from which both are listed."""

SEPARATED_BY: Mapping[frozenset[str], str] = {
    frozenset(pair): words for *pair, words in (
        ('wrench_delay', 'wrench_lowpass', 'a faster recording, or a motion up to the corner'),
        ('accel_misalignment', 'wrench_crosstalk', 'the accelerometer at rest'),
        ('tool_com', 'wrench_crosstalk', 'contact at a known place'),
        ('tool_mass', 'wrench_gain', 'a known force'),
        ('base_tilt', 'cable_force', 'a spirit level on the base'),
        ('accel_delay', 'accel_resonance', 'a sweep up to the resonance'),
        ('tool_stiffness', 'tool_damping', 'a sweep about the resonance of the tool'),
        ('contact_stiffness', 'wall_position', 'contacts of several depths'))}
"""Pair of effects, and what separates them."""


def ties_of(found: Posterior) -> tuple[str, ...]:
    """Note the likeliest alias of each accepted effect, if one is about as likely."""
    out = []
    for name, features in found.features.items() if found.closest is None else ():
        odds = stored().odds(features, found.alternatives[name])
        other = max(odds, key=lambda one: odds[one], default='')
        if other and odds[other] > ALIAS_ODDS:
            by = SEPARATED_BY.get(frozenset((name, other)), 'the motion of forcecal plan')
            out.append(f'{name} and {other} are confounded in this recording; they are '
                       f'separated by {by}')
    return tuple(out)


CANDIDATES = 0.95
"""Probability that the candidate set covers."""


def weighed(found: Posterior, is_gap: bool, possible: bool, by: Calibration | None = None
            ) -> tuple[dict[str, float], list[tuple[str, float]]]:
    """
    Return the probability of each effect, and the candidates.

    What was not accepted, and what cannot be the cause as it was found, is a candidate, but never
    likelier than not.

    Parameters
    ----------
    is_gap : bool
        Whether something is unexplained.
    possible : bool
        Whether accepted effects can be the cause: the misfit of held-out data is no larger with
        them, and no number of theirs is at its limit.
    by : Calibration, optional
        Another than the one that diagnoses use.
    """
    by = by or stored()
    named: dict[str, float] = {}
    chosen: list[tuple[str, float]] = []
    accepted = found.closest is None
    most = 1.0 if accepted and possible else NAMED
    for name, features in found.features.items():
        whole = min(most, by.probability(features))
        weight = by.odds(features, found.alternatives[name])
        shares = {k: whole * w / (1.0 + sum(weight.values())) for k, w in weight.items()}
        named[name] = whole - sum(shares.values())
        if accepted or is_gap:
            chosen += _covering({name: named[name], UNKNOWN: 1.0 - whole, **shares})
    if not found.features and is_gap:
        chosen.append((UNKNOWN, 1.0))
    return named, chosen


def _covering(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    ordered = sorted(shares.items(), key=lambda pair: -pair[1])
    covered = accumulate((share for _, share in ordered), initial=0.0)
    return [pair for pair, before in zip(ordered, covered) if before < CANDIDATES]


def listed_once(candidates: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    """List every name once, the most probable first."""
    highest: dict[str, float] = {}
    for name, p in candidates:
        highest[name] = max(p, highest.get(name, 0.0))
    return sorted(highest.items(), key=lambda pair: -pair[1])
