"""Torques about other axes than the forces: what a weight at one place cannot make.

With W_i the weight in pose i as the forces show it, c its place and b a bias, torques read

    T_i = Q (c x W_i) + b

where Q swaps and turns round axes; Q = 1 where they are those of the forces. Q and -Q read the
same, of a place c and -c.
"""

from itertools import permutations, product

from forcecal_ros.errors import DataError
from forcecal_ros.geometry import Array, skew
from forcecal_ros.recording.checks import limits
import numpy as np
from scipy.special import fdtrc

_FEWEST = 4
"""Poses, whose twelve torques are twice the unknowns."""


def refuse_other_torques(weight: Array, torque: Array, noise: Array | None) -> None:
    """
    Refuse torques that fit a weight at one place with other axes only.

    Parameters
    ----------
    weight : ndarray, shape (n, 3)
        In static poses, in the axes of the forces [N].
    torque : ndarray, shape (n, 3)
        Mean readings [N m].
    noise : ndarray, shape (3,), or None
        Standard error of these means; None: not known.

    Raises
    ------
    DataError
        Says which axes the torques show, how well they fit then, and the remedy.
    """
    if len(weight) < _FEWEST:
        return
    floor = 0.0 if noise is None else float(np.sqrt((noise**2).mean()))
    found = {axes: max(_rms(weight, torque, axes), floor) for axes in _orders()}
    plain, best = found[0, 1, 2, 1, 1, 1], min(found, key=lambda axes: found[axes])
    degrees = torque.size - 6
    ratio = (plain / max(found[best], limits.NIL))**2
    if ratio < limits.OTHER_TORQUES**2 or (
            fdtrc(degrees, degrees, ratio) * len(found) > limits.BY_CHANCE):
        return
    shown = ', '.join('-' * (sign < 0) + 'xyz'[axis] for axis, sign in zip(best[:3], best[3:]))
    raise DataError(
        f'wrench: its torques are not about the axes of its forces: x, y, z show {shown}, or all '
        f'three the other way round; RMS of the residual torques at rest {found[best]:.2g} N m '
        f'then, {plain:.2g} N m as recorded; correct the order and the signs of the torques in '
        'the driver')


def _orders() -> list[tuple[int, ...]]:
    """Orders and signs of three axes, of each and its opposite the one with fewer minus signs."""
    return [(*order, *signs) for order in permutations(range(3))
            for signs in product((1, -1), repeat=3) if sum(signs) > 0]


def _rms(weight: Array, torque: Array, axes: tuple[int, ...]) -> float:
    """RMS of what a weight at the best place leaves of torques whose axes are these [N m]."""
    Q = np.zeros((3, 3))
    Q[range(3), axes[:3]] = axes[3:]
    centred = torque - torque.mean(axis=0)
    lever = -Q @ skew(weight)
    rows = (lever - lever.mean(axis=0)).reshape(-1, 3)
    place = np.linalg.lstsq(rows, centred.ravel(), rcond=1e-6)[0]
    return float(np.sqrt(((centred.ravel() - rows @ place)**2).mean()))
