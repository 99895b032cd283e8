"""What nature forbids is no result: a load a metre away, the inertia of no body."""

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import DataError
import numpy as np

FARTHEST = 1.0
"""Centre of mass and radius of gyration beyond this are none of what hangs on a wrist [m]: of a
kilogram there already most wrist sensors are overloaded by the torque."""

_CERTAIN = 5.0
"""An inertia is that of no body by so many standard errors: one identification in a million."""


def refuse_unnatural(c: Calibration) -> None:
    """
    Refuse what no tool can be.

    Raises
    ------
    DataError
        Names the estimate, its value and what makes it so.
    """
    mass, away = float(c.mass), float(np.linalg.norm(c.com.value))
    if not mass > 0.0:
        raise DataError(f'the mass comes out as {mass:.4g} kg, which no tool has; look at the '
                        'sign and the frame of the wrench')
    if not away < FARTHEST:
        raise DataError(
            f'the centre of mass comes out {away:.3g} m away from the sensor, which no tool has; '
            'look at the unit of the torques (N m, not N mm, N cm or lbf in) and at their axes')


def unnatural_inertia(c: Calibration) -> str:
    """Say why an inertia is that of no body, and so not identified; empty: it may be one."""
    if c.inertia is None:
        return ''
    moments = np.linalg.eigvalsh(c.inertia.value)
    doubt = _CERTAIN * float(np.linalg.norm(c.inertia.std))
    if moments[0] > -doubt and moments[0] + moments[1] > moments[2] - 2.0 * doubt and (
            moments[2] - doubt < float(c.mass) * FARTHEST**2):
        return ''
    return (f'inertia: its principal moments come out as '
            f'{", ".join(f"{one:.3g}" for one in moments)} kg m^2, which no body of '
            f'{float(c.mass):.3g} kg has, and it is not taken; look for contact in the motion, '
            'stamps of pose and wrench of different clocks, and the axes of the torques')
