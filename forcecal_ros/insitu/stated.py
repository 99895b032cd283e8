"""Whether the stated loads agree with each other.

[Traversaro2014] Eq. 21 has more rows than unknowns. What they leave over is compared with the
noise and with what masses and places are off by when they are weighed and measured with care.
Where it is more, loads, data sets and frames are tried that would make it no more.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, permutations, product
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu import matrix as eq
from forcecal_ros.insitu.matrix import Load
from forcecal_ros.insitu.motion import load_parameters, STATIC
import numpy as np
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

MASS, PLACE, TILT = 0.003, 0.002, np.deg2rad(0.5)
"""Errors of masses (share), of places [m] and of the direction of gravity [rad] that careful hands
make: kitchen scales, calipers to a centre of mass that nobody marked, pinned mounts."""

CHANCE = 1e-6
"""Stated loads contradict each other where chance leaves so much over less often than that."""

TURNED = np.deg2rad(2.0)
"""Smaller turns of gravity against the places are those of mounts [rad]."""

LINEAR = 0.003
"""Share of its load to which no sensor is linear: data sheets say 0.002 to 0.005."""

EXPLAINED = 0.05
"""Share of the squared misfit that the true cause leaves at most, where further errors remain."""

NO_FORCE = 0.7
"""Forces smaller than this share of those of the loads belong to a body of negative mass: with all
else free, a matrix of zeros explains everything."""

UNKNOWNS = 36
"""Numbers of the matrix on six channels."""

RELATIVE = 1e-9
"""Singular values below this share of the largest are rounding."""


class Stated(NamedTuple):
    """
    Pseudo-samples of the data sets to train on, and what is stated of each.

    ``raw`` (q, 6) channels without offset; ``gravity`` (q, m); ``ones`` (q,); ``root`` of the
    covariance of [offset, raw of the first data set, of the second...]; ``body`` whether one is
    unknown.
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
        rows = np.concatenate([np.arange(6), *(
            np.arange(self._start(k), self._start(k + 1)) for k in keep)])
        return Stated(
            tuple(self.names[k] for k in keep), tuple(self.raw[k] for k in keep),
            tuple(self.gravity[k] for k in keep), tuple(self.ones[k] for k in keep),
            tuple(self.loads[k] for k in keep), self.root[rows], self.body)

    def swapped(self, one: int, other: int) -> 'Stated':
        """Exchange the loads of two data sets."""
        loads = list(self.loads)
        loads[one], loads[other] = loads[other], loads[one]
        return self._replace(loads=tuple(loads))

    def turned(self, R: Array) -> 'Stated':
        """Turn gravity."""
        return self._replace(gravity=tuple(g @ R.T for g in self.gravity))

    def _start(self, number: int) -> int:
        return 6 + sum(raw.size for raw in self.raw[:number])


