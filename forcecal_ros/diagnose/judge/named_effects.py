"""Effects found, in the library's own parameters."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.checks.clocks import JITTER
from forcecal_ros.checks.signals import clipped, quantisation
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.quantity import HALF, pair, quantity
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.gates import BIAS, kind_of, nuisances_of, physical
from forcecal_ros.diagnose.model.hypotheses import CLIPPING
from forcecal_ros.diagnose.model.linearised import EFFECT, LinearisedModel, RELEASED
from forcecal_ros.diagnose.recordings import Corrected
from forcecal_ros.diagnose.search.change_points import Instant
from forcecal_ros.diagnose.search.model_comparison import Accepted
from forcecal_ros.effects import EFFECTS, Quantity
from forcecal_ros.effects.library import FORCES
from forcecal_ros.effects.nuisances import Nuisance
from forcecal_ros.effects.rig import AccelerometerModel
import numpy as np

AT_BOUND = 'at its bound'
"""What is said of a number where else its standard error stands."""

AT_LIMIT, KNOWN = 0.01, 3.0
"""A number nearer than this to the end of its range, as a share of the range, stands there, if it
is more than so many standard errors: one that nothing shows may stand anywhere."""


MAX_RELATIVE_STD = 0.5
"""Standard error of a number, in its prior's, from which it is not identified."""


@dataclass(frozen=True)
class Parameter:
    """
    One estimated number of an effect.

    Attributes
    ----------
    at_bound : bool
        It stands at the end of its range, so that its standard error says nothing.
    nominal : float, optional
        What the model has, of a number of a third-party simulator.
    """

    value: float
    std: float
    unit: str
    at_bound: bool = False
    nominal: float | None = None


@dataclass(frozen=True)
class NamedEffect:
    """
    An effect that the verdict names.

    Attributes
    ----------
    begin, end : float, optional
        When it began and ended [s]; it was there from the start, or to the end, where none is
        given.
    recording : int, optional
        In which it began or ended, or acted alone.
    """

    name: str
    parameters: dict[str, Parameter]
    probability: float
    begin: float | None = None
    begin_ci95: tuple[float, float] | None = None
    recording: int | None = None
    end: float | None = None
    end_ci95: tuple[float, float] | None = None


class Checks(NamedTuple):
    """What the data say before any model, as effects and notes."""

    effects: dict[str, dict[str, Parameter]]
    notes: tuple[str, ...]


def estimated(value: float, std: float, unit: str, *, signed: bool = False) -> str:
    """Write an estimate, or that it is at its bound, where it has no standard error."""
    text = quantity(value, std, unit, signed=signed).strip()
    return text if std else f'{text} ({AT_BOUND})'


def parameters_of(model: LinearisedModel, a: Accepted) -> dict[str, Parameter]:
    """
    Name the numbers of an accepted effect.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit.

    Returns
    -------
    dict of str to Parameter
        A released nuisance's is its whole departure from the rig as given, within its limits.
        Without those that are not identified: their standard error is the prior's.
    """
    effect = model.library[a.name]
    quantities = effect.parameters
    if len(a.theta):
        widest = MAX_RELATIVE_STD / np.sqrt(EFFECT)
        return {q.name: Parameter(float(v), float(s), q.unit, ends(q, float(v)))
                for q, v, s in zip(quantities, a.theta, a.std)
                if q.shapes or s < widest * abs(q.typical - q.nominal) or ends(q, float(v))}
    out, covariance = {}, model.nuisance_covariance()
    for i, q in zip(nuisances_of(model.nuisances, effect), quantities):
        if model.nuisances[i].name not in a.released:
            out[q.name] = Parameter(q.nominal, 0.0, q.unit)
            continue
        if covariance[i, i] > MAX_RELATIVE_STD ** 2 / RELEASED:
            continue
        scale = float(model.prior_std[i]) * physical(
            model.rig, model.nuisances[i].key, q.unit)
        value = np.clip(q.nominal + model.centre[i] * scale, q.low, q.high)
        std = abs(scale) * float(np.sqrt(covariance[i, i]))
        out[q.name] = Parameter(float(value), std, q.unit,
                                ends(q, float(value)) or (std == 0.0 and value != q.nominal))
    return out


