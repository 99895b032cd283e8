"""From a recording without commands to a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.gap import Gap
from forcecal_ros.diagnose.motion.arms import Arms, SLOW
from forcecal_ros.diagnose.motion.case import held_apart, MotionCase, SHORTEST
from forcecal_ros.diagnose.motion.fitting import Fitting, RIVAL, ROUNDS, SCAN, Trial, USUAL
from forcecal_ros.diagnose.motion.known import Known
from forcecal_ros.diagnose.motion.model import DELAYS, terms_of, WRENCH_AXES
from forcecal_ros.diagnose.pairing import check_alike, require_overlap
from forcecal_ros.diagnose.result import Diagnosis, Found, Parameter
from forcecal_ros.diagnose.verdict import doubt, UNKNOWN
from forcecal_ros.diagnose.where import places
from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array
from forcecal_ros.recording.checks.entry import checked
from forcecal_ros.recording.noise.autoregression import fit_autoregression
from forcecal_ros.recording.streams import Recording
import numpy as np

VISIBLE = 25.0
"""Whitened energy that a typical size must have in order to be seen."""

SOUND = 2.0
"""What is left in some channel, in RMS of the noise at rest, from which it is a gap."""

STAGES = {'tool_mass': 'tool', 'tool_com': 'tool', 'inertial_force': 'tool',
          'base_tilt': 'robot'}
"""Of effects that are not the sensor's own."""


@dataclass(frozen=True)
class MotionOutcome:
    """
    A diagnosis from measured motion and what it rests on.

    Attributes
    ----------
    diagnosis : Diagnosis
        Its gap is that of slow motion, in which a tool is rigid.
    values : dict of str to float
        Departures from what was known, by term.
    full : Gap or None
        At all frequencies up to 125 Hz.
    arms : Arms or None
    delay_std : float or None
        Standard error of the delay between the sensors [s]; None where neither a delay nor an
        inertial force was found, which tells it.
    """

    diagnosis: Diagnosis
    values: dict[str, float] = field(default_factory=dict)
    full: Gap | None = None
    arms: Arms | None = None
    delay_std: float | None = None


def diagnose_motion(recording: Recording, heldout: Recording | None, known: Known
                    ) -> MotionOutcome:
    """
    Find out why a wrench is not what the measured motion says.

    Parameters
    ----------
    recording : Recording
        To fit on.
    heldout : Recording or None
        To judge on; every other second of ``recording`` where none is given.
    known : Known

    Returns
    -------
    MotionOutcome
        Data that cannot answer come out as such, with the reason.
    """
    try:
        given = [r for r in (recording, heldout) if r is not None]
        check_alike(given)
        usable = [checked(r).recording for r in given]
        for one in usable:
            require_overlap(one, 'pose', SHORTEST)
        cases = [MotionCase(one, known) for one in usable]
        if heldout is not None:
            cases = list(held_apart(*cases))
        if not all(c.present[c.groups == 1].any() for c in cases):
            return MotionOutcome(Diagnosis('not_excited', 'the robot does not move; record a '
                                           'motion that turns the tool and speeds it up'))
    except DataError as error:
        return MotionOutcome(Diagnosis('invalid_data', str(error)))
    state = Fitting(cases, terms_of(known, cases[0]))
    state.learn_noise()
    state.values, _ = state.refine([], {})
    state.settle()
    recalibrated = state.values
    _select(state)
    notes = [n for one, r in zip(usable, given) for n in one.notes[len(r.notes):]]
    return _conclude(state, recalibrated, notes)


def _candidates(state: Fitting) -> list[tuple[tuple[str, ...], list[dict[str, float]]]]:
    effects = [*dict.fromkeys(t.effect for t in state.terms if not t.axis), *state.promising()]
    moving = state.cases[0].known.dynamic or 'inertial_force' in state.accepted
    out: list[tuple[tuple[str, ...], list[dict[str, float]]]] = []
    for name in effects:
        if name in state.accepted:
            continue
        if name in DELAYS:
            if name == 'wrench_delay' or moving:
                out.append(((name,), [{name: float(d)} for d in SCAN]))
        elif name == 'inertial_force':
            out.append(((name,), [{'inertial': 1.0}]))
            if 'accel_delay' in effects:
                out.append(((name, 'accel_delay'), [
                    {'inertial': x, 'accel_delay': float(d)} for x, d in product([1.0], SCAN)]))
        else:
            out.append(((name,), [{}]))
    return out


