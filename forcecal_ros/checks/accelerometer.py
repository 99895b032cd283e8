"""Unit and place of an accelerometer, by gravity at rest."""

from forcecal_ros.checks.hypotheses import corrected, MIN_GRAVITY_SPREAD
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
import numpy as np

_ACCELERATIONS = {'g': 1.0 / STANDARD_GRAVITY, 'mg': 1e3 / STANDARD_GRAVITY, 'mm/s^2': 1e3}
"""Units that drivers send instead of m/s^2: how many of them one m/s^2 is."""

OTHER_UNIT, SAME_UNIT, NO_GRAVITY = 2.0, 0.2, 0.05
"""Gravity at rest off by the first factor is another unit, to the second share; less than the
third is an offset alone: sensors that are not calibrated have 1 m/s^2 and gains 10 % off."""


def refuse_other_unit(at_rest: Array, gravity: float, decays: bool = False) -> None:
    """
    Refuse an accelerometer that says m/s^2 and at rest does not show gravity.

    Parameters
    ----------
    at_rest : ndarray, shape (n, 3)
        Means of static poses, as recorded.
    gravity : float
        Magnitude [m/s^2].
    decays : bool
        Whether readings drift while the robot stands, as behind a high-pass.

    Raises
    ------
    DataError
        Names the unit that the readings are in, and the remedy.
    """
    shown = float(np.median(np.linalg.norm(at_rest, axis=1)))
    share = shown / gravity
    if 1.0 / OTHER_UNIT < share < OTHER_UNIT:
        return
    found = f'accelerometer: |f| at rest is {shown:.3g}, not the {gravity:.3g} m/s^2 of gravity'
    for unit, scale in _ACCELERATIONS.items():
        if abs(share / scale - 1.0) < SAME_UNIT:
            raise DataError(f'{found}: it is in {unit}; {corrected(1.0 / scale, unit)}')
    if share < NO_GRAVITY and decays:
        raise DataError(f'{found}, and decays while the robot stands: the sensor is AC-coupled; '
                        'state --coupling ac')
    if share < NO_GRAVITY:
        raise DataError(f'{found}, however long the robot stands: the driver takes gravity off; '
                        'let it publish specific force (REP-145)')
    raise DataError(f'{found}: no unit explains it, so its gain is another; divide by '
                    f'{share:.3g} in the driver')


def refuse_on_another_link(at_rest: Array, gravity: Array) -> None:
    """
    Refuse an accelerometer in which gravity does not turn as the pose turns it.

    Parameters
    ----------
    at_rest, gravity : ndarray, shape (n, 3)
        Means of static poses, and gravity there by the pose [m/s^2].

    Raises
    ------
    DataError
        Says how little it turns.
    """
    shown, expected = (float(np.linalg.norm(x.std(axis=0))) for x in (at_rest, gravity))
    g = float(np.linalg.norm(gravity, axis=1).mean())
    if expected > MIN_GRAVITY_SPREAD * g and shown < 0.5 * expected:
        raise DataError(
            f'accelerometer: gravity changes by {shown:.2g} m/s^2 from pose to pose in it, by '
            f'{expected:.2g} m/s^2 as the pose turns: it does not sit on the tool; name the one '
            'that does with --topic accelerometer=NAME')
