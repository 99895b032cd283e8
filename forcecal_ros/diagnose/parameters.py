"""Effects found, in the library's own parameters."""

from collections.abc import Mapping, Sequence

from forcecal_ros.diagnose.channels import CHANNELS
from forcecal_ros.diagnose.joint import Accepted
from forcecal_ros.diagnose.limits import CLIPPING
from forcecal_ros.diagnose.problem import Problem
from forcecal_ros.diagnose.result import Parameter
from forcecal_ros.diagnose.stamps import Corrected
from forcecal_ros.effects import EFFECTS
from forcecal_ros.effects.rig import AccelerometerModel
from forcecal_ros.geometry import Array
from forcecal_ros.recording.checks import limits
from forcecal_ros.recording.checks.clipping import clipping, quantisation
import numpy as np


def parameters_of(problem: Problem, a: Accepted) -> dict[str, Parameter]:
    """
    Name the numbers of an accepted effect.

    Parameters
    ----------
    problem : Problem
        At the joint fit.
    a : Accepted

    Returns
    -------
    dict of str to Parameter
        A released nuisance's is its whole departure from the rig as given, within its limits.
    """
    effect = problem.library[a.name]
    quantities = effect.parameters
    if len(a.theta):
        return {q.name: Parameter(float(v), float(s), q.unit)
                for q, v, s in zip(quantities, a.theta, a.std)}
    out, covariance = {}, problem.fit_nuisances().covariance
    index = [i for i, n in enumerate(problem.nuisances) if n.key == effect.nuisance]
    for i, q in zip(index, quantities):
        if problem.nuisances[i].name not in a.released:
            out[q.name] = Parameter(q.nominal, 0.0, q.unit)
            continue
        scale = float(problem.sizes[i]) * _physical(problem, problem.nuisances[i].key, q.unit)
        value = np.clip(q.nominal + problem.centre[i] * scale, q.low, q.high)
        out[q.name] = Parameter(
            float(value), abs(scale) * float(np.sqrt(covariance[i, i])), q.unit)
    return out


def _physical(problem: Problem, key: str, unit: str) -> float:
    """Turn a relative departure into the unit of the effect's parameter."""
    rig = problem.rig
    relative = {'mass': rig.tool.mass, 'wall_stiffness': rig.wall.stiffness,
                'wall_damping': rig.wall.damping}
    if rig.optidrive is not None:
        relative |= {'stiffness': rig.optidrive.stiffness, 'damping': rig.optidrive.damping}
    return relative.get(key, 1.0) if unit != '1' else 1.0


def from_checks(stamps: Sequence[Corrected], noise: Array, model: AccelerometerModel
                ) -> tuple[dict[str, dict[str, Parameter]], tuple[str, ...]]:
    """
    Name the effects that stamps and values show without a model.

    Parameters
    ----------
    stamps : sequence of Corrected
    noise : ndarray, shape (channels,)
        RMS of one sample.
    model : AccelerometerModel
        Of the accelerometer that was mounted.

    Returns
    -------
    effects : dict of str to dict of str to Parameter
    notes : tuple of str
    """
    effects: dict[str, dict[str, Parameter]] = {}
    notes = [note for one in stamps for note in one.notes]
    skews = [s for one in stamps for s in one.skew.items()]
    if skews:
        effects['clock_skew'] = _by_stream('clock_skew', skews, {
            c.stream: c.std for one in stamps for c in one.clocks})
        notes.append('clocks run apart: ' + ', '.join(
            f'{k} {1e6 * v:+.1f} ppm' for one in stamps for k, v in one.skew.items()))
    lost = [v for one in stamps for v in one.lost.items()]
    if lost:
        effects['dropouts'] = _by_stream('dropouts', lost, {})
        notes.append('samples are lost: ' + ', '.join(
            f'{k} {100 * v:.2f} %' for one in stamps for k, v in one.lost.items()))
    own = dict(zip((c.name for c in CHANNELS), noise.tolist()))
    steps = [x for one in stamps for x in quantisation(one.recording, own)]
    quantised = {}
    for prefix, quantity in zip(('force', 'torque'), EFFECTS['wrench_quantisation'].parameters):
        own_steps = [x.step for x in steps if x.channel.startswith(prefix)]
        if own_steps:
            quantised[quantity.name] = Parameter(max(own_steps), 0.0, quantity.unit)
    if quantised:
        effects['wrench_quantisation'] = quantised
    notes += [f'{x.channel} comes in steps of {x.step:.4g}' for x in steps]
    stops = [x for one in stamps for x in clipping(one.recording, tuple(steps), own)]
    for name, quantities in ((n, EFFECTS[n].parameters) for n in CLIPPING):
        by_channel = dict(zip(CLIPPING[name], quantities[-len(CLIPPING[name]):]))
        found = {by_channel[x.channel].name: Parameter(x.limit, 0.0,
                                                       by_channel[x.channel].unit)
                 for x in stops if x.channel in by_channel}
        if name.startswith('accel') and stamps[0].recording.accelerometer_unit == 'V':
            found = _as_force(found, model)
        if found:
            effects[name] = {k: Parameter(abs(p.value), p.std, p.unit) for k, p in found.items()}
    notes += [str(x) for x in stops if str(x) not in notes]
    notes += [f'stamps of {c.stream} scatter by {1e3 * c.jitter:.2f} ms' for one in stamps
              for c in one.clocks if c.jitter * c.rate > limits.JITTER]
    # of commands that come unevenly, or of a limit that no sensor has, there is a note, no effect
    possible = {name: _possible(name, found) for name, found in effects.items()}
    return {name: found for name, found in possible.items() if found}, tuple(notes)


def _possible(effect: str, found: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Keep what lies within the library's limits."""
    within = {q.name: (q.low, q.high) for q in EFFECTS[effect].parameters}
    return {name: p for name, p in found.items() if within[name][0] <= p.value <= within[name][1]}


def _as_force(found: dict[str, Parameter], model: AccelerometerModel) -> dict[str, Parameter]:
    """Turn volts at which axes stop into specific forces."""
    return {axis: Parameter((p.value - model.offset[i]) / model.gain[i], 0.0, p.unit)
            for i, axis in enumerate('xyz') if (p := found.get(axis)) is not None}


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


def seen_in(name: str, found: Mapping[str, Parameter]) -> str:
    """Name the channel that shows an effect of stamps or values most."""
    if name == 'wrench_quantisation':
        return 'force.x' if 'step' in found else 'torque.x'
    stream = max(found, key=lambda key: found[key].value)
    return next(c.name for c in CHANNELS if c.stream == stream)
