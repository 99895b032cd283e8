"""Whether the added masses determine the matrix: the rank of the 40 unknowns.

[Traversaro2014] Lemma 2 (three data sets at least) is necessary, not sufficient. The rank of
Eq. 21 states it. With a body of unknown mass, three data sets do when the total masses are not all
equal and the total centres of mass are not on one line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu import equations as eq
from forcecal_ros.insitu.equations import Load, load_parameters, STATIC, system, total_map
import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

RELATIVE = 1e-9
"""Singular values below this share of the largest are rounding."""

NOISE_FACTOR = 1.5
"""Singular values below this many times what noise alone would make do not count."""


@dataclass(frozen=True)
class RankReport:
    """
    Which unknowns of [Traversaro2014] Eq. 21 are determined.

    Attributes
    ----------
    undetermined : tuple of str
        Names of unknowns that the equations leave open.
    singular_values : ndarray
        Of the scaled equations, largest first.
    """

    rank: int
    unknowns: int
    undetermined: tuple[str, ...]
    singular_values: Array


def structural_rank(loads: Sequence[Load], regressors: int = STATIC) -> RankReport:
    """
    Rank that these loads allow at best: ideal motion, no noise, some body or other.

    Parameters
    ----------
    regressors : int
        3 at rest, 13 in motion.
    """
    size = max([load.mass for load in loads] + [1e-3])
    reach = max([float(np.linalg.norm(load.position)) for load in loads] + [1e-3])
    body = load_parameters(2.7 * size, np.array([0.11, -0.23, 0.37]) * reach, regressors)
    body[4:] = np.linspace(0.4, 0.9, len(body) - 4) ** 2 * size
    gravity = np.eye(regressors)
    raw = [gravity @ total_map(body, load, regressors).T for load in loads]
    design, _ = system(raw, [gravity] * len(loads), loads)
    return _report(design, 0.0)


def data_rank(raw: Sequence[Array], gravity: Sequence[Array], loads: Sequence[Load]) -> RankReport:
    """
    Rank of the equations as measured; what noise alone would make does not count.

    Parameters
    ----------
    raw : sequence of ndarray, shape (q_j, 6)
        Pseudo-samples of the channels, offset removed, scaled to unit noise.
    gravity : sequence of ndarray, shape (q_j, m)
    """
    design, _ = system(raw, gravity, loads)
    count = sum(len(r) for r in raw)
    return _report(design, NOISE_FACTOR * (np.sqrt(count) + np.sqrt(6)))


def _report(design: Array, noise: float) -> RankReport:
    """Scale the body's columns to the matrix's strongest, which carry the noise; count."""
    unknowns = design.shape[1]
    norms = np.linalg.norm(design, axis=0)
    scale = np.ones(unknowns)
    scale[36:] = norms[:36].max() / np.where(norms[36:] > 0, norms[36:], 1.0)
    _, s, vh = np.linalg.svd(design * scale, full_matrices=True)
    s = np.append(s, np.zeros(max(0, unknowns - len(s))))
    rank = int((s > max(RELATIVE * s[0], noise)).sum())
    return RankReport(rank, unknowns, tuple(_names(vh[rank:])), s)


def _names(null: Array) -> Iterator[str]:
    """Name the unknowns that take part in the null space."""
    if not len(null):
        return
    share = np.sqrt((null ** 2).sum(axis=0))
    open_ = share > 1e-3 * share.max()
    matrix = open_[:36].reshape(6, 6)
    for row, name in ((slice(0, 3), 'force rows of the matrix'),
                      (slice(3, 6), 'torque rows of the matrix')):
        if matrix[:, row].any():
            yield name
    for part, name in ((open_[36:37], 'mass of the body'),
                       (open_[37:40], 'centre of mass of the body'),
                       (open_[40:46], 'inertia of the body'), (open_[46:], 'offset')):
        if part.any():
            yield name


def require(loads: Sequence[Load], regressors: int = STATIC) -> RankReport:
    """
    Refuse loads that cannot determine the matrix.

    Parameters
    ----------
    loads : sequence of Load
        Of the data sets to train on.

    Raises
    ------
    UnobservableError
        The rank is short; the message states by how much, what is open and what to add.
    """
    report = structural_rank(loads, regressors)
    if report.rank < report.unknowns:
        raise UnobservableError(
            f'{_counted(loads)} give rank {report.rank} of {report.unknowns}: '
            f'{", ".join(report.undetermined)} not determined; add {_advice(loads, regressors)}')
    return report


def _counted(loads: Sequence[Load]) -> str:
    masses = len({round(load.mass, 6) for load in loads})
    places = len({load.position for load in loads if load.mass})
    return (f'{len(loads)} data set{"s" * (len(loads) != 1)} to train on with {masses} different '
            f'added mass{"es" * (masses != 1)} at {places} place{"s" * (places != 1)}')


def _advice(loads: Sequence[Load], regressors: int) -> str:
    """Try what could be added, fewest data sets first, and name the first that is enough."""
    heaviest = max(loads, key=lambda load: load.mass, default=Load(0.0))
    mass = heaviest.mass or 1.0
    x, y, z = heaviest.position if heaviest.mass else (0.1, 0.0, 0.2)
    reach = max(float(np.linalg.norm((x, y, z))), 0.1)
    offers = [
        ('a data set with no added mass', Load(0.0)),
        ('a data set with another mass', Load(2 * mass, (x, y, z))),
        ('a data set with the mass at another place, off the line of the others',
         Load(mass, (x + 0.31 * reach, y - 0.53 * reach, z + 0.17 * reach))),
        ('one with the mass at yet another place',
         Load(mass, (x - 0.43 * reach, y - 0.29 * reach, z + 0.61 * reach))),
        ('one with another mass at a place of its own',
         Load(2 * mass, (x + 0.37 * reach, y + 0.47 * reach, z - 0.23 * reach))),
    ]
    if any(load.mass == 0 for load in loads):
        offers = offers[1:]
    for size in range(1, len(offers) + 1):
        for chosen in combinations(offers, size):
            report = structural_rank([*loads, *(load for _, load in chosen)], regressors)
            if report.rank == report.unknowns:
                return ' and '.join(words for words, _ in chosen)
    return 'data sets with different masses at different places'


MASS, PLACE, TILT = 0.003, 0.002, np.deg2rad(0.5)
"""Errors of masses (share), of places [m] and of the direction of gravity [rad] that careful hands
make: kitchen scales, calipers to a centre of mass without a mark, pinned mounts."""

CHANCE = 1e-6
"""Stated loads contradict each other where chance leaves so much over less often than that."""

LINEAR = 0.003
"""Share of its load to which no sensor is linear: data sheets say 0.002 to 0.005."""

EXPLAINED = 0.05
"""Share of the squared misfit that the others leave at most without a wrong data set."""

UNKNOWNS = 36
"""Numbers of the matrix on six channels."""

@dataclass(frozen=True)
class Stated:
    """
    What is measured and stated of the data sets to train on, and what Eq. 21 leaves over of it.

    Attributes
    ----------
    raw, gravity, ones : tuple of ndarray, shape (q, 6), (q, m), (q,)
        Pseudo-samples of channels without offset, of regressors and of the constant.
    root : ndarray
        Root of the covariance of [offset, raw of the first data set, of the second...].
    body : bool
        Whether one is unknown.
    """

    names: tuple[str, ...]
    raw: tuple[Array, ...]
    gravity: tuple[Array, ...]
    ones: tuple[Array, ...]
    loads: tuple[Load, ...]
    root: Array
    body: bool

    def without(self, number: int) -> 'Stated':
        """Leave a data set out."""
        keep = [k for k in range(len(self.names)) if k != number]
        owner = np.concatenate([np.full(6, -1), *(
            np.full(raw.size, k) for k, raw in enumerate(self.raw))])
        return Stated(
            tuple(self.names[k] for k in keep), tuple(self.raw[k] for k in keep),
            tuple(self.gravity[k] for k in keep), tuple(self.ones[k] for k in keep),
            tuple(self.loads[k] for k in keep), self.root[owner != number], self.body)

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Left and right side of Eq. 21."""
        design, right = eq.system(self.raw, self.gravity, self.loads)
        return design if self.body else design[:, :UNKNOWNS], right

    @cached_property
    def _solution(self) -> tuple[Array, Array]:
        """Least squares, and the directions of the equations that no unknown reaches (6 N, d)."""
        design, right = self.equations
        scale = np.linalg.norm(design, axis=0)
        scale[scale == 0] = 1.0
        u, s, vh = np.linalg.svd(design / scale, full_matrices=True)
        rank = int((s > RELATIVE * s[0]).sum())
        return vh[:rank].T @ (u[:, :rank].T @ right / s[:rank]) / scale, u[:, rank:]

    @property
    def matrix(self) -> Array:
        """Of least squares, shape (6, 6)."""
        return self._solution[0][:UNKNOWNS].reshape(6, 6).T

    @property
    def freedom(self) -> int:
        """Number of equations beyond the unknowns."""
        return int(self._solution[1].shape[1])

    @cached_property
    def chi2(self) -> float:
        """Squared misfit in units of noise and careful hands."""
        beside = self._solution[1]
        z = beside.T @ self.equations[1]
        J = beside.T @ np.hstack([*self._errors(), *self._turns()])
        covariance = J @ J.T + (beside.T * self._linear() ** 2) @ beside
        covariance += RELATIVE * np.trace(covariance) * np.eye(len(covariance))
        return float(z @ np.linalg.solve(covariance, z))

    @property
    def believable(self) -> bool:
        """Whether noise and careful hands leave as much."""
        return float(stats.chi2.sf(self.chi2, self.freedom)) > CHANCE

    @property
    def share(self) -> float:
        """Share of the known wrenches that is left over, forces and torques in their own sizes."""
        design, right = self.equations
        off, right = (one.reshape(-1, 6) for one in (design @ self._solution[0] - right, right))
        return float(max(np.linalg.norm(off[:, part]) / max(np.linalg.norm(right[:, part]), 1e-12)
                         for part in (slice(0, 3), slice(3, 6))))

    def load_of(self, raw: Array, gravity: Array) -> tuple[float, Array]:
        """Mass [kg] and place [m] that matrix and body give the pseudo-samples of another set."""
        total = eq.body_of(raw @ self.matrix.T, gravity)[:4]
        mass, *moment = total - (self._solution[0][UNKNOWNS:UNKNOWNS + 4] if self.body else 0.0)
        return float(mass), np.array(moment) / (mass or 1.0)

    def _errors(self) -> Iterator[Array]:
        """Columns of one standard deviation each: noise, masses, places."""
        ones = np.concatenate(self.ones)
        noise = self.root[6:].reshape(len(ones), 6, -1) - ones[:, None, None] * self.root[:6]
        yield np.einsum('ij,qjk->qik', self.matrix, noise).reshape(6 * len(ones), -1)
        starts = np.cumsum([0, *(6 * len(raw) for raw in self.raw)])
        heaviest = max(one.mass for one in self.loads)
        for k, load in enumerate(self.loads):
            for change in off_by(load, MASS * max(load.mass, heaviest / 10), PLACE):
                column = np.zeros((6 * len(ones), 1))
                column[starts[k]:starts[k + 1], 0] = eq.known_side(
                    self.gravity[k], change) - eq.known_side(self.gravity[k], load)
                yield column

    def _turns(self) -> Iterator[Array]:
        """Columns of the misfit's change by gravity that is turned about each axis."""
        if self.gravity[0].shape[1] == STATIC:
            for turn in TILT * np.eye(3):
                R = Rotation.from_rotvec(turn).as_matrix()
                design, right = replace(self, gravity=tuple(g @ R.T for g in self.gravity)
                                        ).equations
                plain, plain_right = self.equations
                yield ((design - plain) @ self._solution[0] - right + plain_right)[:, None]

    def _linear(self) -> Array:
        """Return what a sensor is not linear by in every equation."""
        wrench = np.vstack(self.raw) @ self.matrix.T
        size = np.repeat([np.linalg.norm(wrench[:, :3], axis=1).max(),
                          np.linalg.norm(wrench[:, 3:], axis=1).max()], 3)
        return np.asarray(np.tile(LINEAR * np.maximum(size, 1e-12), len(wrench)))


