"""From one recording, or a pair, to a diagnosis."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from forcecal_ros.diagnose import steps
from forcecal_ros.diagnose.case import (
    Case,
    held_apart,
    in_volts,
    prepare,
    SHORTEST,
    split,
    without_touches,
)
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.discrepancy import NONE
from forcecal_ros.diagnose.gap import Gap
from forcecal_ros.diagnose.hypotheses import hypotheses, Hypothesis
from forcecal_ros.diagnose.left import (
    fitted_to_all,
    Left,
    lines_of,
    look,
    predictable,
    remains,
    WANDERING,
)
from forcecal_ros.diagnose.limits import CLIPPING
from forcecal_ros.diagnose.measure import (
    measured_gap,
    parameter_errors,
    sample_noise,
    unpredictable,
)
from forcecal_ros.diagnose.nuisances import apply_all
from forcecal_ros.diagnose.pairing import check_alike, unseen
from forcecal_ros.diagnose.parameters import from_checks, parameters_of, seen_in
from forcecal_ros.diagnose.problem import Problem, problem
from forcecal_ros.diagnose.remainder import BANDS, Ceiling
from forcecal_ros.diagnose.residual import Measured
from forcecal_ros.diagnose.result import Diagnosis, Found, Parameter
from forcecal_ros.diagnose.selection import select, Selection
from forcecal_ros.diagnose.spectral_lines import Line
from forcecal_ros.diagnose.stamps import Corrected, corrected
from forcecal_ros.diagnose.steps import Event, with_steps
from forcecal_ros.diagnose.usage import refuse_unjudged, shares, unjudged
from forcecal_ros.diagnose.verdict import doubt, probabilities, verdict
from forcecal_ros.diagnose.visibility import excitation, not_excited
from forcecal_ros.diagnose.where import Place, places, stage_of
from forcecal_ros.effects import EFFECTS, with_effects
from forcecal_ros.effects.rig import Rig
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.noise.autoregression import at_standstill
from forcecal_ros.recording.streams import Recording
import numpy as np

WITHOUT_MEAN = ('wrench_quantisation', 'dropouts')
"""Effects that move no signal's mean."""

CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""

FAINT = 1e-3
"""Probability below which an effect that a discrepancy may only look like is not listed."""

NO_WALL = ('phases that touch something are left out, as the rig has no wall within reach; write '
           'where it is into the rig to have them compared')

LINES = 2
"""Lines that a discrepancy may have: mains and a motor."""

ENOUGH = 3.0
"""Scatter of a simulated signal, in its noise, from which a recording can answer."""


@dataclass(frozen=True)
class Outcome:
    """
    A diagnosis and what it rests on.

    Attributes
    ----------
    diagnosis : Diagnosis
    rig : Rig
        Recalibrated, with the effects.
    recalibrations : dict of str to (float, float)
        Nuisance -> how far it moved, and its standard error; relative where its spread is.
    recalibrated, explained : tuple of ndarray, shape (n, channels)
        Measured less simulated, in block means, of each recording.
    cases : tuple of Case
    noise : ndarray, shape (channels,)
        RMS of one sample of each channel.
    """

    diagnosis: Diagnosis
    rig: Rig
    recalibrations: dict[str, tuple[float, float]] = field(default_factory=dict)
    recalibrated: tuple[Array, ...] = ()
    explained: tuple[Array, ...] = ()
    cases: tuple[Case, ...] = ()
    noise: Array | None = None


def diagnose(recording: Recording, heldout: Recording | None, rig: Rig,
             accelerometer: str | None = None) -> Outcome:
    """
    Find out where, why and how far a recording departs from a rig.

    Parameters
    ----------
    recording : Recording
        To fit on.
    heldout : Recording or None
        To judge on; parts of ``recording`` are held out where none is given.
    rig : Rig
    accelerometer : str, optional
        ``acc1`` or ``acc2``; recognised where none is given.

    Returns
    -------
    Outcome
        Data that cannot answer come out as such, with the reason.
    """
    given = [recording] if heldout is None else [recording, heldout]
    try:
        check_alike(given)
        stamps = [corrected(r, rig, SHORTEST) for r in given]
        cases = [prepare(s.recording, rig, accelerometer) for s in stamps]
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rig)
    left_out = [without_touches(case, rig) for case in cases]
    ready = held_apart(*cases) if len(cases) > 1 else (split(cases[0]),)
    outcome = answered(rig, ready, stamps, given)
    if not any(left_out):
        return outcome
    return replace(outcome, diagnosis=replace(
        outcome.diagnosis, notes=(NO_WALL, *outcome.diagnosis.notes)))


