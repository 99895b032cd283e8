"""Wrench of a rigid body as a linear map of the readings of accelerometer and gyro.

At rest the regressor is gravity alone, [Traversaro2014] Eq. 3-5. Its future work, motion, adds
angular acceleration and products of the angular rate: twelve numbers a sample, in which the wire
wrench (environment on tool) of a rigid body is still linear. The sensor's offset is then estimated
along with the matrix, as the wrench that the matrix makes of it: a thirteenth regressor, 1. (Apart
from it, a constant is almost in the span of twelve regressors when a limb swings like a pendulum.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, skew
import numpy as np
from numpy.typing import ArrayLike

STATIC, MOVING = 3, 13
"""Number of regressors at rest and in motion."""

PHYSICAL = 10
"""Parameters of a rigid body: mass, moment, inertia."""

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


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
    products = np.stack([omega[:, i] * omega[:, j] for i, j in _PAIRS], axis=1)
    return np.concatenate([at_origin, alpha, products, np.ones((len(alpha), 1))], axis=1)


def gravity_map(mass: float, moment: ArrayLike) -> Array:
    """
    M of [Traversaro2014] Eq. 4-5, M = [m I; m (c x)]: gravity to wrench, both in the sensor frame.

    Parameters
    ----------
    mass : float
        [kg]
    moment : array_like, shape (3,)
        Mass times centre of mass [kg m].

    Returns
    -------
    ndarray, shape (6, 3)
    """
    return np.vstack([mass * np.eye(3), skew(moment)])


def motion_map(mass: float, moment: ArrayLike, inertia: ArrayLike, constant: ArrayLike) -> Array:
    """
    Extend :func:`gravity_map` to motion, on the thirteen regressors.

    Parameters
    ----------
    mass : float
        [kg]
    moment : array_like, shape (3,)
        Mass times centre of mass [kg m].
    inertia : array_like, shape (6,)
        xx, yy, zz, xy, xz, yz about the sensor's origin [kg m^2].
    constant : array_like, shape (6,)
        Wrench that is always there: what the matrix makes of the sensor's offset [N, N m].

    Returns
    -------
    ndarray, shape (6, 13)
    """
    h = np.asarray(moment, dtype=float)
    J = inertia_matrix(inertia)
    out = np.zeros((6, MOVING))
    out[:, :3] = gravity_map(mass, h)
    out[:3, 3:6] = skew(h)
    out[3:, 3:6] = -J
    for k, (i, j) in enumerate(_PAIRS):
        symmetric = np.zeros((3, 3))
        symmetric[i, j] = symmetric[j, i] = 1.0
        square = symmetric - np.trace(symmetric) * np.eye(3)
        out[:3, 6 + k] = -square @ h
        out[3:, 6 + k] = -_rate_torque(i, j, J)
    out[:, 12] = constant
    return out


def _rate_torque(i: int, j: int, J: Array) -> Array:
    """Part of omega x J omega that goes with the product of rates i and j."""
    e = np.eye(3)
    torque = np.cross(e[i], J @ e[j])
    return torque if i == j else torque + np.cross(e[j], J @ e[i])


def inertia_matrix(inertia: ArrayLike) -> Array:
    """Return the symmetric matrix of xx, yy, zz, xy, xz, yz [kg m^2]."""
    J = np.zeros((3, 3))
    for value, (i, j) in zip(np.asarray(inertia, dtype=float), _PAIRS):
        J[i, j] = J[j, i] = value
    return J


def inertia_vector(matrix: ArrayLike) -> Array:
    """Return xx, yy, zz, xy, xz, yz of a symmetric matrix [kg m^2]."""
    return np.array([np.asarray(matrix)[i, j] for i, j in _PAIRS])


def point_inertia(mass: float, position: ArrayLike) -> Array:
    """Return xx, yy, zz, xy, xz, yz of a point mass about the origin [kg m^2]."""
    p = np.asarray(position, dtype=float)
    return inertia_vector(mass * (p @ p * np.eye(3) - np.outer(p, p)))


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
    if regressors == STATIC:
        basis = np.stack([gravity_map(unit[0], unit[1:]) for unit in np.eye(4)])
    else:
        basis = np.stack([motion_map(unit[0], unit[1:4], unit[4:10], unit[10:])
                          for unit in np.eye(PHYSICAL + 6)])
    basis.setflags(write=False)
    return basis


def body_map(theta: Array, regressors: int) -> Array:
    """
    Map of a body from its parameters, in which it is linear.

    Parameters
    ----------
    theta : ndarray, shape (4,) or (16,)
        Mass [kg], moment [kg m]; in motion also inertia about the origin [kg m^2] and constant
        wrench [N, N m].

    Returns
    -------
    ndarray, shape (6, regressors)
    """
    return np.asarray(np.tensordot(theta, body_basis(regressors), 1))


def load_parameters(mass: float, position: ArrayLike, regressors: int) -> Array:
    """Return the parameters of an added point mass, shape (4,) at rest or (16,) in motion."""
    p = np.asarray(position, dtype=float)
    still = np.concatenate([[mass], mass * p])
    if regressors == STATIC:
        return still
    return np.concatenate([still, point_inertia(mass, p), np.zeros(6)])


@dataclass(frozen=True)
class Load:
    """An added mass [kg] and its centre of mass in the sensor frame [m]."""

    mass: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def parameters(self, regressors: int) -> Array:
        """Mass, moment and, in motion, inertia as a point mass."""
        return load_parameters(self.mass, self.position, regressors)


@dataclass(frozen=True)
class MatrixFit:
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
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    unknowns = np.linalg.lstsq(design / scale, right, rcond=1e-10)[0] / scale
    return MatrixFit(unknowns[:36].reshape(6, 6).T @ channels.T, unknowns[36:])


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


def centre_of_mass(body: Array) -> Array:
    """Centre of mass of body parameters, shape (3,) [m]."""
    return np.asarray(body[1:4] / body[0])


def inertia_about_com(body: Array) -> Array | None:
    """Inertia of body parameters about the centre of mass, shape (3, 3); None at rest."""
    if len(body) == 4:
        return None
    shift = point_inertia(float(body[0]), centre_of_mass(body))
    return inertia_matrix(body[4:10] - shift)


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
    design = -rows(np.empty((len(gravity), 0)), gravity)[:, :PHYSICAL]
    found = np.linalg.lstsq(design, wrench.ravel(), rcond=1e-10)[0]
    return found if len(found) < PHYSICAL else np.concatenate([found, np.zeros(6)])


class LoadEstimate(NamedTuple):
    """
    The load of one data set by a calibrated sensor.

    ``semi_axes`` (3,) of the ellipsoid of forces, longest first [N]; ``mass`` added, [kg];
    ``position`` (3,) of the added mass, NaN where there is none to speak of [m].
    """

    semi_axes: Array
    mass: float
    position: Array


def force_map(wrench: Array, gravity: Array, total: Array) -> Array:
    """
    Linear map from gravity to the measured force, what motion adds removed.

    Parameters
    ----------
    wrench : ndarray, shape (N, 6)
    gravity : ndarray, shape (N, m)
    total : ndarray, shape (4,) or (16,)
        Body with what is added to it.

    Returns
    -------
    ndarray, shape (3, 3)
        Mass times identity for a perfect sensor [kg].
    """
    motion = gravity[:, 3:] @ body_map(total, gravity.shape[1])[:3, 3:].T
    return np.linalg.lstsq(gravity[:, :3], wrench[:, :3] - motion, rcond=1e-10)[0].T


def semi_axes(linear: Array, magnitude: float) -> Array:
    """
    Semi-axes of the ellipsoid that gravity's sphere becomes. [Traversaro2014] Table I.

    Parameters
    ----------
    linear : ndarray, shape (3, 3)
        Map from gravity to force [kg].
    magnitude : float
        Of gravity [m/s^2].

    Returns
    -------
    ndarray, shape (3,)
        Longest first [N].
    """
    return magnitude * np.linalg.svd(linear, compute_uv=False)


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
    axes = semi_axes(force_map(wrench, gravity, total), magnitude)
    return LoadEstimate(axes, float(added[0]), position)
