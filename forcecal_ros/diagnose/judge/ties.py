"""
Effects that do the same to what was recorded, whatever a fit says.

A force sensor that is turned and an accelerometer that is turned the other way change alike what
a wrench is where the motion is known by that accelerometer; so do a centre of mass that is
elsewhere and torques that are taken about another point, a heavier tool and gains that are all
larger, a base that tilts and a cable that pulls at the centre of mass with the same force all the
time. The one that needs fewer numbers is the likelier by its evidence, and need not be the cause.
Whether a recording tells them apart is asked of the simulation: at rest an accelerometer's own
readings do, and so does contact.

A late wrench and one behind a low-pass differ, below the corner, in what the latter takes off
the amplitude at frequency w: (w T)^2 / 2 of a lag T. Readings that come late by a part a of a
sample dt have been interpolated between two of them, or averaged over one, and that takes off the
like, a (1 - a) (w dt)^2 / 2 where it is a straight line. Which of the two such a lag is depends on
how a driver makes its samples, which no recording shows.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, rotation_from_vector, skew
from forcecal_ros.diagnose.judge.named_effects import Parameter
from forcecal_ros.diagnose.model.evidence import fit
from forcecal_ros.diagnose.model.gates import nuisances_of
from forcecal_ros.diagnose.model.jacobian import column
from forcecal_ros.diagnose.model.linearised import Diverged, LinearisedModel
from forcecal_ros.effects.rig import Rig
from forcecal_ros.effects.signals import FORCES
import numpy as np

Numbers = Mapping[str, Mapping[str, Parameter]]
Values = dict[str, float]
Given = Mapping[str, float]


class Tie(NamedTuple):
    """What would have done the same as an accepted effect, its odds against that one, and why."""

    other: str
    odds: float
    note: str


def _crosstalk(matrix: Array) -> Values:
    return {f'{to}_of_{source}': float(matrix[i, j]) for i, to in enumerate(FORCES)
            for j, source in enumerate(FORCES) if i != j and not i < 3 <= j}


def _matrix(v: Given) -> Array:
    """Return the part of each force and torque that is added to each, shape (6, 6)."""
    return np.array([[v.get(f'{to}_of_{source}', 0.0) for source in FORCES] for to in FORCES])


def _vector(matrix: Array) -> Array:
    """Return the vector whose cross product is the antisymmetric part of a matrix."""
    part = 0.5 * (matrix - matrix.T)
    return np.array([part[2, 1], part[0, 2], part[1, 0]])


def _three(v: Given) -> Array:
    return np.array([v.get(axis, 0.0) for axis in 'xyz'])


def _turned(v: Given, rig: Rig) -> Values:
    """Turn the force sensor as the accelerometer's readings are turned back."""
    turn = rotation_from_vector(_three(v))
    return _crosstalk(np.asarray(np.kron(np.eye(2), turn), dtype=float))


def _misaligned(v: Given, rig: Rig) -> Values:
    return dict(zip('xyz', _vector(_matrix(v)[:3, :3]).tolist()))


def _moved_point(v: Given, rig: Rig) -> Values:
    """Take torques about a point that is elsewhere by as much as the centre of mass."""
    matrix = np.zeros((6, 6))
    matrix[3:, :3] = skew(_three(v))
    return _crosstalk(matrix)


def _moved_com(v: Given, rig: Rig) -> Values:
    return dict(zip('xyz', _vector(_matrix(v)[3:, :3]).tolist()))


def _all_gains(v: Given, rig: Rig) -> Values:
    return dict.fromkeys(FORCES, v['change'])


def _mass(v: Given, rig: Rig) -> Values:
    # of the axes that the motion tells: what it does not tell is not stated
    return {'change': float(np.mean(list(v.values())))}


def _pulled(v: Given, rig: Rig) -> Values:
    """Pull at the centre of mass with what a tilt adds to the weight in base."""
    down = np.array(rig.gravity)
    tilt = rotation_from_vector(np.array([v.get('x', 0.0), v.get('y', 0.0), 0.0]))
    pull = rig.tool.mass * (tilt.T @ down - down)
    return {**dict(zip('xyz', pull.tolist())), 'stiffness': 0.0,
            **{f'point_{axis}': x for axis, x in zip('xyz', rig.tool.com)}}


def _tilted(v: Given, rig: Rig) -> Values:
    weight = rig.tool.mass * float(np.linalg.norm(rig.gravity))
    return {'x': -v.get('y', 0.0) / weight, 'y': v.get('x', 0.0) / weight}


Form = Callable[[Given, Rig], Values]

FORMS: Mapping[str, Mapping[str, Form]] = {
    'accel_misalignment': {'wrench_crosstalk': _turned},
    'wrench_crosstalk': {'accel_misalignment': _misaligned, 'tool_com': _moved_com},
    'tool_com': {'wrench_crosstalk': _moved_point},
    'tool_mass': {'wrench_gain': _all_gains}, 'wrench_gain': {'tool_mass': _mass},
    'base_tilt': {'cable_force': _pulled}, 'cable_force': {'base_tilt': _tilted},
}
"""Effect -> others, and the numbers with which each does nearly or just the same."""

