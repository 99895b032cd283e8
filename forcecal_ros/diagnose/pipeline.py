"""From one recording, or a pair, to a diagnosis."""

from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.diagnose import datachecks, remainder
from forcecal_ros.diagnose.case import Case, prepare, SHORTEST, split
from forcecal_ros.diagnose.channels import CHANNELS, COLUMNS
from forcecal_ros.diagnose.gap import Gap
from forcecal_ros.diagnose.hypotheses import hypotheses, Hypothesis, VIBRATION
from forcecal_ros.diagnose.limits import CLIPPING
from forcecal_ros.diagnose.measure import (
    measured_gap,
    parameter_errors,
    sample_noise,
    unpredictable,
)
from forcecal_ros.diagnose.noise import resting
from forcecal_ros.diagnose.nuisances import apply_all
from forcecal_ros.diagnose.parameters import from_checks, parameters_of, seen_in
from forcecal_ros.diagnose.problem import Problem, problem
from forcecal_ros.diagnose.remainder import Ceiling, Cell
from forcecal_ros.diagnose.residual import Measured
from forcecal_ros.diagnose.result import Diagnosis, Found, Parameter
from forcecal_ros.diagnose.selection import select, Selection
from forcecal_ros.diagnose.soundness import check_alike, unseen
from forcecal_ros.diagnose.stamps import corrected
from forcecal_ros.diagnose.verdict import probabilities, Remains, verdict
from forcecal_ros.diagnose.where import Place, places, stage_of
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.samples import Recording
from forcecal_ros.sim.effects import EFFECTS, with_effects
from forcecal_ros.sim.rig import Rig
import numpy as np

VISIBLE = 25.0
"""Whitened energy that a typical size must have in order to be seen."""

WITHOUT_MEAN = ('wrench_quantisation', 'dropouts')
"""Effects that move no signal's mean."""

WANDERING = 0.03
"""Of a vibration's frequency, within which its speed may wander."""

