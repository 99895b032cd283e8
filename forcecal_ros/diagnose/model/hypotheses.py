"""What may be the cause: every effect of the library as columns to screen and to refine."""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS
from forcecal_ros.diagnose.model.gates import BIAS, Gate, gated, nuisances_of, physical
from forcecal_ros.diagnose.model.jacobian import Column, column
from forcecal_ros.diagnose.model.linearised import Diverged, EFFECT, LinearisedModel
from forcecal_ros.effects import Effect
import numpy as np
from numpy.typing import NDArray

CLIPPING = {'wrench_saturation': tuple(c.name for c in CHANNELS if c.stream == 'wrench'),
            'accel_saturation': tuple(c.name for c in CHANNELS if c.stream == 'accelerometer')}
"""Effects that the data show without a model, so that none is searched for: their channels."""

VIBRATION = 'spindle_vibration'
"""The effect that shows as a spectral line."""


class Atom(NamedTuple):
    """
    A place at which an effect is screened.

    Attributes
    ----------
    start : ndarray, shape (p,)
        Parameters that the columns belong to.
    free : ndarray of int, shape (k,)
        Parameters that the columns move, each by its distance from nominal at the start.
    columns : tuple of list of Column
        One list per recording, one column per free parameter.
    """

    start: Array
    free: NDArray[np.intp]
    columns: tuple[list[Column], ...]


class Hypothesis(NamedTuple):
    """
    One effect of the library.

    Attributes
    ----------
    releases : tuple of frozenset of str
        Sets of nuisances of which it may lift the prior; such an effect has no atoms.
    gate : Gate, optional
        When it acts, if not all the time.
    times : int
        At how many times it is tried.
    """

    name: str
    effect: Effect
    releases: tuple[frozenset[str], ...]
    atoms: tuple[Atom, ...]
    gate: Gate | None = None
    times: int = 1

    @property
    def ways(self) -> int:
        """In how many ways it is tried."""
        return self.times * (len(self.releases) + len(self.atoms))


def values_of(effect: Effect, theta: Array) -> dict[str, float]:
    """Name the parameters of an effect."""
    return {q.name: float(v) for q, v in zip(effect.parameters, theta)}


def nominal_of(effect: Effect) -> Array:
    """Parameters at which the effect does nothing, shape (p,)."""
    return np.array([q.nominal for q in effect.parameters])


def bounds_of(effect: Effect) -> tuple[Array, Array]:
    """Lowest and highest parameters, shape (p,) each."""
    return (np.array([q.low for q in effect.parameters]),
            np.array([q.high for q in effect.parameters]))


def hypotheses(model: LinearisedModel, line: float | None = None) -> list[Hypothesis]:
    """
    Screen the library: columns of every effect that applies to the rig and the streams at hand.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated.
    line : float, optional
        Frequency of a spectral line in the residual [Hz], where vibration is looked for.

    Returns
    -------
    list of Hypothesis
        Without those that move nothing in these recordings.
    """
    found = []
    simulation = model.datasets[0].simulation
    for name, effect in model.library.items():
        if name in CLIPPING or not simulation.can_show(name, model.rig):
            continue
        if effect.nuisance:
            found += _released(model, name, effect)
            continue
        atoms = tuple(_sparse(_atoms(model, name, effect, line), effect))
        if atoms:
            found.append(Hypothesis(name, effect, (), atoms))
    return found


def _released(model: LinearisedModel, name: str, effect: Effect) -> list[Hypothesis]:
    own = [n.name for n in model.nuisances if n.key == effect.nuisance]
    parts = tuple(frozenset(own[i] for i in part) for part in _parts(effect, len(own)) if part)
    return [Hypothesis(name, effect, parts, ())] if parts else []


def _parts(effect: Effect, n: int) -> list[list[int]]:
    """
    List which of an effect's first n parameters may be wrong together.

    All, those of one vector, those of one axis of a vibration, or one alone.
    """
    names = [q.name for q in effect.parameters[:n]]
    # a sine and a cosine of one axis are one amplitude and phase, so that neither stands alone
    is_wave = 'sine_x' in names
    stems = [f'ine_{axis}' for axis in 'xyz'] if is_wave else dict.fromkeys(
        name[:-1] for name in names if name[-1] in 'xyz')
    parts = [list(range(n)),
             *([i for i, name in enumerate(names) if (
                 name.endswith(stem) if is_wave else name[:-1] == stem and name[-1] in 'xyz')]
               for stem in stems), *([] if is_wave else ([i] for i in range(n)))]
    return [part for i, part in enumerate(parts) if part and part not in parts[:i]]


