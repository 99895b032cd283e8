"""[Traversaro2014] III to the letter, beside which ``forcecal insitu`` is measured.

Nothing of ``forcecal_ros`` is used: a third-order filter of 301 samples, the offset from the
affine space of each data set (Eq. 9 to 14), matrix and body from all training sets at once by
plain least squares (Eq. 21).
"""

import insitu_leg
from insitu_leg import Array, BODY_MASS, G, Leg, Log, PROTOCOL
import numpy as np
from scipy.signal import savgol_filter

SETTLED = 150
"""Samples on either end that the filter makes up."""


def by_paper(leg: Leg, seed: int) -> tuple[float, float, float]:
    """Largest errors of added mass [kg], position [m] and relative error of the semi-axes."""
    sets = [filtered(insitu_leg.record(load, leg, 1000 * seed + k))
            for k, load in enumerate(PROTOCOL)]
    offset = np.mean([offset_of(*one) for one in sets], axis=0)
    rows, right = [], []
    for (raw, gravity), load in zip(sets, PROTOCOL):
        if load.train:
            rows.append(np.hstack([np.kron(np.eye(6), raw - offset).reshape(6, -1, 36)
                                   .transpose(1, 0, 2).reshape(-1, 36), -weight(gravity)]))
            right.append(weight(gravity) @ body(load))
    x = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    matrix, own = x[:36].reshape(6, 6), x[36:]
    mass, place, axes = [], [0.0], []
    for (raw, gravity), load in zip(sets, PROTOCOL):
        if load.train:
            continue
        wrench = (raw - offset) @ matrix.T
        added = np.linalg.lstsq(weight(gravity), wrench.ravel(), rcond=None)[0] - own
        mass.append(abs(added[0] - load.mass))
        if load.mass:
            place.append(np.abs(added[1:] / added[0] - load.position).max())
        map_of_gravity = np.linalg.lstsq(gravity, wrench[:, :3], rcond=None)[0]
        found = np.linalg.svd(map_of_gravity, compute_uv=False)
        axes.append(np.abs(found / (BODY_MASS + load.mass) - 1).max())
    return max(mass), max(place), max(axes)


def filtered(log: Log) -> tuple[Array, Array]:
    """Raw channels and gravity (against the specific force), without the ends."""
    raw, accel = (savgol_filter(x, 301, 3, axis=0)[SETTLED:-SETTLED] for x in (log.raw, log.accel))
    return raw, -accel * G / np.linalg.norm(accel, axis=1).mean()


def offset_of(raw: Array, gravity: Array) -> Array:
    """Centre of the ellipsoid in the affine space of one data set (Eq. 9 to 14)."""
    mean = raw.mean(axis=0)
    U = np.linalg.svd(raw - mean, full_matrices=False)[2][:3].T
    rows = np.hstack([gravity, np.ones((len(gravity), 1))])
    return mean + U @ np.linalg.lstsq(rows, (raw - mean) @ U, rcond=None)[0][3]


def body(load: insitu_leg.Load) -> Array:
    """Mass and first moment (4,)."""
    return np.array([load.mass, *(load.mass * np.array(load.position))])


def weight(gravity: Array) -> Array:
    """Rows (6 n, 4) that make a wrench of mass and first moment."""
    rows = np.zeros((len(gravity), 6, 4))
    rows[:, :3, 0] = gravity
    rows[:, 3:, 1:] = -insitu_leg.cross(gravity)
    return rows.reshape(-1, 4)