TOLD_BY: Mapping[frozenset[str], str] = {
    frozenset(('accel_misalignment', 'wrench_crosstalk')):
        'a force sensor and an accelerometer that are turned: the latter at rest tells them apart',
    frozenset(('tool_com', 'wrench_crosstalk')):
        'a centre of mass, and torques about another point: contact at a known place tells them '
        'apart',
    frozenset(('tool_mass', 'wrench_gain')):
        'a mass, and gains that are all larger: a known force tells them apart',
    frozenset(('base_tilt', 'cable_force')):
        'a tilt, and a force at the centre of mass: the base seen by a level tells them apart',
}
"""Pair -> what they are, and what would tell them apart."""

ODDS = {('tool_mass', 'wrench_gain'): 0.25, ('tool_com', 'wrench_crosstalk'): 0.25}
"""
Odds of a second that does the same only with numbers that agree, gains or parts of a crosstalk,
against one cause that moves them together. No recordings say how often gains of all axes are off
alike; payloads are what changes on a robot, and even odds would never say so.
"""

LAGS = {'wrench_delay': ('delay', 'wrench_lowpass'),
        'wrench_lowpass': ('time_constant', 'wrench_delay')}
"""Effect -> its number that is the lag, and the effect that shows like it."""

FORM = 5e-3
"""Part of the energy of an effect that a wrong form of it may leave."""

LEAST_BEYOND = 25.0
"""Whitened energy of a difference that noise does not make."""

TOLD = 2400.0
"""
Whitened energy by which effects are told apart, however strong they are: three log-odds at the
highest temperature of their ranking.
"""


def ties_of(model: LinearisedModel, numbers: Numbers, evidence: Mapping[str, float]
            ) -> dict[str, Tie]:
    """
    Return the ties of accepted effects.

    Parameters
    ----------
    model : LinearisedModel
        At the joint fit, the effects in it.
    numbers : mapping of str to mapping of str to Parameter
        Of each effect.
    evidence : mapping of str to float
        Log-evidence that each brings.
    """
    wrenches = [dataset.recording.wrench for dataset in model.datasets]
    period = max((1.0 / w.rate for w in wrenches if w is not None and len(w) > 1), default=0.0)
    found = {name: lag(name, numbers, period) or equivalent(model, name, numbers, evidence[name])
             for name in numbers}
    return {name: tie for name, tie in found.items() if tie is not None}


def lag(name: str, numbers: Numbers, period: float) -> Tie | None:
    """Return what shows like an effect whose lag is less than a sample's period [s]."""
    number, other = LAGS.get(name, ('', ''))
    found = numbers[name].get(number)
    if found is None or other in numbers or abs(found.value) >= period:
        return None
    return Tie(other, 1.0, f'{name} and {other} are the same where the lag is less than a sample '
               f'of the wrench ({1e3 * period:.3g} ms): only a faster recording tells them apart')


def equivalent(model: LinearisedModel, name: str, numbers: Numbers, evidence: float
               ) -> Tie | None:
    """
    Return what does the same to these recordings in an effect's place.

    What it does beyond that, nuisances and a discrepancy allowed for, is no effect of its own.
    """
    if name in model.gates or not numbers[name]:
        return None
    values = {k: p.value for k, p in numbers[name].items()}
    least = {other: _between(model, name, other, form(values, model.rig))
             for other, form in FORMS.get(name, {}).items()
             if other in model.library and other not in {*model.effects, *numbers}}
    other = min(least, key=lambda one: least[one], default='')
    if not other or least[other] >= untold(evidence):
        return None
    return Tie(other, ODDS.get((name, other), 1.0),
               f'{name} and {other} do the same here ({TOLD_BY[frozenset((name, other))]}), so '
               'that no motion of this kind does')


def untold(evidence: float) -> float:
    """Return the whitened energy up to which two forms of so strong an effect are the same."""
    return LEAST_BEYOND + min(FORM * 2.0 * max(0.0, evidence), TOLD)


def _between(model: LinearisedModel, name: str, other: str, values: Given) -> float:
    """Return the whitened energy by which another effect in an effect's place differs."""
    whole = {q.name: values.get(q.name, q.nominal) for q in model.library[other].parameters}
    if any(not q.low <= whole[q.name] <= q.high for q in model.library[other].parameters):
        return np.inf
    own = nuisances_of(model.nuisances, model.library[name])
    released = frozenset(model.nuisances[i].name for i in own) & model.released
    centre = model.centre.copy()
    for i in own:
        if model.nuisances[i].name in released:
            centre[i] = 0.0
    effects = {n: v for n, v in model.effects.items() if n != name}
    instead = replace(model, centre=centre, released=model.released - released,
                      effects={**effects, other: whole})
    try:
        instead.evaluate()
    except Diverged:
        return np.inf
    differences = [[column(b - a, model.level)]
                   for a, b in zip(model.residuals, instead.residuals)]
    train, held = instead.grams(differences)
    every, prior, m = train + held, instead.prior(), len(model.nuisances)
    less = every.of(np.arange(m))._replace(vector=every.matrix[:m, m],
                                           square=float(every.matrix[m, m]))
    x = fit(less, prior).x
    before, after = prior.centre, prior.centre + x
    return less.residual_squares(x) + float(prior.precision @ (after ** 2 - before ** 2))
