"""Matrix, body and estimates of the loads, from a few measured numbers and their errors.

Every data set has been reduced to as many pseudo-samples as its regressors have directions; with
the offset they are all that [Traversaro2014] III-C and its tables need, and the errors of these
numbers are all that their standard errors come from.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from forcecal_ros.core.calibration import Estimate
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.rigid_body import INERTIAL, symmetric
from forcecal_ros.insitu import equations as eq
from forcecal_ros.insitu.equations import (
    common_parameters,
    Contradiction,
    contradiction,
    data_rank,
    estimate_load,
    Load,
    LoadEstimate,
    off_by,
    RankReport,
    STATIC,
)
from forcecal_ros.insitu.moments import Moments
from forcecal_ros.insitu.reduce import DataSet, Reduced
from forcecal_ros.insitu.result import DataSetResult, SensorResult
from forcecal_ros.insitu.uncertainty import propagate
import numpy as np


class Fitted(NamedTuple):
    """``matrix`` (6, n), ``body`` (4,) or (16,), ``offset`` (n,)."""

    matrix: Array
    body: Array
    offset: Array

    def pack(self) -> Array:
        """Return all numbers in a row."""
        return np.concatenate([part.ravel() for part in self])

    def unpack(self, flat: Array) -> 'Fitted':
        """Give numbers in a row the shapes of this fit."""
        ends = np.cumsum([part.size for part in self])[:-1]
        return Fitted(*(one.reshape(part.shape)
                        for one, part in zip(np.split(flat, ends), self)))


@dataclass(frozen=True)
class MatrixProblem:
    """
    What was measured, in the order offset, pseudo-samples of the first data set, of the second...

    Attributes
    ----------
    offset : ndarray, shape (n,)
        Zero in motion, where it is a result of the fit.
    noise : ndarray, shape (n, n)
        Covariance that the raw channels are scaled by.
    covariance : ndarray
        Of the measured numbers.
    gravity : float
        Magnitude [m/s^2].
    """

    data_sets: tuple[DataSet, ...]
    moments: tuple[Moments, ...]
    offset: Array
    noise: Array
    covariance: Array
    gravity: float

    def part(self, number: int) -> slice:
        """Return where the pseudo-samples of a data set stand among the measured numbers."""
        start = len(self.offset) + sum(m.raw.size for m in self.moments[:number])
        return slice(start, start + self.moments[number].raw.size)

    @cached_property
    def train(self) -> dict[int, Load]:
        """Loads of the data sets to train on, by number."""
        return {k: d.load for k, d in enumerate(self.data_sets) if d.train and d.load is not None}

    @cached_property
    def raw(self) -> list[Array]:
        """Pseudo-samples of the data sets to train on, the offset subtracted."""
        return [self.moments[k].raw - np.outer(self.moments[k].ones, self.offset)
                for k in self.train]

    @cached_property
    def channels(self) -> Array:
        """Six combinations of the channels, shape (n, 6)."""
        return eq.six_channels(self.raw, self.noise)

    @cached_property
    def equations(self) -> tuple[list[Array], list[Array], list[Load]]:
        """Six channels, regressors and loads of the data sets to train on."""
        return ([raw @ self.channels for raw in self.raw],
                [self.moments[k].directions for k in self.train], [*self.train.values()])

    def fit(self) -> Fitted:
        """Return matrix and body, [Traversaro2014] Eq. 21."""
        matrix, body = eq.solve(self.raw, *self.equations[1:], self.channels)
        return Fitted(matrix, body, self.offset if len(body) <= INERTIAL
                      else np.linalg.pinv(matrix) @ body[INERTIAL:])

    def sensitivity(self, fitted: Fitted, mass: float, place: float) -> tuple[Array, Array]:
        """
        How the fit changes with what was measured and stated, its residual taken to be small.

        Parameters
        ----------
        mass, place : float
            Standard error of a stated mass, as a share, and of a place [m].

        Returns
        -------
        by_numbers, by_loads : ndarray
            One row for each number of :meth:`Fitted.pack`; one column for each measured number,
            and for each stated mass and place, by one of their standard errors.
        """
        n, raws = len(self.offset), self.equations[0]
        scaled, scale = eq.to_unit_columns(eq.system(*self.equations)[0])
        by_wrench = np.linalg.pinv(scaled, rcond=eq.RELATIVE) / scale[:, None]
        by_numbers = np.zeros((len(scale), len(self.covariance)))
        by_loads: list[Array] = []
        parts = np.split(by_wrench, 6 * np.cumsum([len(raw) for raw in raws])[:-1], axis=1)
        for (k, load), own in zip(self.train.items(), parts):
            gravity = self.moments[k].directions
            by_raw = -(own.reshape(len(scale), -1, 6) @ fitted.matrix)
            by_numbers[:, self.part(k)] = by_raw.reshape(len(scale), -1)
            by_numbers[:, :n] -= np.tensordot(by_raw, self.moments[k].ones, (1, 0))
            by_loads += [own @ (eq.known_side(gravity, off) - eq.known_side(gravity, load))
                         for off in off_by(load, mass * load.mass, place)]

        def of_all(change: Array) -> Array:
            matrix = np.einsum('jik,cj->ick', change[:36].reshape(6, 6, -1), self.channels)
            offset = np.zeros((n, change.shape[1]))
            if len(fitted.body) > INERTIAL:
                offset = np.linalg.pinv(fitted.matrix) @ (
                    change[36 + INERTIAL:] - np.einsum('ick,c->ik', matrix, fitted.offset))
            return np.concatenate([matrix.reshape(6 * n, -1), change[36:], offset])

        measured = of_all(by_numbers)
        if len(fitted.body) <= INERTIAL:
            measured[-n:, :n] = np.eye(n)
        return measured, of_all(np.transpose(by_loads))

    def load(self, number: int, fitted: Fitted, raw: Array, matrix: Array) -> LoadEstimate:
        """Tables I to III for one data set, by a matrix."""
        m, stated = self.moments[number], self.data_sets[number].load
        wrench = (raw - np.outer(m.ones, fitted.offset)) @ matrix.T
        return estimate_load(wrench, m.directions, fitted.body, self.gravity,
                             stated is not None and stated.mass > 0)

    def contradiction(self, body: bool, matrix: Array) -> Contradiction | None:
        """
        Return which stated loads cannot be.

        Parameters
        ----------
        body : bool
            Whether an unknown one hangs there, too.
        matrix : ndarray, shape (6, n)
            As fitted.
        """
        def noise_of(number: int) -> Array:
            part, shape = self.part(number), self.moments[number].raw.shape
            covariance = self.covariance[part, part].reshape(shape * 2)
            variance = np.einsum('in,anam,im->i', matrix, covariance, matrix)
            return np.asarray(variance.reshape(2, 3).sum(axis=1))

        return contradiction([self.data_sets[k].name for k in self.train], *self.equations,
                             [noise_of(k) for k in self.train], body)

    def rank(self) -> RankReport:
        """
        Return the rank of the unknowns on the data.

        Raises
        ------
        UnobservableError
            More than the body's inertia stays open.
        """
        report = data_rank(*self.equations)
        if set(report.undetermined) - {'inertia of the body'}:
            raise UnobservableError(
                f'the data give rank {report.rank} of {report.unknowns} beyond noise and misfit: '
                f'{", ".join(report.undetermined)} undetermined; add a data set with a '
                'heavier mass off the line of the others, and tilt further')
        return report


def with_matrix(result: SensorResult, problem: MatrixProblem) -> SensorResult:
    """
    Add matrix, body and tables to a result, each number with its standard error.

    Raises
    ------
    UnobservableError
        The data do not determine the matrix.
    """
    rank, fitted, options = problem.rank(), problem.fit(), result.options
    change, of_loads = problem.sensitivity(fitted, options.mass_error, options.place_error)
    spread = change @ problem.covariance @ change.T + of_loads @ of_loads.T
    std = fitted.unpack(np.sqrt(np.diag(spread)))
    n, unit = len(fitted.offset), options.raw_unit
    bias = fitted.matrix @ spread[-n:, -n:] @ fitted.matrix.T
    body, of_body = common_parameters(fitted.body), slice(fitted.matrix.size, -n)
    body_std = np.sqrt(np.diag(propagate(
        common_parameters, fitted.body, spread[of_body, of_body])))
    known = len(body) > 4 and rank.rank == rank.unknowns
    return replace(
        result, rank=rank, offset=Estimate(fitted.offset, std.offset, unit),
        matrix=Estimate(fitted.matrix, std.matrix, f'N/{unit}, N m/{unit}'),
        wrench_bias=Estimate(np.zeros(6), np.sqrt(np.diag(bias)), 'N, N m'),
        mass=Estimate(body[0], body_std[0], 'kg'), com=Estimate(body[1:4], body_std[1:4], 'm'),
        inertia=Estimate(symmetric(body[4:]), symmetric(body_std[4:]), 'kg m^2')
        if known else None,
        data_sets=tuple(_tables(result, problem, fitted, change, of_loads)))


def _tables(result: SensorResult, problem: MatrixProblem, fitted: Fitted, change: Array,
            of_loads: Array) -> Iterator[DataSetResult]:
    count = len(change)
    for k, data_set in enumerate(result.data_sets):
        shape, part = problem.moments[k].raw.shape, problem.part(k)

        def tables(numbers: Array, k: int = k, shape: tuple[int, ...] = shape) -> Array:
            fit = fitted.unpack(numbers[:count])
            found = problem.load(k, fit, numbers[count:].reshape(shape), fit.matrix)
            return np.concatenate([found.semi_axes, [found.mass], found.position])

        own = np.vstack([change, np.eye(len(problem.covariance))[part]])
        spread = own @ problem.covariance @ own.T
        spread[:count, :count] += of_loads @ of_loads.T
        numbers = np.concatenate([fitted.pack(), problem.moments[k].raw.ravel()])
        value = tables(numbers)
        std = np.sqrt(np.diag(propagate(tables, numbers, spread)))
        maker = result.manufacturer_matrix
        yield replace(
            data_set, semi_axes=Estimate(value[:3], std[:3], 'N'),
            added_mass=Estimate(value[3], std[3], 'kg'),
            position=Estimate(value[4:], std[4:], 'm') if np.isfinite(value[4:]).all() else None,
            by_manufacturer=None if maker is None else problem.load(
                k, fitted, problem.moments[k].raw, maker))


NOTHING = np.zeros(4)
"""The body."""


class _Rows(NamedTuple):
    """Blocks of one data set: ``gravity`` (b, 3), ``raw`` (b, n), ``wrench`` (b, 6)."""

    gravity: Array
    raw: Array
    wrench: Array


@dataclass(frozen=True)
class _Map:
    """Wrench = matrix raw + constant."""

    matrix: Array
    constant: Array

    def __call__(self, raw: Array) -> Array:
        return np.asarray(raw @ self.matrix.T + self.constant)

    @property
    def offset(self) -> Array:
        """Raw channels without load: of all that give no wrench, the nearest to zero."""
        return -np.linalg.pinv(self.matrix) @ self.constant


def with_known_wrenches(result: SensorResult, data_sets: Sequence[DataSet],
                        reduced: Sequence[Reduced]) -> SensorResult:
    """
    Add the matrix and the tables to a result, each number with its standard error.

    Raises
    ------
    UnobservableError
        Known wrenches, or those without one data set, do not span forces and torques.
    """
    rows = [_rows(d.load, r) for d, r in zip(data_sets, reduced)]
    train = [k for k, d in enumerate(data_sets) if d.train]
    fitted = _fit([rows[k] for k in train])
    without = [_fit([rows[j] for j in train if j != k]) for k in train]
    held_out = np.sqrt(np.mean([_held_out(one, rows[k], data_sets[k].load)
                                for one, k in zip(without, train)], axis=0))
    _, raw, wrench = map(np.vstack, zip(*(rows[k] for k in train)))
    off = wrench - fitted(raw)
    unit, n = result.options.raw_unit, fitted.matrix.shape[1]
    std = _jackknife([one.matrix for one in without])
    offset_std = _jackknife([one.offset for one in without])
    bias = _jackknife([one.constant - fitted.constant + (one.matrix - fitted.matrix)
                       @ fitted.offset for one in without])
    return replace(
        result, offset=Estimate(fitted.offset, offset_std, unit),
        matrix=Estimate(fitted.matrix, std, f'N/{unit}, N m/{unit}'),
        wrench_bias=Estimate(np.zeros(6), bias, 'N, N m'),
        mass=Estimate(0.0, 0.0, 'kg'), com=Estimate(np.zeros(3), np.zeros(3), 'm'),
        rank=RankReport(6 * n + 6, 6 * n + 6, (), np.zeros(0)),
        nonlinearity=float((off.std(axis=0) / np.maximum(np.ptp(wrench, axis=0), 1e-12)).max()),
        data_sets=tuple(_known_tables(result, rows, fitted, held_out)))


def _rows(load: Load | None, reduced: Reduced) -> _Rows:
    gravity = reduced.blocks.regressors[reduced.use, :STATIC]
    return _Rows(gravity, reduced.blocks.raw[reduced.use],
                 eq.known_side(gravity, load or Load(0.0)).reshape(-1, 6))


def _fit(rows: Sequence[_Rows]) -> _Map:
    _, raw, wrench = map(np.vstack, zip(*rows))
    spread = wrench - wrench.mean(axis=0)
    strength = np.linalg.svd(spread / np.maximum(np.abs(spread).max(axis=0), 1e-12),
                             compute_uv=False)
    rank = int((strength > 1e-6 * strength[0]).sum())
    if rank < 6 or len(wrench) <= raw.shape[1] + 1:
        raise UnobservableError(
            f'{len(wrench)} known wrenches of {len(rows)} data sets (one is left out to estimate '
            f'standard errors) have rank {rank} of 6; add a data set with the mass at another '
            f'position, off the line of the others, and {raw.shape[1] + 2} or more poses in all')
    centre = raw.mean(axis=0)
    matrix = np.linalg.lstsq(raw - centre, spread, rcond=1e-9)[0].T
    return _Map(matrix, wrench.mean(axis=0) - matrix @ centre)


def _jackknife(values: Sequence[Array]) -> Array:
    """Return the standard error from estimates without one data set each."""
    return np.asarray(np.sqrt((len(values) - 1) * np.var(values, axis=0)))


def _estimate(fitted: _Map, rows: _Rows) -> LoadEstimate:
    size = float(np.linalg.norm(rows.gravity, axis=1).mean())
    return estimate_load(fitted(rows.raw), rows.gravity, NOTHING, size, True)


def _held_out(fitted: _Map, rows: _Rows, load: Load | None) -> Array:
    """Squared errors of mass, three semi-axes and the position's moment of a set left out."""
    assert load is not None
    found = _estimate(fitted, rows)
    size = float(np.linalg.norm(rows.gravity, axis=1).mean())
    moment = found.mass * found.position - load.mass * np.array(load.position)
    return np.concatenate([[found.mass - load.mass], found.semi_axes - load.mass * size,
                           moment]) ** 2


def _known_tables(result: SensorResult, rows: Sequence[_Rows], fitted: _Map, off: Array
            ) -> Iterator[DataSetResult]:
    """Tables I to III; their standard errors are the errors of the data sets left out."""
    for data_set, one in zip(result.data_sets, rows):
        found = _estimate(fitted, one)
        nothing = data_set.load is not None and not data_set.load.mass
        place = np.sqrt(off[4:] ** 2 + (found.position * off[0]) ** 2) / abs(found.mass)
        yield replace(data_set, added_mass=Estimate(found.mass, off[0], 'kg'),
                      semi_axes=Estimate(found.semi_axes, off[1:4], 'N'),
                      position=None if nothing else Estimate(found.position, place, 'm'))
