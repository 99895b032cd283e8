"""What may be the cause: every effect of the library as columns to screen and to refine."""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.diagnose.dataset import CHANNELS, STREAM_SLICES
from forcecal_ros.diagnose.model.gates import BIAS, Gate, gated, nuisances_of, physical
from forcecal_ros.diagnose.model.jacobian import Column, column
from forcecal_ros.diagnose.model.linearised import Diverged, EFFECT, LinearisedModel
from forcecal_ros.effects import Effect
import numpy as np
from numpy.typing import NDArray

CLIPPING = {'wrench_saturation': tuple(c.name for c in CHANNELS if c.stream == 'wrench'),
            'accel_saturation': tuple(c.name for c in CHANNELS if c.stream == 'accelerometer')}
"""Effects that the data show without a model and that a model has to follow: their channels."""

LIMITS_TRIED = 40
"""Limits that are tried, between the largest magnitude and half of it."""

MIN_REMOVED = 30.0
"""Squares that a limit has to remove, in those of the noise, to be worth a try."""


def limit_starts(model: LinearisedModel, effect: str) -> dict[str, float]:
    """
    Find limits at which a saturation may act, one for each of its channels that shows any.

    Parameters
    ----------
    model : LinearisedModel
        Recalibrated.
    effect : str
        One of CLIPPING.

    Returns
    -------
    dict of str to float
        Parameter of the effect -> limit, within the range that the library leaves it.
    """
    quantities = model.library[effect].parameters[-len(CLIPPING[effect]):]
    stream = 'wrench' if effect == 'wrench_saturation' else 'accelerometer'
    first, found = STREAM_SLICES[stream].start, {}
    if any(stream not in dataset.measured.streams for dataset in model.datasets):
        return {}
    pairs = [_physical(model, i, stream) for i in range(len(model.datasets))]
    for k, q in enumerate(quantities):
        simulated = np.concatenate([s[:, k] for s, _ in pairs])
        measured = np.concatenate([m[:, k] for _, m in pairs])
        noise = model.level[first + k] * 2.0
        if stream == 'accelerometer':
            noise /= abs(_model_gain(model)[k])
        limit = _best_limit(simulated, measured, q.low, q.high, noise)
        if limit and CHANNELS[first + k].name in CLIPPING[effect]:
            found[q.name] = limit
    return found


def _model_gain(model: LinearisedModel) -> Array:
    dataset = model.datasets[0]
    return np.array(model.rig.accelerometer.model(dataset.simulation.accelerometer).gain)


def _physical(model: LinearisedModel, i: int, stream: str) -> tuple[Array, Array]:
    """Give simulated and measured samples, the accelerometer's as specific force."""
    dataset, base = model.datasets[i], model.signals(i)
    rest, measured = dataset.measured.samples(stream, base), dataset.measured.values(stream)
    if stream == 'accelerometer':
        sensor = model.current().accelerometer.model(dataset.simulation.accelerometer)
        measured, rest = (measured - sensor.offset) / sensor.gain, rest / sensor.gain
    return measured - rest, measured


def _best_limit(simulated: Array, measured: Array, low: float, high: float, noise: float
                ) -> float:
    """Return the limit in a range that removes most squares; 0 where none is worth a try."""
    size = np.abs(simulated)
    near = np.flatnonzero(size > 0.5 * size.max())
    s, m = simulated[near], measured[near]
    before = (m - s) ** 2
    limits = size.max() * np.linspace(0.5, 1.0, LIMITS_TRIED, endpoint=False)
    limits = limits[(limits >= low) & (limits <= high)]
    if not len(limits):
        return 0.0
    removed = [float(np.sum(before - (m - np.clip(s, -x, x)) ** 2)) for x in limits]
    best = int(np.argmax(removed))
    return float(limits[best]) if removed[best] > MIN_REMOVED * noise ** 2 else 0.0


MOST_STARTS = 12
"""Starting values, at most, at which one effect is screened."""

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
        if name in model.fixed or not simulation.can_show(name, model.rig):
            continue
        if effect.nuisance:
            found += _released(model, name, effect)
            continue
        if name in CLIPPING:
            atoms = tuple(_limits(model, name, effect))
        else:
            atoms = tuple(_sparse(_atoms(model, name, effect, line), effect))
        if atoms:
            found.append(Hypothesis(name, effect, (), atoms))
    return found


def _released(model: LinearisedModel, name: str, effect: Effect) -> list[Hypothesis]:
    own = [n.name for n in model.nuisances if n.key == effect.nuisance]
    if not own:
        return []
    return [Hypothesis(name, effect, tuple(
        frozenset(own[i] for i in part) for part in _parts(effect, len(own))), ())]


def _parts(effect: Effect, n: int) -> list[list[int]]:
    """
    List which of an effect's first n parameters may be wrong together.

    All, those of one vector, those of one axis of a vibration, or one alone.
    """
    names = [q.name for q in effect.parameters[:n]]
    parts = [list(range(n))]
    if 'sine_x' in names:
        groups = [f'ine_{axis}' for axis in 'xyz']
        parts += [[i for i, name in enumerate(names) if name.endswith(g)] for g in groups]
    else:
        stems = dict.fromkeys(name[:-1] for name in names if name[-1] in 'xyz')
        parts += [[i for i, name in enumerate(names) if name[:-1] == stem and name[-1] in 'xyz']
                  for stem in stems]
        parts += [[i] for i in range(n)]
    return [part for i, part in enumerate(parts) if part and part not in parts[:i]]