def _select(state: Fitting) -> None:
    """Add what helps most until nothing does, then drop what the others have made needless."""
    for _ in range(ROUNDS):
        trials = [state.trial(e, s) for e, s in _candidates(state)]
        needed = [t for t in trials if t.needed]
        if not needed:
            break
        best = max(needed, key=lambda t: t.score.removed / len(t.effects) ** 0.5)
        state.accepted += best.effects
        state.rivals |= _rivals(best, [t for t in trials if t.possible])
        if not set(best.effects) <= set(USUAL):
            state.relearn_noise()
        state.values, _ = state.refine(state.accepted, best.values)
        state.settle()
    for name in list(state.accepted):
        needs_it = name == 'inertial_force' and 'accel_delay' in state.accepted
        if not needs_it and not _without(state, [name]).needed:
            state.accepted.remove(name)
            state.values, _ = state.refine(state.accepted, _kept(state, [name]))
            state.settle()


def _rivals(best: Trial, others: list[Trial]) -> dict[str, str]:
    """Return effects of an axis that would do about as well, and what was taken instead."""
    chosen = best.terms[0]
    return {t.terms[0].effect: chosen.effect for t in others
            if chosen.axis and t.terms[0].axis and t.terms[0].effect != chosen.effect
            and t.score.removed > best.score.removed - RIVAL}


def _without(state: Fitting, parts: list[str]) -> Trial:
    """Judge what is accepted against what the rest of it explains."""
    rest = [e for e in state.accepted if e not in parts]
    other = Fitting(state.cases, state.terms, rest, noise=state.noise)
    other.values, _ = other.refine(rest, _kept(state, parts))
    other.residual = other.residuals(other.values)
    return Trial(tuple(parts), state.values, state.terms_in(parts), *other.judged(state.values))


def _kept(state: Fitting, parts: list[str]) -> dict[str, float]:
    """Return the values without those of some parts; nuisances start anew."""
    own = {t.name for t in state.terms if t.part in parts}
    return {k: v for k, v in state.values.items() if k not in own}


def _found(state: Fitting) -> dict[str, list[str]]:
    """Return the effects that are accepted, and which parts of each."""
    parts: dict[str, list[str]] = {}
    for part in state.accepted:
        parts.setdefault(part.split('.')[0], []).append(part)
    return parts


def _conclude(state: Fitting, recalibrated: dict[str, float], notes: list[str]
              ) -> MotionOutcome:
    cases = tuple(state.cases)
    arms = Arms.of(cases, {}, recalibrated, state.values)
    measured, full = arms.gap(slow=True), arms.gap(slow=False)
    ratio, left = arms.left()
    wanting = state.wanting() if ratio > SOUND else 0.0
    effects = [Found(name, _parameters(state, name), _probability(_without(state, parts), wanting))
               for name, parts in _found(state).items()]
    word, sentence = _verdict(state, measured, ratio, left)
    invisible = _not_excited(state)
    notes = notes + [f'{name}: the offset from what was known is {mean:+.3g} {unit}'
                     for name, mean, unit in arms.offsets()]
    difference = [before - after for before, after in zip(arms.recalibrated, arms.explained)]
    noise = [fit_autoregression(r, c.present, c.groups) for c, r in zip(cases, arms.explained)]
    found = places(cases, noise, list(arms.recalibrated), difference, _stage(state))
    rivals = {name: other for name, other in state.rivals.items()
              if other in _found(state) and name not in _found(state)}
    share = {e.name: 1.0 + sum(e.name == other for other in rivals.values()) for e in effects}
    candidates = [(e.name, e.probability / share[e.name]) for e in effects]
    candidates += [(name, e.probability / share[e.name]) for name, other in rivals.items()
                   for e in effects if e.name == other]
    sentence += ''.join(f'; {name} explains about as much as {other}'
                        for name, other in rivals.items())
    if ratio > SOUND:
        candidates.append((UNKNOWN, 1.0 - SOUND / ratio))
    candidates.sort(key=lambda pair: -pair[1])
    diagnosis = Diagnosis(word, sentence, tuple(effects), tuple(candidates), found, measured,
                          tuple(invisible), tuple(notes), {'ratio': ratio})
    return MotionOutcome(diagnosis, dict(state.values), full, arms, _delay_std(state))