def _atoms(model: LinearisedModel, name: str, effect: Effect, line: float | None) -> list[Atom]:
    nominal = nominal_of(effect)
    sized = [i for i, q in enumerate(effect.parameters) if not q.shapes]
    fixed = {'frequency': (line,)} if line and name == VIBRATION else {}
    grids = [fixed.get(q.name) or (q.starts if q.shapes or not effect.smooth else ())
             or (q.typical,) for q in effect.parameters]

    def only(moving: Sequence[int], start: tuple[float, ...]) -> Array:
        theta, still = np.array(start, dtype=float), [j for j in sized if j not in moving]
        theta[still] = nominal[still]
        return theta

    atoms = []
    for start in product(*grids):
        columns = {i: _difference(model, name, effect, only([i], start)) for i in sized}
        moving = [i for i in sized if any(columns[i])]
        if moving:
            atoms.append(Atom(only(moving, start), np.array(moving),
                              _transposed([columns[i] for i in moving])))
    return atoms


def _difference(model: LinearisedModel, name: str, effect: Effect, theta: Array) -> list[Column]:
    """Return what an effect does to each recording; nothing where its simulation diverges."""
    try:
        return model.difference({**model.effects, name: values_of(effect, theta)})
    except Diverged:
        return [{} for _ in model.datasets]


def _sparse(atoms: list[Atom], effect: Effect) -> list[Atom]:
    """Add fewer parameters by themselves: one wrong entry is likelier than twelve."""
    out = list(atoms)
    sized = [i for i, q in enumerate(effect.parameters) if not q.shapes]
    for atom in atoms:
        for part in _parts(effect, len(sized))[1:]:
            chosen = [j for j, i in enumerate(atom.free) if i in part]
            if chosen and len(chosen) < len(atom.free):
                out.append(fewer(effect, atom, np.array(chosen)))
    return out


def fewer(effect: Effect, atom: Atom, part: NDArray[np.intp]) -> Atom:
    """Keep some of the parameters that an atom moves, the others where they do nothing."""
    if len(part) == len(atom.free):
        return atom
    start, others = atom.start.copy(), np.delete(atom.free, part)
    start[others] = nominal_of(effect)[others]
    return Atom(start, atom.free[part], tuple([one[j] for j in part] for one in atom.columns))


def distinct_columns(found: Sequence[Hypothesis]) -> dict[int, tuple[Column, ...]]:
    """List the columns that hypotheses share once, of each recording, by the first one's id."""
    return {id(c[0]): c for h in found for a in h.atoms for c in zip(*a.columns)}


