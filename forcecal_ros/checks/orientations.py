"""Orientations read in another order than they were written: by which a weight would turn."""

from collections.abc import Iterator, Mapping

from forcecal_ros.checks.frames import (
    criterion,
    Fit,
    Forces,
    Judgement,
    plain_fit,
    turned_fit,
)
from forcecal_ros.checks.limits import (
    EXPLAINED,
    ODDS,
    SURE_WEIGHT,
    TINY,
    TURNED_OFF,
    VERTICAL,
)
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import (
    Array,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_vector,
)
import numpy as np

FOLLOWS, WORSE = 0.1, 10.0
"""Share of the changes of force that a weight leaves at most where it is what turns there, and how
many times as much it leaves by the orientation as it was read."""

FEWEST = 6
"""Poses, whose 18 forces are three times the unknowns."""


def refuse_other_orientation(forces: Forces, judgement: Judgement) -> None:
    """
    Refuse forces that turn as a weight does by another reading of the orientations.

    Raises
    ------
    DataError
        Names that reading.
    """
    R = forces.R_base_sensor
    believed = (judgement.likely[0].rms / max(judgement.changes, TINY))**2
    readings = _readings(R)
    words = other_reading(forces.wire, R, readings, believed) if len(R) >= FEWEST else ''
    if not words and not _shows_whole_axes(judgement.likely[0].Q):
        words = simpler_reading(forces, judgement, 1.0)
    if words:
        raise DataError(f'pose: {words}')


def _shows_whole_axes(Q: Array) -> bool:
    """Whether channels show one axis each, as drivers may set them; else it is a mount."""
    return bool((np.abs(Q).max(axis=1) > np.cos(np.radians(TURNED_OFF))).all())


def _readings(R: Array) -> Mapping[str, Array]:
    """Orientations as they are by other readings, and how these are said."""
    return {
        'it is that of base in the sensor: publish the pose of the sensor in base':
            np.swapaxes(R, 1, 2),
        'its quaternions are in the order w, x, y, z: fill x, y, z and w by their names':
            read_from_w(R)}


def simpler_reading(forces: Forces, judgement: Judgement, odds: float = ODDS) -> str:
    """
    Say which other reading of orientations makes a plain weight of forces in another frame.

    Parameters
    ----------
    odds : float
        So many times may the other frame be the likelier one.

    Returns
    -------
    str
        Empty: none does, or forces are in no other frame.
    """
    best, changes = judgement.likely[0], max(judgement.changes, TINY)
    if best is judgement.plain:
        return ''
    variance = max(1.0, best.chi_square / best.degrees)
    most = criterion(best, variance) + 2.0 * float(np.log(odds))
    for fit, words in sorted(_fits(forces, best.unknowns), key=lambda one: one[0].chi_square):
        explained = 1.0 - (fit.rms / changes)**2
        if (fit.mass > SURE_WEIGHT * fit.mass_std and explained > EXPLAINED
                and criterion(fit, variance) < most):
            mine = 1.0 - min(1.0, judgement.plain.rms / changes)**2
            return (f'force turns as the weight of {fit.mass:.3g} kg does if {words} '
                    f'({explained:.0%} of its changes follow), not as stated ({mine:.0%})')
    return ''


def _fits(forces: Forces, unknowns: int) -> Iterator[tuple[Fit, str]]:
    """Fits of a weight by other readings, of fewer unknowns; and how they are said."""
    for words, R in _readings(forces.R_base_sensor).items():
        other = forces._replace(R_base_sensor=R)
        yield plain_fit(other), words
        turned = turned_fit(other)
        if turned.unknowns < unknowns:
            angle = np.degrees(np.linalg.norm(rotation_vector(turned.Q)))
            yield turned, f'{words}, and the sensor sits turned by {angle:.0f} deg'


def read_from_w(R_base_sensor: Array) -> Array:
    """Return orientations as they are if quaternions in the order w, x, y, z were read as xyzw."""
    return matrix_from_quaternion(quaternion_from_matrix(R_base_sensor)[:, [1, 2, 3, 0]])


def other_reading(force: Array, R_base_sensor: Array, others: Mapping[str, Array],
                  believed: float = 1.0) -> str:
    """
    Say by which other reading of orientations forces turn as a weight; empty: by none.

    Parameters
    ----------
    force : ndarray, shape (n, 3)
        [N]
    others : mapping of str to ndarray, shape (n, 3, 3)
        R_base_sensor by other readings, and how these are said.
    believed : float
        Share of the changes of force that is left by what is believed else.
    """
    mine, _ = _unexplained_share(force, R_base_sensor)
    fits = [(*_unexplained_share(force, R), words) for words, R in others.items()]
    for unexplained, (weight, bias), words in sorted(fits, key=lambda fit: fit[0]):
        if unexplained < FOLLOWS and WORSE * unexplained < min(mine, believed) and (
                _is_vertical(weight) or not _is_vertical(bias)):
            return (f'force turns as a weight does if {words} ({1 - unexplained:.0%} of its '
                    f'changes follow), not as stated ({1 - mine:.0%})')
    return ''


def _unexplained_share(force: Array, R: Array) -> tuple[float, Array]:
    """Share of the changes of force that a constant one in base and a bias leave; these two."""
    x = np.concatenate([R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape)], axis=2)
    x, y = x.reshape(-1, 6), force.ravel()
    found = np.linalg.lstsq(x, y, rcond=1e-9)[0]
    unexplained = float(((y - x @ found) ** 2).sum() / ((force - force.mean(axis=0)) ** 2).sum())
    return unexplained, found.reshape(2, 3)


def _is_vertical(force: Array) -> bool:
    """
    Whether a force is a weight's, were base level.

    A wrench expressed in base fits orientations the other way round, with weight and bias
    exchanged; that is for the checks of frames to say.
    """
    return bool(np.hypot(force[0], force[1]) < VERTICAL * np.linalg.norm(force))
