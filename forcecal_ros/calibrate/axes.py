"""Gains and directions of the accelerometer's axes, and how to say them."""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
import numpy as np

_AXES = 'xyz'


class Axes(NamedTuple):
    """Gain (3,) and map (3, 3) of an accelerometer with their standard errors."""

    gain: Array
    map: Array
    gain_std: Array
    map_std: Array


def split_matrix(matrix: Array, covariance: Array, scaled: bool) -> Axes:
    """
    Split a sensitivity into gains and directions.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        V = offset + matrix f.
    covariance : ndarray, shape (9, 9)
        Of its elements, row by row.
    scaled : bool
        Whether the readings are specific force already: gains are positive then, and a
        left-handed map is left-handed. The three gains of volts share the sign that makes the
        map right-handed, as the paper's do.
    """
    sign = 1.0 if scaled or np.linalg.det(matrix) > 0 else -1.0

    def split(m: Array) -> Array:
        rows = m.reshape(3, 3)
        norms = np.linalg.norm(rows, axis=1)
        return np.concatenate([sign * norms, (sign * rows / norms[:, None]).ravel()])

    flat = np.asarray(matrix, dtype=float).ravel()
    J = jacobian(split, flat, np.full(9, 1e-5 * np.abs(flat).max()))
    variance = np.einsum('ij,jk,ik->i', J, covariance, J)
    found = split(flat)
    directions = found[3:].reshape(3, 3)
    return Axes(found[:3], directions, np.sqrt(variance[:3]),
                np.sqrt(np.maximum(variance[3:].reshape(3, 3),
                                   _curvature(directions, J[3:], covariance))))


def _curvature(directions: Array, J: Array, covariance: Array) -> Array:
    """
    Mean square of what each element moves by in second order, shape (3, 3).

    Along itself a unit vector moves in second order only, by -e^2 / 2 for a turn by e. Away from
    there the first order is the larger one.
    """
    turns = (J @ covariance @ J.T).reshape(3, 3, 3, 3)
    out = np.zeros((3, 3))
    for i, row in enumerate(directions):
        C = turns[i, :, i, :]
        out[i] = row**2 * (np.trace(C)**2 + 2 * np.trace(C @ C)) / 4
    return out


def in_words(axes: Axes) -> list[str]:
    """Say where each axis points, and what hand the three make."""
    lines = []
    for i, row in enumerate(axes.map):
        j = int(np.argmax(np.abs(row)))
        off = np.degrees(np.arccos(min(1.0, abs(row[j]))))
        lines.append(f'{_AXES[i]} of the accelerometer points along '
                     f'{"-" if row[j] < 0 else "+"}{_AXES[j]} of ft_sensor, {off:.2f} deg off')
    hand = 'right' if np.linalg.det(axes.map) > 0 else 'left'
    sign = 'positive' if axes.gain[0] > 0 else 'negative'
    lines.append(f'its axes are {hand}-handed with {sign} gains')
    return lines


def jacobian(score: Callable[[Array], Array], theta: Array, steps: Array) -> Array:
    """
    Differentiate numerically, column by column.

    Parameters
    ----------
    score : callable
        (p,) to (q,).
    theta, steps : ndarray, shape (p,)

    Returns
    -------
    ndarray, shape (q, p)
    """
    return np.stack([(score(theta + step) - score(theta - step)) / (2 * size)
                     for size, step in zip(steps, np.diag(steps), strict=True)], axis=1)