def off_by(load: Load, mass: float, place: float) -> Iterator[Load]:
    """Yield loads whose mass [kg], or place [m] along an axis, is off; nothing has no place."""
    yield replace(load, mass=load.mass + mass)
    if load.mass:
        for shift in place * np.eye(3):
            x, y, z = np.array(load.position) + shift
            yield replace(load, position=(float(x), float(y), float(z)))


class Contradiction(NamedTuple):
    """``words``, and ``share`` of the known wrenches left over."""

    words: str
    share: float


def contradiction(stated: Stated) -> Contradiction | None:
    """Say that stated loads cannot all be, and which data set does not fit; None where all do."""
    if stated.freedom == 0 or stated.believable:
        return None
    why = ('no single data set explains it: masses, places (in which frame?), loads exchanged, '
           'the direction of gravity (R_sensor_accelerometer, left-handed axes), the order of '
           'the channels, or a sensor that is not linear')
    rests = [stated.without(k) for k in range(len(stated.names))]
    fitting = [k for k, rest in enumerate(rests)
               if 0 < rest.freedom == stated.freedom - 6 * len(stated.raw[k])
               and (rest.believable or rest.chi2 < EXPLAINED * stated.chi2)]
    if fitting:
        k = min(fitting, key=lambda k: rests[k].chi2)
        load, (mass, place) = stated.loads[k], rests[k].load_of(stated.raw[k], stated.gravity[k])
        why = (f'all but {stated.names[k]} agree: by the others it has {mass:.3f} kg at '
               f'{_place(place)} m, stated {load.mass:g} kg at '
               f'{_place(np.array(load.position))} m; look at its load, its channels and its '
               'direction of gravity')
    return Contradiction(
        f'the stated loads contradict each other: the best matrix leaves {stated.share:.1%} of '
        f'their wrenches; {why}', stated.share)


def _place(values: Array) -> str:
    return '(' + ', '.join(f'{value:.3f}' for value in values) + ')'
