"""Whether the added masses determine the matrix: the rank of the 40 unknowns.

[Traversaro2014] Lemma 2 (three data sets at least) is necessary, not sufficient. The rank of
Eq. 21 states it. With a body of unknown mass, three data sets do when the total masses are not all
equal and the total centres of mass are not on one line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu import equations as eq
from forcecal_ros.insitu.equations import (
    Load,
    RELATIVE,
    STATIC,
    system,
    to_unit_columns,
    total_map,
)
import numpy as np

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
    body = Load(2.7 * size, (0.11 * reach, -0.23 * reach, 0.37 * reach)).parameters(regressors)
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


MASS, PLACE = 0.003, 0.002
"""Errors of masses (share) and of places [m] that careful hands make: kitchen scales, calipers to
a centre of mass without a mark."""

MISFIT = 0.02
"""Share of the known wrenches that loads which agree leave over at most: careful hands
leave 0.005, sensors that are not linear up to 0.02."""

NOISE_SIGMA = 3.0
"""What is left is not noise beyond so many of its standard deviations."""

EXPLAINED = 0.2
"""Share of the misfit that the other data sets leave at most without a wrong one."""


class Stated(NamedTuple):
    """
    A data set to train on.

    Attributes
    ----------
    raw, gravity : ndarray, shape (q, 6), (q, m)
        Pseudo-samples of six combinations of channels without offset, and of the regressors.
    noise : ndarray, shape (2,)
        Square of the forces, and of the torques, that noise makes of all of them.
    """

    name: str
    raw: Array
    gravity: Array
    load: Load
    noise: Array


class Contradiction(NamedTuple):
    """``words``, and ``share`` of the known wrenches left over."""

    words: str
    share: float


class _Misfit(NamedTuple):
    """Least squares of Eq. 21: share of the known wrenches that it leaves, solution and rank."""

    share: float
    solution: Array
    rank: int


def off_by(load: Load, mass: float, place: float) -> Iterator[Load]:
    """Yield loads whose mass [kg], or place [m] along an axis, is off; nothing has no place."""
    yield replace(load, mass=load.mass + mass)
    if load.mass:
        for shift in place * np.eye(3):
            x, y, z = np.array(load.position) + shift
            yield replace(load, position=(float(x), float(y), float(z)))


def contradiction(stated: Sequence[Stated], body: bool) -> Contradiction | None:
    """
    Say that stated loads cannot all be, and which data set does not fit; None where all do.

    Parameters
    ----------
    body : bool
        Whether an unknown one hangs there.
    """
    whole = _misfit(stated, body)
    if whole.share < MISFIT:
        return None
    why = ('no single data set explains it: masses, places (in which frame?), loads exchanged, '
           'the direction of gravity (R_sensor_accelerometer, left-handed axes), the order of '
           'the channels, or a sensor that is not linear')
    rests = [_misfit([*stated[:k], *stated[k + 1:]], body) for k in range(len(stated))]
    fitting = [(rest.share, k) for k, rest in enumerate(rests)
               if rest.rank == whole.rank and rest.share < EXPLAINED * whole.share]
    if fitting:
        _, k = min(fitting)
        name, raw, gravity, load, _ = stated[k]
        matrix, unknown = rests[k].solution[:36].reshape(6, 6).T, rests[k].solution[36:40]
        total = eq.body_of(raw @ matrix.T, gravity)[:4]
        mass, *moment = total - unknown if body else total
        why = (f'all but {name} agree: by the others it has {mass:.3f} kg at '
               f'{_place(np.array(moment) / (mass or 1.0))} m, stated {load.mass:g} kg at '
               f'{_place(np.array(load.position))} m; look at its load, its channels and its '
               'direction of gravity')
    return Contradiction(
        f'the stated loads contradict each other: the best matrix leaves {whole.share:.1%} of '
        f'their wrenches; {why}', whole.share)


def _misfit(stated: Sequence[Stated], body: bool) -> _Misfit:
    """Solve Eq. 21, and compare what is left of forces and torques in their own sizes."""
    _, raw, gravity, loads, noise = zip(*stated)
    design, right = system(raw, gravity, loads)
    design = design if body else design[:, :36]
    scaled, scale = to_unit_columns(design)
    solution, _, rank, _ = np.linalg.lstsq(scaled, right, rcond=RELATIVE)
    solution = solution / scale
    off, known = ((one.reshape(-1, 2, 3)**2).sum(axis=(0, 2)) for one in (
        design @ solution - right, right))
    off = np.maximum(off - NOISE_SIGMA**2 * np.sum(noise, axis=0), 0.0)
    return _Misfit(float(np.sqrt((off / np.maximum(known, 1e-24)).max())), solution, int(rank))


def _place(values: Array) -> str:
    return '(' + ', '.join(f'{value:.3f}' for value in values) + ')'