def not_identified(model: LinearisedModel, a: Accepted) -> tuple[str, ...]:
    """Note the numbers of an accepted effect that the recording does not identify."""
    own = parameters_of(model, a)
    missing = [q.name for q in model.library[a.name].parameters if q.name not in own]
    return (f'{a.name}: this motion does not identify {", ".join(missing)}',) if missing else ()


def ends(q: Quantity, value: float) -> bool:
    """Say whether a number stands at an end of its range, and not where it does nothing."""
    return value != q.nominal and not q.low < value < q.high


def at_limit(name: str, found: Mapping[str, Parameter]) -> list[str]:
    """
    Name the numbers of an effect that stand at a limit of the library.

    Returns
    -------
    list of str
        ``wrench_gain.fx = -0.9``; empty for effects that are no tolerance of a rig.
    """
    out: list[str] = []
    if name not in EFFECTS or EFFECTS[name].nuisance is None:
        return out
    for q in EFFECTS[name].parameters:
        p = found.get(q.name)
        if p is None or q.shapes or abs(p.value - q.nominal) <= KNOWN * p.std:
            continue
        if any(end != q.nominal and abs(p.value - end) <= AT_LIMIT * abs(end - q.nominal)
               for end in (q.low, q.high)):
            out.append(f'{name}.{q.name} = {p.value:.3g}{"" if q.unit == "1" else " " + q.unit}')
    return out


def at_tolerance(model: LinearisedModel) -> list[Nuisance]:
    """List the numbers that would be further off if their tolerances let them."""
    # within a thousandth, by rounding; a released number has no limit
    return [n for n, x, most in zip(model.nuisances, model.centre, model.prior().high)
            if abs(x) > 0.999 * most]


def readable(name: str) -> str:
    """Return the name of a number of the rig with its axis in place of an index."""
    stem, _, axis = name.rpartition('.')
    axes = FORCES if stem.startswith('wrench') else 'xyz'
    return f'{stem}.{axes[int(axis)]}' if axis.isdigit() and int(axis) < len(axes) else name


def from_checks(stamps: Sequence[Corrected], noise: Array, model: AccelerometerModel) -> Checks:
    """
    Name the effects that stamps and values show without a model.

    Parameters
    ----------
    noise : ndarray, shape (channels,)
        RMS of one sample.
    model : AccelerometerModel
        Of the accelerometer that was mounted.
    """
    effects: dict[str, dict[str, Parameter]] = {}
    notes = [note for one in stamps for note in one.notes]
    if skews := [x for one in stamps for x in one.skew.items()]:
        effects['clock_skew'] = _by_stream('clock_skew', skews, {
            c.stream: c.std for one in stamps for c in one.clocks})
        notes.append('clocks run apart: ' + ', '.join(f'{k} {1e6 * v:+.1f} ppm' for k, v in skews))
    if lost := [x for one in stamps for x in one.lost.items()]:
        effects['dropouts'] = _by_stream('dropouts', lost, {})
        notes.append('samples are lost: ' + ', '.join(f'{k} {100 * v:.2f} %' for k, v in lost))
    own = dict(zip((c.name for c in CHANNELS), noise.tolist()))
    steps = [x for one in stamps for x in quantisation(one.recording, own).items()]
    effects['wrench_quantisation'] = {
        q.name: Parameter(max(found), 0.0, q.unit)
        for prefix, q in zip(('force', 'torque'), EFFECTS['wrench_quantisation'].parameters)
        if (found := [step for channel, step in steps if channel.startswith(prefix)])}
    notes += [f'{channel} comes in steps of {step:.4g}' for channel, step in steps]
    stops = [x for one in stamps for x in clipped(one.recording, own)]
    for name, channels in CLIPPING.items():
        in_volts = 'accel' in name and stamps[0].recording.accelerometer_unit == 'V'
        quantities, effects[name] = EFFECTS[name].parameters[-len(channels):], {}
        for x in (x for x in stops if x.channel in channels):
            i = channels.index(x.channel)
            limit = (x.limit - model.offset[i]) / model.gain[i] if in_volts else x.limit
            effects[name][quantities[i].name] = Parameter(abs(limit), 0.0, quantities[i].unit)
    notes += [str(x) for x in stops if str(x) not in notes]
    notes += [f'stamps of {c.stream} scatter by {1e3 * c.jitter:.2f} ms' for one in stamps
              for c in one.clocks if c.jitter * c.rate > JITTER]
    # of commands that come unevenly, or of a limit that no sensor has, there is a note, no effect
    possible = {name: {q.name: found[q.name] for q in EFFECTS[name].parameters
                       if q.name in found and q.low <= found[q.name].value <= q.high}
                for name, found in effects.items()}
    return Checks({name: found for name, found in possible.items() if found}, tuple(notes))