def _probability(trial: Trial, wanting: float) -> float:
    """Of an effect: that it is significant, and no part of what no effect explains."""
    return trial.probability * (1.0 - doubt(0.5 * trial.score.removed, wanting))


def _delay_std(state: Fitting) -> float | None:
    """Return the standard error of the accelerometer's delay behind the wrench [s]."""
    tells = {'accel_delay', 'wrench_delay', 'inertial_force'} & set(state.accepted)
    if not tells or not state.terms_in(['accel_delay']):
        return None
    effects = list(dict.fromkeys([*state.accepted, 'accel_delay']))
    _, found = state.refine(effects, state.values, steps=1)
    signs = {'accel_delay': 1.0, 'wrench_delay': -1.0}
    row = np.array([signs.get(t.name, 0.0) * t.unit_size for t in state.free(effects)])
    return float(np.sqrt(row @ found.covariance @ row))


def _parameters(state: Fitting, name: str) -> dict[str, Parameter]:
    free = state.free(state.accepted)
    _, found = state.refine(state.accepted, state.values)
    std = dict(zip((t.name for t in free), np.sqrt(np.diag(found.covariance))))
    return {t.quantity: Parameter(state.values.get(t.name, 0.0),
                                  float(std[t.name]) * t.unit_size, t.unit)
            for t in free if t.effect == name}


def _stage(state: Fitting) -> Callable[[str, str, set[str]], str]:
    stages = {STAGES.get(name, 'accelerometer' if name.startswith('accel') else 'wrench_sensor')
              for name in _found(state)}

    def stage(channel: str, phase: str, touched: set[str]) -> str:
        own = next(c.stage for c in CHANNELS if c.name == channel)
        return next(iter(stages)) if len(stages) == 1 else own

    return stage


def _verdict(state: Fitting, measured: Gap, ratio: float, left: str) -> tuple[str, str]:
    if not state.accepted:
        if ratio < SOUND:
            return 'no_gap', 'wrench and motion agree down to the noise'
        return 'unknown', f'no effect explains the gap between wrench and motion: {left}'
    names = list(_found(state))
    explain = 'explain' if len(names) > 1 else 'explains'
    share = (f'{" and ".join(names)} {explain} {100.0 * measured.closed:.0f} % of the misfit '
             f'below {SLOW:g} Hz')
    if ratio < SOUND:
        return 'identified', share
    return 'partial', f'{share}; unexplained: {left}'


def _not_excited(state: Fitting) -> list[str]:
    energy: dict[str, float] = {}
    for term, value in zip(state.terms, state.energies(state.terms)):
        energy[term.effect] = max(energy.get(term.effect, 0.0), float(value))
    return [name for name, value in energy.items() if value < VISIBLE]


def patched(calibration: Calibration, outcome: MotionOutcome) -> Calibration:
    """
    Give a calibration what was found: biases, mass, centre of mass, delay.

    A delay with its standard error is also what says that the tool was seen in motion.
    """
    c, a, values = calibration, calibration.accelerometer, outcome.values

    def of(name: str, axes: Sequence[str]) -> Array:
        return np.array([values.get(f'{name}.{axis}', 0.0) for axis in axes])

    mass = float(c.mass) + values.get('mass', 0.0)
    com = c.com.value + of('moment', 'xyz') / mass
    bias = c.wrench_bias.value + of('bias', WRENCH_AXES)
    if a is not None:
        delay = float(a.delay) + values.get('accel_delay', 0.0) - values.get('wrench_delay', 0.0)
        offset = a.offset.value + a.matrix @ of('accel', 'xyz')
        std = a.delay.std if outcome.delay_std is None else outcome.delay_std
        a = replace(a, delay=Estimate(delay, std, 's'),
                    offset=Estimate(offset, a.offset.std, a.offset.unit))
    return replace(
        c, mass=Estimate(mass, c.mass.std, 'kg'), com=Estimate(com, c.com.std, 'm'),
        wrench_bias=Estimate(bias, c.wrench_bias.std, c.wrench_bias.unit), accelerometer=a)