CHECKED = 0.99
"""Probability of an effect of stamps or values: they are found at many sigmas or not at all."""

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
    recalibrated, explained : tuple of ndarray, shape (n, 16)
        Measured less simulated, in block means, of each recording.
    cases : tuple of Case
    noise : ndarray, shape (16,)
        RMS of one sample of each channel.
    """

    diagnosis: Diagnosis
    rig: Rig
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
    if heldout is None:
        cases = [split(cases[0])]
    else:
        cases[1] = replace(cases[1], train=cases[1].held, held=cases[1].train)
    observed = [_observed(c, s.stamped, rig) if s.skew else c.measured
                for c, s in zip(cases, stamps)]
    p = problem(rig, tuple(cases))
    checks = _Checks(*from_checks(stamps, sample_noise(p, np.zeros(len(CHANNELS))),
                                  rig.accelerometer.model(cases[0].replay.accelerometer)))
    known = {name: {k: v.value for k, v in found.items()}
             for name, found in checks.effects.items() if name in CLIPPING}
    first = p
    if known:
        p = replace(p, fixed=known, centre=p.centre.copy())
        p.settle()
        p.recalibrate()
    strongest = max(lines_of(p), key=lambda line: line.power, default=None)
    found = hypotheses(p, strongest.frequency if strongest else None)
    return _conclude(first, p, found, checks, observed)


def _observed(case: Case, recording: Recording, rig: Rig) -> Measured:
    """Take a recording by the stamps that it came with."""
    model = rig.accelerometer.model(case.replay.accelerometer)
    return Measured(recording, case.measured.start, case.measured.n_blocks,
                    np.array(model.gain), np.array(model.offset))


def _conclude(first: Problem, p: Problem, found: list[Hypothesis], checks: '_Checks',
              observed: list[Measured]) -> Outcome:
    selection = select(p, found)
    final = selection.problem
    left = _look(final)
    lines, wanders = _foreign(lines_of(final), final)
    remains = _remains(left, lines, np.asarray(sum(
        remainder.impulses(n, b) for n, b in zip(final.noise, final.blocks))))
    measured, noise = _measured(first, selection, left, observed)
    named = [a.name for a in selection.accepted]
    slots = [(a.name, selection.rivals.get(a.name, {})) for a in selection.accepted]
    shares, candidates = probabilities(slots, remains, measured.closed)
    candidates = sorted([*candidates, *((n, CHECKED) for n in checks.effects)],
                        key=lambda pair: -pair[1])
    excited = excitation(p) > ENOUGH
    word, sentence = verdict([*named, *checks.effects], candidates, remains,
                             measured.closed if named else None, excited or bool(checks.effects))
    sentence += unseen(final.cases[0].recording)
    effects = [Found(a.name, parameters_of(final, a), shares[a.name])
               for a in selection.accepted]
    effects += [Found(n, v, CHECKED) for n, v in checks.effects.items()]
    where = _where(final, selection, left.ceiling, checks)
    if word == 'unknown':
        effects = [Found('unknown', {}, dict(candidates).get('unknown', 0.9))]
        # what is not named is not added to the rig; a gap without a name looks like noise
        final = replace(p, noise=[resting(b, n) for b, n in zip(p.blocks, p.noise)])
        selection = Selection(final, (), (), {}, selection.screened)
        measured, noise = _measured(first, selection, _look(final), observed)
    elif word == 'not_excited':
        effects = []
    diagnosis = Diagnosis(
        word, sentence, tuple(effects), tuple(candidates), where, measured,
        tuple(not_excited(p, found)), (*checks.notes, *wanders),
        {'ceiling_sigma': float(left.ceiling.z.max()), 'cell_sigma': left.strongest[0].z,
         'ratio': remains.ratio})
    return Outcome(diagnosis, patched(final, selection, checks), tuple(first.blocks),
                   tuple(final.blocks), final.cases, noise)


class _Left(NamedTuple):
    """What a problem leaves: its predictable part, and its cells, the strongest first."""

    ceiling: Ceiling
    strongest: list[Cell]


def _look(p: Problem) -> _Left:
    cells = [c for case, n, b in zip(p.cases, p.noise, p.blocks)
             for c in remainder.cells(case, n, b)]
    return _Left(remainder.ceiling(p, p.base, p.blocks), sorted(cells, key=lambda c: -c.z))


def _measured(first: Problem, selection: Selection, left: _Left, observed: list[Measured]
              ) -> tuple[Gap, Array]:
    """Return the gap in its three arms, and the noise of one sample of every channel."""
    final = selection.problem
    predictable = [_predictable(left.ceiling, i) for i in range(len(final.cases))]
    errors = parameter_errors(final, selection.tangents)
    energy = unpredictable(final, left.strongest, predictable)
    nameless = energy if not selection.accepted else 0.0
    noise = sample_noise(final, errors.expected() + nameless, predictable)
    before = [o.blocks(s) for o, s in zip(observed, first.base)]
    nominal = [o.blocks(c.nominal) for o, c in zip(observed, first.cases)]
    return measured_gap(first, final, (nominal, before, predictable), noise, energy, errors
                        ), noise


@dataclass(frozen=True)
class _Checks:
    """What the data say before any model, as effects and notes."""

    effects: dict[str, dict[str, Parameter]]
    notes: tuple[str, ...]


def lines_of(p: Problem) -> tuple[datachecks.Line, ...]:
    """
    Find spectral lines at the full rate in what remains.

    Parameters
    ----------
    p : Problem

    Returns
    -------
    tuple of Line
    """
    lines: list[datachecks.Line] = []
    for case, signals in zip(p.cases, p.base):
        for name in ('wrench', 'accelerometer', 'optidrive'):
            if name in case.measured.streams:
                rows = case.measured.samples(name, signals)
                lines += datachecks.lines(rows, getattr(case.recording, name).rate, name)
    return tuple(lines)


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
    values = {n.name: float(c * s) for n, c, s in zip(p.nuisances, p.centre, p.sizes)
              if n.name not in p.released}
    effects = {a.name: {k: v.value for k, v in parameters_of(p, a).items()}
               for a in selection.accepted}
    effects.update({n: {k: v.value for k, v in found.items()}
                    for n, found in checks.effects.items()})
    rig = apply_all(p.rig, p.nuisances, values)
    return with_effects(rig, effects) if effects else rig


def _remains(left: _Left, lines: tuple[datachecks.Line, ...], impulses: Array) -> Remains:
    ceiling, cell = left.ceiling, left.strongest[0]
    z = np.where(ceiling.size > remainder.SMALL, ceiling.z, 0.0)
    c = int(z.argmax())
    several = int(impulses.max())
    line = max(lines, key=lambda one: one.power, default=None)
    options = [
        (float(z[c]) / remainder.PREDICTABLE,
         f'{CHANNELS[c].name}, predictable from the motion ({z[c]:.1f} sigma)'),
        (cell.z / remainder.STRONG,
         f'{CHANNELS[cell.channel].name} in {cell.phase}, {cell.band[0]:g} to '
         f'{cell.band[1]:g} Hz ({cell.z:.1f} sigma)'),
        (several / remainder.IMPULSES,
         f'{several} impulses in {CHANNELS[int(impulses.argmax())].name}')]
    if line is not None:
        options.append((line.power / datachecks.LINE,
                        f'a line at {line.frequency:.2f} Hz in {line.channel}'))
    return Remains(*max(options))


def _foreign(lines: tuple[datachecks.Line, ...], p: Problem
             ) -> tuple[tuple[datachecks.Line, ...], tuple[str, ...]]:
    """Take off the lines beside that of a vibration that is explained, and note them."""
    speed = p.effects.get(VIBRATION, {}).get('frequency', np.inf)
    others = tuple(x for x in lines if abs(x.frequency - speed) > WANDERING * speed)
    note = f'{VIBRATION}: its speed wanders about {speed:.2f} Hz; one speed explains a part of it'
    return others, (note,) if len(others) < len(lines) else ()


def _predictable(ceiling: Ceiling, case: int) -> Array:
    real = (ceiling.z > remainder.PREDICTABLE) & (ceiling.size > remainder.SMALL)
    return np.where(real, ceiling.prediction[case], 0.0)


def _where(final: Problem, selection: Selection, ceiling: Ceiling, checks: '_Checks'
           ) -> tuple[Place, ...]:
    before = final.without_effects().blocks
    differences = [b - a + _predictable(ceiling, i)
                   for i, (b, a) in enumerate(zip(before, final.blocks))]
    stages = {EFFECTS[n].stage for n in (*(a.name for a in selection.accepted), *checks.effects)}

    def stage(channel: str, phase: str, touched: set[str]) -> str:
        return next(iter(stages)) if len(stages) == 1 else stage_of(channel, phase, touched)

    sensors = [[c for n, c in zip(final.nuisances, columns) if n.where != 'rig']
               for columns in final.columns]
    found = places(final.cases, final.noise, before, differences, stage, sensors)
    phase = max(final.cases[-1].phases, key=lambda one: one.end - one.start).name
    shown = tuple(Place(EFFECTS[n].stage, seen_in(n, v), phase, remainder.BANDS[-1],
                        max(q.value for q in v.values()), 0.0)
                  for n, v in checks.effects.items() if n in WITHOUT_MEAN)
    return (*shown, *found)


def excitation(p: Problem) -> float:
    """
    Say how much the motion moves the signal that it moves most.

    Parameters
    ----------
    p : Problem

    Returns
    -------
    float
        RMS about the mean over the rig's noise, of wrench and specific force.
    """
    most = 0.0
    for case in p.cases:
        for name, signal in (('wrench', case.nominal.wrench), ('accelerometer',
                                                               case.nominal.volts)):
            if name in case.measured.streams:
                noise = 2.0 * p.level[COLUMNS[name]]
                most = max(most, float((signal.std(axis=0) / noise).max()))
    return most


def not_excited(p: Problem, found: list[Hypothesis]) -> list[str]:
    """
    List the effects of the library that these recordings could not show at a typical size.

    Parameters
    ----------
    p : Problem
    found : list of Hypothesis

    Returns
    -------
    list of str
    """
    m = len(p.nuisances)
    extra = [[c for h in found for a in h.atoms[:1] for c in a.columns[i]]
             for i in range(len(p.cases))]
    train, held = p.grams(extra)
    energy = np.diag(train.matrix) + np.diag(held.matrix)
    visible, position = set(), m
    for h in found:
        if h.releases:
            index = [i for i, n in enumerate(p.nuisances) if n.name in h.releases[0]]
            best = 9.0 * max(energy[i] for i in index)
        else:
            k = len(h.atoms[0].free)
            best, position = max(energy[position:position + k]), position + k
        if best > VISIBLE:
            visible.add(h.name)
    return [h.name for h in found if h.name not in visible]

