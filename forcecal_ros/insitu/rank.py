"""Whether the added masses determine the matrix: the rank of the 40 unknowns.

[Traversaro2014] Lemma 2 (three data sets at least) is necessary, not sufficient. The rank of
Eq. 21 says it. With a body of unknown mass, three data sets do when the total masses are not all
equal and the total centres of mass are not on one line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.matrix import Load, system, total_map
from forcecal_ros.insitu.motion import load_parameters, STATIC
import numpy as np

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
        The rank is short; the message says by how much, what is open and what to add.
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
