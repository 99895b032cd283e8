"""Torques about other axes than the forces: what a weight at one place cannot make.

With W_i the weight in pose i as the forces show it, c its place and b a bias, torques read

    T_i = Q (c x W_i) + b

where Q swaps and turns round axes; Q = 1 where they are those of the forces. Q and -Q read the
same, of a place c and -c.
"""

from collections.abc import Mapping
from itertools import permutations, product

from forcecal_ros.checks import limits
from forcecal_ros.checks.frames import Forces
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, skew
import numpy as np
from scipy.special import fdtrc

_FEWEST = 4
"""Poses, whose twelve torques are twice the unknowns."""


def refuse_exchanged(forces: Forces, torque: Array) -> None:
    """
    Refuse torques that turn as a weight does where the forces do not.

    Raises
    ------
    DataError
        Says so.
    """
    if len(torque) < _FEWEST:
        return
    mine, others = (weight_in(forces._replace(wire=values, noise=None))
                    for values in (forces.wire, torque))
    if others > limits.SURELY and mine < 1.0 - limits.SURELY:
        raise DataError(
            f'wrench: its torques turn as a weight does ({others:.0%} of their changes), its '
            f'forces do not ({mine:.0%}): force and torque are exchanged; mend their order in the '
            'driver')


def weight_in(forces: Forces) -> float:
    """Share of the changes of forces that a weight and a bias explain, whatever the sign."""
    design = np.concatenate([forces.in_sensor[:, :, None], np.broadcast_to(
        np.eye(3), (len(forces.wire), 3, 3))], axis=2).reshape(-1, 4)
    found = np.linalg.lstsq(design, forces.wire.ravel(), rcond=1e-9)[0]
    changes = ((forces.wire - forces.wire.mean(axis=0))**2).sum()
    unexplained = ((forces.wire.ravel() - design @ found)**2).sum()
    return 1.0 - float(unexplained / max(float(changes), limits.TINY))


def refuse_other_torques(weight: Array, torque: Array, noise: Array | None,
                         R_base_sensor: Array | None = None, rests: bool = True) -> None:
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
    R_base_sensor : ndarray, shape (n, 3, 3), optional
        To ask as well whether they are expressed in base.
    rests : bool
        Whether the sensor rested.

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
    if R_base_sensor is not None:
        _refuse_in_base(weight, torque, R_base_sensor, found)
    degrees = torque.size - 6
    ratio = (plain / max(found[best], limits.TINY))**2
    if ratio < limits.OTHER_TORQUES**2 or (
            fdtrc(degrees, degrees, ratio) * len(found) > limits.BY_CHANCE):
        return
    shown = ', '.join('-' * (sign < 0) + 'xyz'[axis] for axis, sign in zip(best[:3], best[3:]))
    raise DataError(
        f'wrench: its torques are not about the axes of its forces: x, y, z show {shown}, or all '
        f'three the other way round; RMS of the residual torques{" at rest" * rests} '
        f'{found[best]:.2g} N m '
        f'then, {plain:.2g} N m as recorded; correct the order and the signs of the torques in '
        'the driver')


def _refuse_in_base(weight: Array, torque: Array, R_base_sensor: Array,
                    found: Mapping[tuple[int, ...], float]) -> None:
    """Refuse torques that fit a weight at one place, and a bias, once they are turned back."""
    back = np.einsum('nji,nj->ni', R_base_sensor, torque)
    unexplained = max(_rms(weight, back, (0, 1, 2, 1, 1, 1)), limits.TINY)
    if min(found.values()) > limits.OTHER_TORQUES * unexplained:
        raise DataError(
            'wrench: its torques are expressed in base, its forces in the sensor; RMS of the '
            f'residual torques at rest {unexplained:.2g} N m then, '
            f'{found[0, 1, 2, 1, 1, 1]:.2g} N m as recorded; set the driver to publish both in '
            "the sensor's frame")


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