@dataclass(frozen=True)
class Misfit:
    """
    What the equations leave over.

    Attributes
    ----------
    free : int or None
        Data set whose load is estimated along.
    """

    stated: Stated
    free: int | None = None

    @cached_property
    def equations(self) -> tuple[Array, Array]:
        """Left and right side."""
        design, right = eq.system(self.stated.raw, self.stated.gravity, self.stated.loads)
        of_body, design = design[:, UNKNOWNS:], design[:, :UNKNOWNS]
        columns = [design, of_body] if self.stated.body else [design]
        if self.free is not None:
            rows = np.concatenate([np.full(6 * len(raw), k == self.free)
                                   for k, raw in enumerate(self.stated.raw)])
            columns.append(of_body[:, :4] * rows[:, None])
        return np.hstack(columns), right

    @cached_property
    def _solution(self) -> tuple[Array, Array]:
        """Least squares, and the directions of the equations that no unknown reaches (6 N, d)."""
        design, right = self.equations
        scale = np.linalg.norm(design, axis=0)
        scale[scale == 0] = 1.0
        u, s, vh = np.linalg.svd(design / scale, full_matrices=True)
        rank = int((s > RELATIVE * s[0]).sum())
        unknowns = vh[:rank].T @ (u[:, :rank].T @ right / s[:rank]) / scale
        return unknowns, u[:, rank:]

    @property
    def unknowns(self) -> Array:
        """Matrix, body and free load."""
        return self._solution[0]

    @property
    def freedom(self) -> int:
        """Number of equations beyond the unknowns."""
        return int(self._solution[1].shape[1])

    @property
    def size(self) -> float:
        """Root of the squared misfit, forces and torques alike."""
        return float(np.linalg.norm(self._solution[1].T @ self.equations[1]))

    @cached_property
    def chi2(self) -> float:
        """Squared misfit in units of noise and careful hands."""
        right = self.equations[1]
        z = self._solution[1].T @ right
        return float(z @ np.linalg.solve(self._covariance, z))

    @cached_property
    def _covariance(self) -> Array:
        """Of the misfit along the directions that no unknown reaches."""
        beside = self._solution[1]
        J = beside.T @ np.hstack([*self._errors(), *(TILT * one for one in self._turns())])
        covariance = J @ J.T + (beside.T * self._linear() ** 2) @ beside
        return np.asarray(covariance + RELATIVE * np.trace(covariance) * np.eye(len(covariance)))

    def turn(self) -> tuple[Array, bool]:
        """Small turn of gravity that makes the misfit least [rad], and whether it is no chance."""
        columns = list(self._turns())
        if not columns:
            return np.zeros(3), False
        beside, right = self._solution[1], self.equations[1]
        J = beside.T @ np.hstack(columns)
        weighted = np.linalg.solve(self._covariance, J)
        step = np.linalg.solve(J.T @ weighted, weighted.T @ (beside.T @ right))
        gain = float(step @ (J.T @ weighted) @ step)
        return step, float(stats.chi2.sf(gain, 3)) < CHANCE

    @property
    def believable(self) -> bool:
        """Whether noise and careful hands leave as much."""
        return self.possible and float(stats.chi2.sf(self.chi2, self.freedom)) > CHANCE

    @property
    def possible(self) -> bool:
        """Whether there are equations left, and forces as large as those of the loads alone."""
        wrench = np.vstack(self.stated.raw) @ self.unknowns[:UNKNOWNS].reshape(6, 6)
        known = self.equations[1].reshape(-1, 6)
        return self.freedom > 0 and bool(
            np.linalg.norm(wrench[:, :3]) > NO_FORCE * np.linalg.norm(known[:, :3]))

    @property
    def share(self) -> float:
        """Share of the known wrenches that is left over, forces and torques in their own sizes."""
        design, right = self.equations
        off, right = (design @ self.unknowns - right).reshape(-1, 6), right.reshape(-1, 6)
        shares = [np.linalg.norm(off[:, part]) / max(np.linalg.norm(right[:, part]), 1e-12)
                  for part in (slice(0, 3), slice(3, 6))]
        return float(max(shares))

    def _errors(self) -> Iterator[Array]:
        """Columns of one standard deviation each: noise, masses, places."""
        s, C = self.stated, self.unknowns[:UNKNOWNS].reshape(6, 6).T
        ones = np.concatenate(s.ones)
        noise = s.root[6:].reshape(len(ones), 6, -1) - ones[:, None, None] * s.root[:6]
        yield np.einsum('ij,qjk->qik', C, noise).reshape(6 * len(ones), -1)
        starts = np.cumsum([0, *(6 * len(raw) for raw in s.raw)])
        heaviest = max(one.mass for one in s.loads)
        for k, load in enumerate(s.loads):
            for change in off_by(load, MASS * max(load.mass, heaviest / 10), PLACE):
                column = np.zeros((6 * len(ones), 1))
                column[starts[k]:starts[k + 1], 0] = eq.known_side(
                    s.gravity[k], change) - eq.known_side(s.gravity[k], load)
                yield column

    def _turns(self) -> Iterator[Array]:
        """Columns of the misfit's change by a turn of gravity about each axis, of one radian."""
        s, small = self.stated, 1e-4
        if s.gravity[0].shape[1] == STATIC:
            plain = self._misfit_of(s)
            for turn in small * np.eye(3):
                R = Rotation.from_rotvec(turn).as_matrix()
                yield ((self._misfit_of(s.turned(R)) - plain) / small)[:, None]

    def _linear(self) -> Array:
        """Return what a sensor is not linear by in every equation."""
        C = self.unknowns[:UNKNOWNS].reshape(6, 6).T
        wrench = np.vstack(self.stated.raw) @ C.T
        size = np.repeat([np.linalg.norm(wrench[:, :3], axis=1).max(),
                          np.linalg.norm(wrench[:, 3:], axis=1).max()], 3)
        return np.asarray(np.tile(LINEAR * np.maximum(size, 1e-12), len(wrench)))

    def _misfit_of(self, stated: Stated) -> Array:
        design, right = Misfit(stated, self.free).equations
        return np.asarray(design @ self.unknowns - right)

    @property
    def free_load(self) -> tuple[float, Array]:
        """Mass [kg] and place [m] of the load that is free."""
        assert self.free is not None
        stated = load_parameters(self.stated.loads[self.free].mass,
                                 self.stated.loads[self.free].position, STATIC)[:4]
        mass, *moment = stated + self.unknowns[-4:]
        return float(mass), np.array(moment) / (mass or 1.0)


def off_by(load: Load, mass: float, place: float) -> Iterator[Load]:
    """Yield loads whose mass [kg], or place [m] along an axis, is off; nothing has no place."""
    yield replace(load, mass=load.mass + mass)
    if load.mass:
        for shift in place * np.eye(3):
            x, y, z = np.array(load.position) + shift
            yield replace(load, position=(float(x), float(y), float(z)))


class Explanation(NamedTuple):
    """What would make stated loads agree: ``extra`` numbers that it takes, and how it is said."""

    misfit: Misfit
    extra: int
    words: str

    @property
    def score(self) -> float:
        """Squared misfit and what the extra numbers cost (Bayes' information criterion)."""
        return self.misfit.chi2 + self.extra * float(np.log(6 * sum(
            len(raw) for raw in self.misfit.stated.raw)))


