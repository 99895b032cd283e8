"""
The calibration matrix from several added masses, and loads by a sensor that has one.

[Traversaro2014] Eq. 18-24: for every sample of data set j, with the offset removed,

    C r = (M_B + M_j) g        M_B unknown, M_j = m_j [I; c_j x] known,

linear in the 40 unknowns vec C and [m_B, m_B c_B]; 52 in motion, where the body's inertia and the
offset's wrench C o are estimated along. Samples
enter as the pseudo-samples of :class:`~forcecal_ros.insitu.moments.Moments`: raw measurements
projected on the measured gravity, which frees the regressor of the raw channels' noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.insitu.motion import (
    body_basis,
    body_map,
    inertia_matrix,
    load_parameters,
    PHYSICAL,
    point_inertia,
)
import numpy as np


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
    Linear map from gravity to the measured force, what motion adds taken off.

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
                  position_wanted: bool) -> LoadEstimate:
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
    position_wanted : bool
        False where nothing was added.
    """
    total = body_of(wrench, gravity)
    added = total - body
    position = added[1:4] / added[0] if position_wanted and added[0] else np.full(3, np.nan)
    axes = semi_axes(force_map(wrench, gravity, total), magnitude)
    return LoadEstimate(axes, float(added[0]), position)