def answered(rig: Rig, cases: tuple[Case, ...], stamps: Sequence[Corrected],
             given: Sequence[Recording]) -> Outcome:
    """
    Diagnose recordings that are ready.

    Parameters
    ----------
    rig : Rig
    cases : tuple of Case
        To fit on and to judge on.
    stamps : sequence of Corrected
        What their stamps and values show.
    given : sequence of Recording
        As recorded.
    """
    observed = [_observed(c, s.stamped, rig) if s.skew else c.measured
                for c, s in zip(cases, stamps)]
    p = problem(rig, cases)
    try:
        refuse_unjudged(p)
    except DataError as error:
        return Outcome(Diagnosis('invalid_data', str(error)), rig)
    checks = _Checks(*from_checks(stamps, sample_noise(p, np.zeros(len(CHANNELS))),
                                  rig.accelerometer.model(cases[0].simulation.accelerometer)))
    known = {name: {k: v.value for k, v in found.items()}
             for name, found in checks.effects.items() if name in CLIPPING}
    first = p
    if known:
        p = replace(p, fixed=known, centre=p.centre.copy())
        p.settle()
        p.recalibrate()
    p, events = with_steps(p)
    frequencies = _strongest(lines_of(p))
    if frequencies:
        p.allow_discrepancy(frequencies)
        p.refit_noise(np.zeros(len(p.nuisances)))
    found = hypotheses(p, frequencies[0] if frequencies else None)
    outcome = _conclude(first, p, found, checks, observed, events)
    return replace(outcome, diagnosis=replace(outcome.diagnosis, used=shares(p, given)))


def _strongest(lines: Sequence[Line]) -> list[float]:
    """Return the frequencies of the strongest lines, those of one and the same line once."""
    out: list[float] = []
    for line in sorted(lines, key=lambda one: -one.power):
        if all(abs(line.frequency - f) > WANDERING * f for f in out):
            out.append(line.frequency)
    return out[:LINES]


def _observed(case: Case, recording: Recording, rig: Rig) -> Measured:
    """Take a recording by the stamps that it came with."""
    if 'joints' not in case.measured.streams:
        recording = replace(recording, joints=None)
    return Measured(in_volts(recording, rig, case.simulation.accelerometer),
                    case.measured.start, case.measured.n_blocks)


def _conclude(first: Problem, p: Problem, found: list[Hypothesis], checks: '_Checks',
              observed: list[Measured], events: tuple[Event, ...]) -> Outcome:
    selection = select(p, found, first)
    final = selection.problem
    left = look(fitted_to_all(final, selection.tangents), selection.unnamed)
    rest = remains(left)
    measured, noise = _measured(first, selection, left, observed)
    named = [a.name for a in selection.accepted]
    slots = [(a.name, selection.rivals.get(a.name, {})) for a in selection.accepted]
    stepped = steps.found(final, events)
    sudden = {e.name: e.probability for e in stepped}
    doubts = {n: doubt(lead, selection.wanting) for n, lead in selection.leads.items()
              } if final.allowed != NONE else None
    shares, candidates = probabilities(slots, rest, measured.closed, len(p.fixed) + len(sudden),
                                       doubts)
    candidates = sorted([*candidates, *sudden.items(), *((n, CHECKED) for n in checks.effects)],
                        key=lambda pair: -pair[1])
    excited = excitation(p) > ENOUGH or bool(checks.effects) or bool(stepped)
    word, sentence = verdict([*named, *sudden, *checks.effects], candidates, rest,
                             measured.closed if named or p.fixed or sudden else None, excited,
                             whole=not unjudged(p), allowed=final.allowed != NONE)
    possible = {n: 1.0 - doubt(lead, selection.wanting)
                for n, lead in selection.doubtful.items()}
    candidates = sorted([*candidates, *((n, p) for n, p in possible.items() if p > FAINT)],
                        key=lambda pair: -pair[1])
    sentence += steps.in_words(stepped) + unseen(final.cases[0].recording) + unjudged(p)
    effects = [Found(a.name, parameters_of(final, a), shares[a.name])
               for a in selection.accepted]
    effects += [*stepped, *(Found(n, v, CHECKED) for n, v in checks.effects.items())]
    where = _where(final, selection, left.ceiling, checks)
    if word in ('unknown', 'not_excited'):
        # what is not named is not added to the rig; a gap without a name looks like noise
        final = replace(p, noise=[at_standstill(b, n) for b, n in zip(p.blocks, p.noise)])
        selection = Selection(final, (), (), {}, selection.screened)
        measured, noise = _measured(first, selection, look(final), observed)
        effects = [Found('unknown', {}, dict(candidates).get('unknown', 0.9))]
    if word == 'not_excited':
        effects, candidates = [], []
    diagnosis = Diagnosis(
        word, sentence, tuple(effects), tuple(candidates), where, measured,
        tuple(not_excited(p, found)), (*checks.notes, *left.notes),
        {'ceiling_sigma': float(left.ceiling.z.max()), 'cell_sigma': left.strongest[0].z,
         'ratio': rest.ratio})
    return Outcome(diagnosis, patched(final, selection, checks), _moved(final),
                   tuple(first.blocks),
                   tuple(final.blocks), final.cases, noise)