class Contradiction(NamedTuple):
    """``words``; ``share`` of the known wrenches left over; ``explained``: a cause is named."""

    words: str
    share: float
    explained: bool


def contradiction(stated: Stated) -> Contradiction | None:
    """Say what of the stated loads, data sets and frames cannot be; None where all agree."""
    found = Misfit(stated)
    if found.freedom == 0:
        return None
    turn, sure = found.turn()
    if found.believable and not (sure and np.linalg.norm(turn) > TURNED):
        return None
    causes = list(_explanations(stated, found.freedom))
    if sure:
        R = Rotation.from_rotvec(turn).as_matrix()
        causes.append(Explanation(Misfit(stated.turned(R)), 3, _of_turn(R)))
    if stated.gravity[0].shape[1] == STATIC and not any(one.misfit.believable for one in causes):
        causes.append(_nearest_turn(stated, np.eye(3)))
    causes = [one for one in causes if one.misfit.believable
            or (one.misfit.possible and one.misfit.chi2 < EXPLAINED * found.chi2)]
    best = min(causes, key=lambda one: one.score, default=None)
    why = best.words if best else (
        'no single data set or turned frame explains it: masses, places (in which frame?), the '
        'direction of gravity, the order of the channels, or a sensor that is not linear')
    return Contradiction(
        f'the stated loads contradict each other: the best matrix leaves {found.share:.1%} of '
        f'their wrenches; {why}', found.share, best is not None)


def _explanations(stated: Stated, freedom: int) -> Iterator[Explanation]:
    for one, other in combinations(range(len(stated.names)), 2):
        if stated.loads[one] != stated.loads[other]:
            yield Explanation(Misfit(stated.swapped(one, other)), 2, (
                f'they agree with the loads of {stated.names[one]} and {stated.names[other]} '
                'exchanged'))
    if stated.gravity[0].shape[1] == STATIC:
        turned = min(_quarter_turns(), key=lambda R: Misfit(stated.turned(R)).size)
        yield Explanation(Misfit(stated.turned(turned)), 3, _of_turn(turned))
    for k, name in enumerate(stated.names):
        free, rest = Misfit(stated, k), Misfit(stated.without(k))
        equations = 6 * len(stated.raw[k])
        if free.freedom == freedom - 4:
            yield Explanation(free, 4, _of_load(stated, k, free))
        if rest.freedom == freedom - equations:
            yield Explanation(rest, equations, (
                f'they agree without {name}: its channels (in another order, dead, of another '
                'sensor), its direction of gravity or its load is wrong'))


def _of_load(stated: Stated, number: int, free: Misfit) -> str:
    mass, place = free.free_load
    load, name = stated.loads[number], stated.names[number]
    if mass < 0:
        return f'by the others gravity points the other way in {name}: is its sign another there?'
    words = (f'by the others {name} has {mass:.3f} kg at {_place(place)} m, '
             f'stated {load.mass:g} kg at {_place(np.array(load.position))} m')
    for other, one in zip(stated.names, stated.loads):
        if other != name and one.mass and abs(mass - one.mass) < 3 * MASS * one.mass \
                and np.abs(place - one.position).max() < 3 * PLACE:
            words += f'; that is the load of {other}: the same recording twice?'
    return words


def _place(values: Array) -> str:
    return '(' + ', '.join(f'{value:.3f}' for value in values) + ')'


def _quarter_turns() -> Iterator[Array]:
    """All right-handed ways to name axes but the one as it is."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.diag(signs)[list(order)]
            if np.linalg.det(R) > 0 and not np.array_equal(R, np.eye(3)):
                yield R


def _nearest_turn(stated: Stated, start: Array) -> Explanation:
    def turn(vector: Array) -> Array:
        return np.asarray(Rotation.from_rotvec(vector).as_matrix() @ start)

    found = optimize.minimize(
        lambda vector: Misfit(stated.turned(turn(vector))).size, np.zeros(3),
        method='Nelder-Mead', options={'maxfev': 150, 'initial_simplex': np.vstack(
            [np.zeros(3), 0.3 * np.eye(3)])})
    R = turn(found.x)
    return Explanation(Misfit(stated.turned(R)), 5, _of_turn(R))


def _of_turn(R: Array) -> str:
    """Minus gravity turns all wrenches around, which no stated load contradicts."""
    vector = Rotation.from_matrix(R).as_rotvec(degrees=True)
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle
    words = (f'they agree with gravity turned by {angle:.0f} deg about ({x:.2f}, {y:.2f}, '
             f'{z:.2f}) of the sensor frame: the accelerometer is mounted so '
             '(R_sensor_accelerometer), or places are in a frame that is turned')
    mirrored = np.argwhere(np.abs(np.abs(R) - 1) < 1e-6)
    if len(mirrored) == 3:
        signs = (-R).round().astype(int)
        axes = ', '.join('-' * int(row.sum() < 0) + 'xyz'[int(np.abs(row).argmax())]
                         for row in signs)
        words += f', or its axes are left-handed ({axes} where x, y, z are stated)'
    return words
