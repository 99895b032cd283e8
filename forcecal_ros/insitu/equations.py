"""Wrench of a rigid body as a linear map of the readings of accelerometer and gyro.

At rest the regressor is gravity alone, [Traversaro2014] Eq. 3-5. Its future work, motion, adds
angular acceleration and products of the angular rate: twelve numbers a sample, in which the wire
wrench (environment on tool) of a rigid body is still linear. The sensor's offset is then estimated
along with the matrix, as the wrench that the matrix makes of it: a thirteenth regressor, 1. (Apart
from it, a constant is almost in the span of twelve regressors when a limb swings like a pendulum.)

[Traversaro2014] Lemma 2 (three data sets at least) is necessary, not sufficient. The rank of
Eq. 21 states it. With a body of unknown mass, three data sets do when the total masses are not all
equal and the total centres of mass are not on one line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from typing import NamedTuple

from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.rigid_body import BodyMotion, INERTIAL, regressor
import numpy as np
from numpy.typing import ArrayLike

STATIC, MOVING = 3, 13
"""Number of regressors at rest and in motion."""

RELATIVE = 1e-9
"""Singular values below this share of the largest are rounding."""

_ELEMENTS = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
"""Rows and columns of xx, yy, zz, xy, xz, yz in a symmetric matrix."""


def moving_regressors(gravity: Array, omega: Array, alpha: Array, position: ArrayLike) -> Array:
    """
    Regressors in motion, for the sensor's origin.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        Minus the accelerometer's specific force, in the sensor frame [m/s^2].
    omega, alpha : ndarray, shape (n, 3)
        Angular rate [rad/s] and acceleration [rad/s^2], in the sensor frame.
    position : array_like, shape (3,)
        Of the accelerometer in the sensor frame [m].

    Returns
    -------
    ndarray, shape (n, 13)
        g - a of the sensor's origin, alpha, wx wx, wy wy, wz wz, wx wy, wx wz, wy wz, and 1.
    """
    p = np.broadcast_to(np.asarray(position, dtype=float), omega.shape)
    at_origin = gravity + np.cross(alpha, p) + np.cross(omega, np.cross(omega, p))
    products = omega[:, _ELEMENTS[0]] * omega[:, _ELEMENTS[1]]
    return np.concatenate([at_origin, alpha, products, np.ones((len(alpha), 1))], axis=1)


@cache
def body_basis(regressors: int) -> Array:
    """
    Return the maps of unit body parameters: mass, moment; in motion inertia and constant too.

    Parameters
    ----------
    regressors : int
        3 at rest, 13 in motion.

    Returns
    -------
    ndarray, shape (4, 6, 3) or (16, 6, 13)
        Read-only; see :func:`body_map`.
    """
    unit, none = np.eye(3), np.zeros((3, 3))
    both = unit[[0, 0, 1]] + unit[[1, 2, 2]]  # rates about two axes at once
    u, alpha, omega = (np.vstack(parts) for parts in (
        (unit, none, none, none), (none, unit, none, none), (none, none, unit, both)))
    wrench = regressor(BodyMotion(np.zeros(len(u)), u, omega, alpha))
    wrench[9:] -= wrench[[6, 6, 7]] + wrench[[7, 8, 8]]  # their product alone
    basis = np.zeros((INERTIAL + 6, 6, MOVING))
    basis[:INERTIAL, :, :-1] = wrench.transpose(2, 1, 0)
    basis[INERTIAL:, :, -1] = np.eye(6)
    if regressors == STATIC:
        basis = basis[:4, :, :STATIC].copy()
    basis.setflags(write=False)
    return basis


def body_map(theta: Array, regressors: int) -> Array:
    """
    Map of a body from its parameters; at rest M = [m I; m (c x)]. [Traversaro2014] Eq. 4-5.

    Parameters
    ----------
    theta : ndarray, shape (4,) or (16,)
        Mass [kg], moment [kg m]; in motion also inertia about the origin [kg m^2] and constant
        wrench [N, N m].

    Returns
    -------
    ndarray, shape (6, regressors)
        Gravity, or what moves, to wrench, both in the sensor frame.
    """
    return np.asarray(np.tensordot(theta, body_basis(regressors), 1))


@dataclass(frozen=True)
class Load:
    """An added mass [kg] and its centre of mass in the sensor frame [m]."""

    mass: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def parameters(self, regressors: int) -> Array:
        """Mass, moment and, in motion, inertia as a point mass and no constant: (4,) or (16,)."""
        p = np.array(self.position)
        still = np.array([self.mass, *(self.mass * p)])
        if regressors == STATIC:
            return still
        return np.concatenate([still, self.mass * _of_a_point(p), np.zeros(6)])


def _of_a_point(place: Array) -> Array:
    """Inertia xx, yy, zz, xy, xz, yz of a unit mass about the origin [m^2]."""
    return np.asarray(-(skew(place) @ skew(place))[_ELEMENTS])


class MatrixFit(NamedTuple):
    """
    Solution of [Traversaro2014] Eq. 21.

    Attributes
    ----------
    matrix : ndarray, shape (6, n)
        C: raw less offset to wire wrench.
    body : ndarray, shape (4,) or (16,)
        Mass [kg], moment [kg m]; in motion inertia about the sensor's origin [kg m^2] and C o.
    """

    matrix: Array
    body: Array


def total_map(body: Array, load: Load, regressors: int) -> Array:
    """
    Gravity to wrench of body and load, M_B + M_j. [Traversaro2014] Eq. 18.

    Parameters
    ----------
    body : ndarray, shape (4,) or (16,)
    regressors : int
        3 at rest, 13 in motion.

    Returns
    -------
    ndarray, shape (6, regressors)
    """
    return body_map(body + load.parameters(regressors), regressors)


def rows(raw: Array, gravity: Array) -> Array:
    """
    Rows of the 40 (52) unknowns, [r^T (x) I, -(g^T (x) I) P]. [Traversaro2014] Eq. 22-24.

    Parameters
    ----------
    raw : ndarray, shape (N, n)
        Offset removed.
    gravity : ndarray, shape (N, m)
        Three regressors at rest, thirteen in motion.

    Returns
    -------
    ndarray, shape (6 N, 6 n + 4) or (6 N, 6 n + 16)
        For [vec C; body], vec stacking columns (Eq. 1).
    """
    of_matrix = np.kron(raw, np.eye(6))
    of_body = np.einsum('pij,nj->nip', body_basis(gravity.shape[1]), gravity)
    return np.hstack([of_matrix, -of_body.reshape(len(of_matrix), -1)])


def known_side(gravity: Array, load: Load) -> Array:
    """
    Wrench of the added mass, M_j g, stacked. [Traversaro2014] Eq. 21, right side.

    Parameters
    ----------
    gravity : ndarray, shape (N, m)

    Returns
    -------
    ndarray, shape (6 N,)
    """
    regressors = gravity.shape[1]
    return (gravity @ body_map(load.parameters(regressors), regressors).T).ravel()


def system(raw: Sequence[Array], gravity: Sequence[Array], loads: Sequence[Load]
           ) -> tuple[Array, Array]:
    """
    Stack the equations of all data sets. [Traversaro2014] Eq. 21-23.

    Parameters
    ----------
    raw, gravity : sequence of ndarray, shape (N_j, n), (N_j, m)
        Offset removed from raw.

    Returns
    -------
    design : ndarray, shape (6 N, 6 n + 4) or (6 N, 6 n + 16)
    right : ndarray, shape (6 N,)
    """
    return (np.vstack([rows(r, g) for r, g in zip(raw, gravity)]),
            np.concatenate([known_side(g, load) for g, load in zip(gravity, loads)]))


def solve(raw: Sequence[Array], gravity: Sequence[Array], loads: Sequence[Load],
          channels: Array) -> MatrixFit:
    """
    Least-squares solution. [Traversaro2014] Eq. 21.

    Parameters
    ----------
    raw, gravity, loads
        As in :func:`system`.
    channels : ndarray, shape (n, 6)
        Combinations of the raw channels to use, from :func:`six_channels`.
    """
    design, right = system([r @ channels for r in raw], gravity, loads)
    scaled, scale = to_unit_columns(design)
    unknowns = np.linalg.lstsq(scaled, right, rcond=1e-10)[0] / scale
    return MatrixFit(unknowns[:36].reshape(6, 6).T @ channels.T, unknowns[36:])


def to_unit_columns(design: Array) -> tuple[Array, Array]:
    """Return a matrix with columns of length 1, or 0, and their lengths, or 1."""
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    return design / scale, scale


def six_channels(raw: Sequence[Array], noise: Array) -> Array:
    """
    Six combinations of the raw channels that hold the signal best against the noise.

    Six channels are scaled to unit noise only; of more, the other combinations hold no wrench.

    Parameters
    ----------
    raw : sequence of ndarray, shape (N_j, n)
        Offset removed.
    noise : ndarray, shape (n, n)
        Covariance.

    Returns
    -------
    ndarray, shape (n, 6)
    """
    whiten = np.linalg.inv(np.linalg.cholesky(noise)).T
    if len(noise) == 6:
        return np.asarray(whiten)
    _, _, vh = np.linalg.svd(np.vstack(raw) @ whiten)
    return np.asarray(whiten @ vh[:6].T)


def common_parameters(body: Array) -> Array:
    """
    Body parameters of common use.

    Returns
    -------
    ndarray, shape (4,) or (10,)
        Mass [kg], centre of mass [m]; in motion inertia about it, xx, yy, zz, xy, xz, yz [kg m^2].
    """
    com = body[1:4] / body[0]
    if len(body) == 4:
        return np.array([body[0], *com])
    return np.array([body[0], *com, *(body[4:INERTIAL] - body[0] * _of_a_point(com))])


def body_of(wrench: Array, gravity: Array) -> Array:
    """
    Parameters of the body that a calibrated sensor carries, [Traversaro2014] Eq. 3-5 inverted.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
    gravity : ndarray, shape (N, m)

    Returns
    -------
    ndarray, shape (4,) or (16,)
        Without a constant wrench: the offset is off.
    """
    design = -rows(np.empty((len(gravity), 0)), gravity)[:, :INERTIAL]
    found = np.linalg.lstsq(design, wrench.ravel(), rcond=1e-10)[0]
    return found if len(found) < INERTIAL else np.concatenate([found, np.zeros(6)])


class LoadEstimate(NamedTuple):
    """
    The load of one data set by a calibrated sensor.

    ``semi_axes`` (3,) of the ellipsoid of forces, longest first [N]; ``mass`` added, [kg];
    ``position`` (3,) of the added mass, NaN where there is none to speak of [m].
    """

    semi_axes: Array
    mass: float
    position: Array


def estimate_load(wrench: Array, gravity: Array, body: Array, magnitude: float,
                  with_position: bool) -> LoadEstimate:
    """
    Estimate the added mass and its position from a calibrated sensor. Tables I to III.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
        C (r - o) of the pseudo-samples.
    gravity : ndarray, shape (N, m)
    body : ndarray, shape (4,) or (16,)
        Without the added mass.
    magnitude : float
        Of gravity [m/s^2].
    with_position : bool
        False where nothing was added.
    """
    total = body_of(wrench, gravity)
    added = total - body
    position = added[1:4] / added[0] if with_position and added[0] else np.full(3, np.nan)
    in_motion = gravity[:, 3:] @ body_map(total, gravity.shape[1])[:3, 3:].T
    by_gravity = np.linalg.lstsq(gravity[:, :3], wrench[:, :3] - in_motion, rcond=1e-10)[0]
    axes = magnitude * np.linalg.svd(by_gravity, compute_uv=False)
    return LoadEstimate(axes, float(added[0]), position)


# Whether added masses determine the matrix -------------------------------------------------------

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
    # singular values below this many times what noise alone would make do not count
    factor = 1.5
    return _report(design, factor * (np.sqrt(count) + np.sqrt(6)))


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


def require(loads: Sequence[Load], regressors: int = STATIC) -> None:
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
            f'{", ".join(report.undetermined)} undetermined; add {_advice(loads, regressors)}')


def _counted(loads: Sequence[Load]) -> str:
    masses = len({round(load.mass, 6) for load in loads})
    places = len({load.position for load in loads if load.mass})
    return (f'{len(loads)} training data set{"s" * (len(loads) != 1)} with {masses} different '
            f'added mass{"es" * (masses != 1)} at {places} position{"s" * (places != 1)}')


def _advice(loads: Sequence[Load], regressors: int) -> str:
    """Try what could be added, fewest data sets first, and name the first that is enough."""
    heaviest = max(loads, key=lambda load: load.mass, default=Load(0.0))
    mass = heaviest.mass or 1.0
    x, y, z = heaviest.position if heaviest.mass else (0.1, 0.0, 0.2)
    reach = max(float(np.linalg.norm((x, y, z))), 0.1)
    offers = [
        ('a data set with no added mass', Load(0.0)),
        ('a data set with another mass', Load(2 * mass, (x, y, z))),
        ('a data set with the mass at another position, off the line of the others',
         Load(mass, (x + 0.31 * reach, y - 0.53 * reach, z + 0.17 * reach))),
        ('a data set with the mass at a further position',
         Load(mass, (x - 0.43 * reach, y - 0.29 * reach, z + 0.61 * reach))),
        ('a data set with another mass at another position',
         Load(2 * mass, (x + 0.37 * reach, y + 0.47 * reach, z - 0.23 * reach))),
    ]
    if any(load.mass == 0 for load in loads):
        offers = offers[1:]
    for size in range(1, len(offers) + 1):
        for chosen in combinations(offers, size):
            report = structural_rank([*loads, *(load for _, load in chosen)], regressors)
            if report.rank == report.unknowns:
                return ' and '.join(words for words, _ in chosen)
    return 'data sets with different masses at different positions'


MASS, PLACE = 0.003, 0.002
"""Errors of masses (share) and of places [m] that careful hands make: kitchen scales, calipers to
a centre of mass without a mark."""

POOR, GROSS = 0.02, 0.05
"""Share of its range by which a poor sensor is off a linear map, and of the known wrenches that
loads which agree leave over at most: careful hands leave 0.005. What leaves more than the second,
or an offset that moves by more, is no usual sensor: a bent one's moves by 0.03."""