def _atoms(model: LinearisedModel, name: str, effect: Effect, line: float | None) -> list[Atom]:
    nominal = nominal_of(effect)
    sized = [i for i, q in enumerate(effect.parameters) if not q.shapes]
    fixed = {'frequency': (line,)} if line and name == VIBRATION else {}
    grids = [fixed.get(q.name) or (q.starts if q.shapes or not effect.smooth else ())
             or (q.typical,) for q in effect.parameters]
    atoms = []
    for start in list(product(*grids))[:MOST_STARTS]:
        several, moving = [], []
        for i in sized:
            theta = np.array(start, dtype=float)
            others = [j for j in sized if j != i]
            theta[others] = nominal[others]
            columns = _difference(model, name, effect, theta)
            if any(columns):
                several.append(columns)
                moving.append(i)
        if several:
            theta = np.array(start, dtype=float)
            still = [j for j in sized if j not in moving]
            theta[still] = nominal[still]
            atoms.append(Atom(theta, np.array(moving), _transposed(several)))
    return atoms


def _difference(model: LinearisedModel, name: str, effect: Effect, theta: Array) -> list[Column]:
    """Return what an effect does to each recording; nothing where its simulation diverges."""
    try:
        return model.difference({**model.effects, name: values_of(effect, theta)})
    except Diverged:
        return [{} for _ in model.datasets]


def _limits(model: LinearisedModel, name: str, effect: Effect) -> list[Atom]:
    """Try each axis by itself, at the limit that its samples suggest."""
    atoms, names = [], [q.name for q in effect.parameters]
    for parameter, limit in limit_starts(model, name).items():
        theta, i = nominal_of(effect), names.index(parameter)
        theta[i] = limit
        columns = _difference(model, name, effect, theta)
        if any(columns):
            atoms.append(Atom(theta, np.array([i]), _transposed([columns])))
    return atoms


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


def everywhere(model: LinearisedModel, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """
    Return those hypotheses that may begin or end, all with parameters of their own, and a bias.

    Parameters
    ----------
    found : sequence of Hypothesis
        Some of them nuisances whose prior is lifted, which a part of the time cannot have.
    """
    out = [_of_nuisances(model, h) if h.releases else h
           for h in found if h.name not in CLIPPING and h.effect.where != 'stamps']
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


def for_a_part(model: LinearisedModel, h: Hypothesis, gate: Gate, times: int) -> Hypothesis:
    """Let a hypothesis of :func:`everywhere` act for a part of the time, one of so many."""
    rows = [gate.rows(one.measured, i) for i, one in enumerate(model.datasets)]
    known: dict[int, Column] = {}  # starts of an effect share their columns

    def part(one: Column, acts: Array) -> Column:
        if id(one) not in known:
            known[id(one)] = gated(one, acts)
        return known[id(one)]

    return h._replace(gate=gate, times=times, atoms=tuple(
        atom._replace(columns=tuple([part(one, acts) for one in columns]
                                    for columns, acts in zip(atom.columns, rows)))
        for atom in h.atoms))


def in_one_recording(model: LinearisedModel, found: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Let hypotheses of :func:`everywhere` act in each of several recordings alone."""
    n = len(model.datasets)
    return [for_a_part(model, h, Gate(i), n) for h in found for i in range(n)] if n > 1 else []


def _transposed(columns: list[list[Column]]) -> tuple[list[Column], ...]:
    return tuple(list(one) for one in zip(*columns))


FAR = 20.0
"""A nominal value so many times the typical one represents no limit at all."""


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
    limit = np.abs(nominal) > FAR * np.abs(typical)
    unit = np.where(limit, np.abs(theta), unit)
    shapes = np.array([q.shapes for q in effect.parameters])
    unit = np.where(shapes, np.abs(typical - nominal), unit)
    return np.asarray(np.where(unit > 0.0, unit, 1.0))


def effect_jacobian(model: LinearisedModel, name: str, theta: Array, free: NDArray[np.intp],
                    residuals: Sequence[Array], datasets: Sequence[int]) -> EffectJacobian:
    """
    Take an effect's columns at its parameters by finite steps.

    Parameters
    ----------
    theta : ndarray, shape (p,)
    free : ndarray of int, shape (k,)
        Which parameters.
    residuals : sequence of ndarray, shape (n, channels)
        Measured less simulated with the effect at ``theta``, of the chosen recordings.
    datasets : sequence of int
        Chosen recordings; the others get empty columns.
    """
    effect = model.library[name]
    units, high = unit_of(effect, theta)[free], bounds_of(effect)[1]
    fraction = 0.02 if effect.smooth else 0.1
    columns: list[list[Column]] = [[] for _ in model.datasets]
    for i, unit in zip(free, units):
        moved = theta.copy()
        h = fraction * unit if theta[i] + fraction * unit <= high[i] else -fraction * unit
        moved[i] += h
        changed = {**model.effects, name: values_of(effect, moved)}
        for dataset in range(len(model.datasets)):
            one: Column = {}
            if dataset in datasets:
                before = residuals[list(datasets).index(dataset)]
                one = column((before - model.simulate(changed, dataset)) * (unit / h),
                             model.level)
            columns[dataset].append(one)
    away = (theta - nominal_of(effect))[free] / units
    shapes = np.array([effect.parameters[i].shapes for i in free])
    away = np.where(shapes | (np.abs(away) > FAR), 0.0, away)
    precision, known = np.full(len(free), EFFECT), model.earlier.numbers.get(name, {})
    for j, i in enumerate(free):
        value, std = known.get(effect.parameters[i].name, (0.0, 0.0))
        if std and name not in model.gates:
            away[j], precision[j] = (theta[i] - value) / units[j], (units[j] / std) ** 2
    return EffectJacobian(name, free, units, away, precision, tuple(columns))