def _by_stream(effect: str, found: Sequence[tuple[str, float]], std: Mapping[str, float]
               ) -> dict[str, Parameter]:
    """Average what each stream's stamps say, recording by recording."""
    out = {}
    for q in EFFECTS[effect].parameters:
        values = [value for stream, value in found if stream == q.name]
        if values:
            scatter = float(np.std(values)) / np.sqrt(len(values))
            out[q.name] = Parameter(float(np.mean(values)), max(scatter, std.get(q.name, 0.0)),
                                    q.unit)
    return out


def channel_affected_most(name: str, found: Mapping[str, Parameter]) -> str:
    """Name the channel that shows an effect of stamps or values most."""
    if name == 'wrench_quantisation':
        return 'force.x' if 'step' in found else 'torque.x'
    stream = max(found, key=lambda key: found[key].value)
    return next(c.name for c in CHANNELS if c.stream == stream)


def in_its_time(effect: NamedEffect, model: LinearisedModel,
                instants: Mapping[str, Instant | None]) -> NamedEffect:
    """Say of an effect that acts for a part of the time when that is."""
    if effect.name not in instants:
        return effect
    gate, instant = model.gates[effect.name], instants[effect.name]
    effect = replace(effect, name=model.library[effect.name].name, recording=gate.recording)
    if instant is None:
        return effect
    at, low, high = instant
    if gate.ends:
        return replace(effect, end=at, end_ci95=(low, high))
    return replace(effect, begin=at, begin_ci95=(low, high))


def instants(e: NamedEffect) -> list[tuple[str, float, tuple[float, float]]]:
    """List when an effect begins and ends: the word for it, the instant and its interval [s]."""
    both = (('from', e.begin, e.begin_ci95), ('to', e.end, e.end_ci95))
    return [(word, at, ci95) for word, at, ci95 in both if at is not None and ci95 is not None]


def std_of(ci95: tuple[float, float]) -> float:
    """Return the standard error of which an interval is 95 %."""
    return (ci95[1] - ci95[0]) / (2.0 * HALF)


def in_time(effects: Sequence[NamedEffect]) -> str:
    """Say when effects act that do not all the time, to be put behind a sentence."""
    parts = [words for e in effects for words in _times(e)]
    return f'; {", ".join(parts)}' if parts else ''


def _times(e: NamedEffect) -> Iterator[str]:
    """Say when an effect begins or ends, or in which recording it is; nothing: all the time."""
    by = ''
    if kind_of(e.name) == BIAS.name:
        by = ': ' + ', '.join(f'{k} by {p.value:+.3g} {p.unit}' for k, p in e.parameters.items())
    if e.recording is not None and not instants(e):
        yield f'{e.name}{by} in the {("first", "second")[e.recording]} recording alone'
    for word, at, ci95 in instants(e):
        where = ' of the second recording' if e.recording else ''
        when = f'{pair(at, std_of(ci95))} s{where}'
        yield (f'{e.name} until {when}' if word == 'to' else f'{e.name}{by} at {when}' if by
               else f'{e.name} from {when} on')