def everywhere(model: LinearisedModel, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """
    Return those hypotheses that may begin or end, all with parameters of their own, and a bias.

    Parameters
    ----------
    found : sequence of Hypothesis
        Some of them nuisances whose prior is lifted, which a part of the time cannot have.
    """
    out = [_of_nuisances(model, h) if h.releases else h
           for h in found if h.effect.where != 'stamps']
    bias = Hypothesis(BIAS.name, BIAS, (), ())
    return [h for h in (*out, _of_nuisances(model, bias)) if h.atoms]


def _of_nuisances(model: LinearisedModel, h: Hypothesis) -> Hypothesis:
    """Give an effect that lifts the prior of nuisances their columns as its own."""
    start, free, several = nominal_of(h.effect), [], []
    own = nuisances_of(model.nuisances, h.effect)
    for k, (i, q) in enumerate(zip(own, h.effect.parameters)):
        size = float(model.prior_std[i]) * physical(model.rig, model.nuisances[i].key, q.unit)
        ratio = (q.typical - q.nominal) / size
        columns = [{c: rows.times(ratio) for c, rows in one[i].items()} for one in model.jacobian]
        if any(columns):
            start[k] = q.typical
            free.append(k)
            several.append(columns)
    if not free:
        return h._replace(releases=(), atoms=())
    atom = Atom(start, np.array(free), _transposed(several))
    return h._replace(releases=(), atoms=tuple(_sparse([atom], h.effect)))


def for_a_part(model: LinearisedModel, h: Hypothesis) -> Hypothesis:
    """Let the columns of a hypothesis of :func:`everywhere` act as its gate lets it."""
    assert h.gate is not None
    rows = [h.gate.rows(one.measured, i) for i, one in enumerate(model.datasets)]
    known: dict[int, Column] = {}  # starts of an effect share their columns

    def part(one: Column, acts: Array) -> Column:
        if id(one) not in known:
            known[id(one)] = gated(one, acts)
        return known[id(one)]

    return h._replace(atoms=tuple(
        atom._replace(columns=tuple([part(one, acts) for one in columns]
                                    for columns, acts in zip(atom.columns, rows)))
        for atom in h.atoms))


def in_one_recording(model: LinearisedModel, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Let hypotheses of :func:`everywhere` act in each of several recordings alone."""
    n = len(model.datasets)
    return [for_a_part(model, h._replace(gate=Gate(i), times=n))
            for h in found for i in range(n)] if n > 1 else []


def _transposed(columns: list[list[Column]]) -> tuple[list[Column], ...]:
    return tuple(list(one) for one in zip(*columns))


def left_out(model: LinearisedModel, name: str, theta: Array, free: NDArray[np.intp]
             ) -> list[Hypothesis]:
    """List each number of an effect that is not estimated, as a hypothesis beside the others."""
    if not len(theta):
        return []  # it lifts the prior of nuisances
    effect, out = model.library[name], []
    for i, q in enumerate(effect.parameters):
        if q.shapes or i in free:
            continue
        jacobian, start = effect_jacobian(model, name, theta, np.array([i])), theta.copy()
        start[i] = nominal_of(effect)[i] + jacobian.units[0]
        if any(one[0] for one in jacobian.columns):
            out.append(Hypothesis(f'{name}.{i}', effect, (), (
                Atom(start, jacobian.free, jacobian.columns),)))
    return out


class EffectJacobian(NamedTuple):
    """
    Columns of an effect's estimated parameters at their values.

    Attributes
    ----------
    free : ndarray of int, shape (k,)
        Which parameters.
    units : ndarray, shape (k,)
        Of the columns.
    away : ndarray, shape (k,)
        How far the parameters are from their prior's mean, in these units: the effect does
        nothing there, or an earlier recording found them there.
    precision : ndarray, shape (k,)
        Of that prior.
    columns : tuple of list of Column
        One list per recording.
    """

    name: str
    free: NDArray[np.intp]
    units: Array
    away: Array
    precision: Array
    columns: tuple[list[Column], ...]


def unit_of(effect: Effect, theta: Array) -> Array:
    """Scale of each parameter, shape (p,)."""
    nominal = nominal_of(effect)
    typical = np.array([q.typical for q in effect.parameters])
    unit = np.maximum(np.abs(typical - nominal), np.abs(theta - nominal))
    shapes = np.array([q.shapes for q in effect.parameters])
    unit = np.where(shapes, np.abs(typical - nominal), unit)
    return np.asarray(np.where(unit > 0.0, unit, 1.0))


def effect_jacobian(model: LinearisedModel, name: str, theta: Array, free: NDArray[np.intp]
                    ) -> EffectJacobian:
    """
    Take an effect's columns at its parameters by finite steps.

    Parameters
    ----------
    model : LinearisedModel
        Evaluated there.
    theta : ndarray, shape (p,)
    free : ndarray of int, shape (k,)
        Which parameters.
    """
    effect = model.library[name]
    units, high = unit_of(effect, theta)[free], bounds_of(effect)[1]
    fraction = 0.02 if effect.smooth else 0.1
    several = []
    for i, unit in zip(free, units):
        moved = theta.copy()
        h = fraction * unit if theta[i] + fraction * unit <= high[i] else -fraction * unit
        moved[i] += h
        changed = {**model.effects, name: values_of(effect, moved)}
        several.append([column((before - model.simulate(changed, k)) * (unit / h), model.level)
                        for k, before in enumerate(model.residuals)])
    columns = _transposed(several) or tuple([] for _ in model.datasets)
    away = (theta - nominal_of(effect))[free] / units
    shapes = np.array([effect.parameters[i].shapes for i in free])
    away = np.where(shapes, 0.0, away)
    precision, known = np.full(len(free), EFFECT), model.earlier.numbers.get(name, {})
    for j, i in enumerate(free):
        value, std = known.get(effect.parameters[i].name, (0.0, 0.0))
        if std and name not in model.gates:
            away[j], precision[j] = (theta[i] - value) / units[j], (units[j] / std) ** 2
    return EffectJacobian(name, free, units, away, precision, columns)