def _measured(first: Problem, selection: Selection, left: Left, observed: list[Measured]
              ) -> tuple[Gap, Array]:
    """Return the gap in its three arms, and the noise of one sample of every channel."""
    final = selection.problem
    moved = [predictable(left.ceiling, i) for i in range(len(final.cases))]
    errors = parameter_errors(final, selection.tangents)
    energy = unpredictable(final, left.strongest, moved)
    nameless = energy if not selection.accepted else 0.0
    noise = sample_noise(final, errors.expected() + nameless, moved)
    before = [o.blocks(s) for o, s in zip(observed, first.base)]
    nominal = [o.blocks(c.nominal) for o, c in zip(observed, first.cases)]
    return measured_gap(first, final, (nominal, before, moved), noise, energy, errors
                        ), noise


def _moved(p: Problem) -> dict[str, tuple[float, float]]:
    std = np.sqrt(np.diag(p.fit_nuisances().covariance))
    return {n.name: (float(x * size), float(s * size)) for n, x, s, size in zip(
        p.nuisances, p.centre, std, p.sizes)}


@dataclass(frozen=True)
class _Checks:
    """What the data say before any model, as effects and notes."""

    effects: dict[str, dict[str, Parameter]]
    notes: tuple[str, ...]


def patched(p: Problem, selection: Selection, checks: '_Checks') -> Rig:
    """
    Recalibrate the rig and give it the effects, those that share a nuisance by their own name.

    Parameters
    ----------
    p : Problem
        At the joint fit.
    selection : Selection
    checks : _Checks

    Returns
    -------
    Rig
    """
    # a simulator's own number stays one of the rig, however far it moved
    own = {n.key for n in p.nuisances if n.spread is not None}
    values = {n.name: float(c * s) for n, c, s in zip(p.nuisances, p.centre, p.sizes)
              if n.name not in p.released or n.key in own}
    effects = {a.name: {k: v.value for k, v in parameters_of(p, a).items()}
               for a in selection.accepted if p.library[a.name].nuisance not in own}
    effects.update({n: {k: v.value for k, v in found.items()}
                    for n, found in checks.effects.items()})
    return with_effects(apply_all(p.rig, p.nuisances, values), effects)


def _where(final: Problem, selection: Selection, ceiling: Ceiling, checks: '_Checks'
           ) -> tuple[Place, ...]:
    before = final.without_effects().blocks
    differences = [b - a + predictable(ceiling, i)
                   for i, (b, a) in enumerate(zip(before, final.blocks))]
    stages = {final.library[n].stage
              for n in (*(a.name for a in selection.accepted), *checks.effects)}
    if any(n.where == 'step' for n in final.nuisances):
        stages.add('wrench_sensor')

    def stage(channel: str, phase: str, touched: set[str]) -> str:
        return next(iter(stages)) if len(stages) == 1 else stage_of(channel, phase, touched)

    sensors = [[c for n, c in zip(final.nuisances, columns) if n.where in ('wrench', 'volts')]
               for columns in final.columns]
    found = places(final.cases, final.noise, before, differences, stage, sensors)
    phase = max(final.cases[-1].phases, key=lambda one: one.end - one.start).name
    shown = tuple(Place(EFFECTS[n].stage, seen_in(n, v), phase, BANDS[-1],
                        max(q.value for q in v.values()), 0.0)
                  for n, v in checks.effects.items() if n in WITHOUT_MEAN)
    return (*shown, *found)