class Contradiction(NamedTuple):
    """``words``, and ``share`` of the known wrenches left over."""

    words: str
    share: float


def off_by(load: Load, mass: float, place: float) -> Iterator[Load]:
    """Yield loads whose mass [kg], or place [m] along an axis, is off; nothing has no place."""
    yield replace(load, mass=load.mass + mass)
    if load.mass:
        for shift in place * np.eye(3):
            x, y, z = np.array(load.position) + shift
            yield replace(load, position=(float(x), float(y), float(z)))


def contradiction(names: Sequence[str], raw: Sequence[Array], gravity: Sequence[Array],
                  loads: Sequence[Load], noise: Sequence[Array], body: bool
                  ) -> Contradiction | None:
    """
    Say that stated loads cannot all be, and which data set does not fit; None where all do.

    Parameters
    ----------
    names : sequence of str
        Of the data sets to train on.
    raw, gravity, loads
        As in :func:`system`, raw of six combinations of channels.
    noise : sequence of ndarray, shape (2,)
        Square of the forces, and of the torques, that noise makes of all pseudo-samples of each.
    body : bool
        Whether an unknown one hangs there.
    """
    def misfit(*used: int) -> tuple[float, Array, int]:
        """Share of the known wrenches that Eq. 21 leaves, forces and torques by themselves."""
        design, right = system([raw[k] for k in used], [gravity[k] for k in used],
                               [loads[k] for k in used])
        scaled, scale = to_unit_columns(design if body else design[:, :36])
        solution, _, rank, _ = np.linalg.lstsq(scaled, right, rcond=RELATIVE)
        off, known = ((one.reshape(-1, 2, 3)**2).sum(axis=(0, 2)) for one in (
            scaled @ solution - right, right))
        # what is left is not noise beyond so many of its standard deviations
        sigmas = 3.0
        off = np.maximum(off - sigmas**2 * np.sum([noise[k] for k in used], axis=0), 0.0)
        return float(np.sqrt((off / np.maximum(known, 1e-24)).max())), solution / scale, int(rank)

    every = range(len(names))
    whole, _, rank = misfit(*every)
    if whole < POOR:
        return None
    why = ('no single data set is the cause; check masses, positions and their frame, swapped '
           'loads, the direction of gravity (R_sensor_accelerometer, left-handed axes), the order '
           'of channels, and whether the sensor is linear')
    rests = [misfit(*every[:k], *every[k + 1:]) for k in every]
    # share of the misfit that the other data sets leave at most without a wrong one
    most_left = 0.2
    fitting = [(rest[0], k) for k, rest in enumerate(rests)
               if rest[2] == rank and rest[0] < most_left * whole]
    if fitting:
        _, k = min(fitting)
        _, solution, _ = rests[k]
        total = body_of(raw[k] @ solution[:36].reshape(6, 6), gravity[k])[:4]
        mass, *moment = total - solution[36:40] if body else total
        why = (f'all data sets except {names[k]} agree: they give its load as {mass:.3f} kg '
               f'at {_place(np.array(moment) / (mass or 1.0))} m; stated are '
               f'{loads[k].mass:g} kg at {_place(np.array(loads[k].position))} m; check its load, '
               'its channels and its direction of gravity')
    return Contradiction(
        f'the stated loads contradict each other: the best matrix leaves {whole:.1%} of their '
        f'wrenches unexplained; {why}', whole)


def _place(values: Array) -> str:
    return '(' + ', '.join(f'{value:.3f}' for value in values) + ')'
