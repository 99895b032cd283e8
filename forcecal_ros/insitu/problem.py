"""The matrix, the body and what the loads feel like, as one function of a few measured numbers.

Every data set has been reduced to as many pseudo-samples as its regressors have directions; with
the offset they are all that [Traversaro2014] III-C and its tables need, and the errors of these
numbers are all that their standard errors come from.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.calibration import Estimate
from forcecal_ros.errors import UnobservableError
from forcecal_ros.geometry import Array
from forcecal_ros.insitu import matrix as eq
from forcecal_ros.insitu.matrix import Load, MatrixFit
from forcecal_ros.insitu.moments import Moments
from forcecal_ros.insitu.motion import inertia_matrix, inertia_vector
from forcecal_ros.insitu.rank import data_rank, RankReport
from forcecal_ros.insitu.reduce import DataSet
from forcecal_ros.insitu.result import DataSetResult, SensorResult
from forcecal_ros.insitu.uncertainty import propagate
from forcecal_ros.insitu.validate import feel, Felt
import numpy as np


class Solution(NamedTuple):
    """
    What follows from the numbers.

    ``matrix`` (6, n); ``body`` mass, centre of mass and, in motion, inertia about it, (4,) or
    (10,); ``felt`` (k, 7) semi-axes, added mass and its position of every data set.
    """

    matrix: Array
    body: Array
    felt: Array

    def pack(self) -> Array:
        """Return all numbers in a row."""
        return np.concatenate([part.ravel() for part in self])

    def unpack(self, flat: Array) -> 'Solution':
        """Give numbers in a row the shapes of this solution."""
        ends = np.cumsum([part.size for part in self])[:-1]
        return Solution(*(piece.reshape(part.shape)
                          for piece, part in zip(np.split(flat, ends), self)))


@dataclass(frozen=True)
class Problem:
    """
    What does not vary with the noise: which data set is which, and where gravity pointed.

    Attributes
    ----------
    data_sets : tuple of DataSet
    moments : tuple of Moments
    noise : ndarray, shape (n, n)
        Covariance that the raw channels are scaled by.
    gravity : float
        Magnitude [m/s^2].
    """

    data_sets: tuple[DataSet, ...]
    moments: tuple[Moments, ...]
    noise: Array
    gravity: float

    def pack(self, offset: Array) -> Array:
        """Return the measured numbers: offset, then the pseudo-samples of every data set."""
        return np.concatenate([offset, *(m.raw.ravel() for m in self.moments)])

    def raw(self, x: Array) -> list[Array]:
        """Return the pseudo-samples (q_j, n) of every data set with the offset removed."""
        n = len(self.noise)
        ends = np.cumsum([m.raw.size for m in self.moments])[:-1]
        return [part.reshape(-1, n) - np.outer(m.ones, x[:n])
                for part, m in zip(np.split(x[n:], ends), self.moments)]

    def training(self, x: Array) -> tuple[list[Array], list[Array], list[Load]]:
        """Return raw pseudo-samples, regressors and loads of the data sets to train on."""
        chosen = [(r, m.directions, d.load)
                  for r, m, d in zip(self.raw(x), self.moments, self.data_sets)
                  if d.train and d.load is not None]
        return [c[0] for c in chosen], [c[1] for c in chosen], [c[2] for c in chosen]

    def fit(self, x: Array) -> MatrixFit:
        """Return matrix and body, [Traversaro2014] Eq. 21."""
        raw, gravity, loads = self.training(x)
        return eq.solve(raw, gravity, loads, eq.six_channels(raw, self.noise))

    def feel(self, x: Array, matrix: Array, body: Array) -> Iterator[Felt]:
        """Yield Tables I to III for every data set, as a matrix has it."""
        for r, m, d in zip(self.raw(x), self.moments, self.data_sets):
            wanted = d.load is not None and d.load.mass > 0
            yield feel(r @ matrix.T, m.directions, body, self.gravity, wanted)

    def solve(self, x: Array) -> Solution:
        """Return everything that follows from the numbers."""
        fit = self.fit(x)
        felt = [np.concatenate([f.semi_axes, [f.mass], f.position])
                for f in self.feel(x, fit.matrix, fit.body)]
        inertia = eq.inertia_about_com(fit.body)
        body = [fit.body[:1], eq.centre_of_mass(fit.body)]
        body += [] if inertia is None else [inertia_vector(inertia)]
        return Solution(fit.matrix, np.concatenate(body), np.array(felt))

    def rank(self, x: Array) -> RankReport:
        """
        Return the rank of the unknowns on the data.

        Raises
        ------
        UnobservableError
            More than the body's inertia stays open.
        """
        raw, gravity, loads = self.training(x)
        channels = eq.six_channels(raw, self.noise)
        report = data_rank([r @ channels for r in raw], gravity, loads)
        if set(report.undetermined) - {'inertia of the body'}:
            raise UnobservableError(
                f'the data give rank {report.rank} of {report.unknowns} beyond noise: '
                f'{", ".join(report.undetermined)} not determined; tilt further, add heavier '
                'masses or move them further off the line of the others')
        return report


def with_matrix(result: SensorResult, problem: Problem, offset: Array,
                covariance: Array) -> SensorResult:
    """
    Add matrix, body and tables to a result, each number with its standard error.

    Parameters
    ----------
    result : SensorResult
    problem : Problem
    offset : ndarray, shape (n,)
    covariance : ndarray
        Of the numbers in the order of :meth:`Problem.pack`.

    Returns
    -------
    SensorResult

    Raises
    ------
    UnobservableError
        The data do not determine the matrix.
    """
    x, n, unit = problem.pack(offset), len(offset), result.options.raw_unit
    rank = problem.rank(x)
    value = problem.solve(x)
    spread = propagate(lambda at: problem.solve(at).pack(), x, covariance)
    std = value.unpack(np.sqrt(np.diag(spread)))
    bias = np.sqrt(np.diag(value.matrix @ covariance[:n, :n] @ value.matrix.T))
    return replace(
        result, rank=rank, matrix=Estimate(value.matrix, std.matrix, f'N/{unit}, N m/{unit}'),
        wrench_bias=Estimate(np.zeros(6), bias, 'N, N m'),
        mass=Estimate(value.body[0], std.body[0], 'kg'),
        com=Estimate(value.body[1:4], std.body[1:4], 'm'), inertia=_inertia(value, std, rank),
        data_sets=tuple(_tables(result, problem, x, value, std)))


def _inertia(value: Solution, std: Solution, rank: RankReport) -> Estimate | None:
    if len(value.body) == 4 or rank.rank < rank.unknowns:
        return None
    return Estimate(inertia_matrix(value.body[4:]), inertia_matrix(std.body[4:]), 'kg m^2')


def _tables(result: SensorResult, problem: Problem, x: Array, value: Solution, std: Solution
            ) -> Iterator[DataSetResult]:
    maker = result.manufacturer_matrix
    by_maker = [None] * len(value.felt) if maker is None else problem.feel(
        x, maker, problem.fit(x).body)
    for data_set, felt, error, other in zip(result.data_sets, value.felt, std.felt, by_maker):
        known = bool(np.isfinite(felt[4:]).all())
        yield replace(data_set, semi_axes=Estimate(felt[:3], error[:3], 'N'),
                      added_mass=Estimate(felt[3], error[3], 'kg'),
                      position=Estimate(felt[4:], error[4:], 'm') if known else None,
                      by_manufacturer=other)
