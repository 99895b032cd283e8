"""
Whether the stated loads agree with each other.

[Traversaro2014] Eq. 21 has more rows than unknowns. What they leave over is compared with the
noise and with what masses and places are off by when they are weighed and measured with care.
Where it is more, each data set in turn is held against what all others say of its load.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu import matrix as eq
from forcecal_ros.insitu.matrix import Load
from forcecal_ros.insitu.motion import STATIC
import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

MASS, PLACE, TILT = 0.003, 0.002, np.deg2rad(0.5)
"""Errors of masses (share), of places [m] and of the direction of gravity [rad] that careful hands
make: kitchen scales, calipers to a centre of mass that nobody marked, pinned mounts."""

CHANCE = 1e-6
"""Stated loads contradict each other where chance leaves so much over less often than that."""

LINEAR = 0.003
"""Share of its load to which no sensor is linear: data sheets say 0.002 to 0.005."""

EXPLAINED = 0.05
"""Share of the squared misfit that the others leave at most without a wrong data set."""

UNKNOWNS = 36
"""Numbers of the matrix on six channels."""

RELATIVE = 1e-9
"""Singular values below this share of the largest are rounding."""


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
        names, raw, gravity, ones, loads = (tuple(one[k] for k in keep) for one in (
            self.names, self.raw, self.gravity, self.ones, self.loads))
        return Stated(names, raw, gravity, ones, loads, self.root[owner != number], self.body)

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
               f'{_place(np.array(load.position))} m; look at its load, its channels and its direction of gravity')
    return Contradiction(
        f'the stated loads contradict each other: the best matrix leaves {stated.share:.1%} of '
        f'their wrenches; {why}', stated.share)


def _place(values: Array) -> str:
    return '(' + ', '.join(f'{value:.3f}' for value in values) + ')'
