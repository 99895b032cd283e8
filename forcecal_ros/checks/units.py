"""Units that readings at rest tell, or at least call into question."""

from forcecal_ros.checks import limits
from forcecal_ros.core.errors import DataError
from forcecal_ros.core.geometry import Array, STANDARD_GRAVITY
import numpy as np

_POUND_FORCE = 4.4482216152605
"""[N]"""

_POUND_INCH = 0.1129848290276167
"""[N m]"""

_ACCELERATIONS = {'g': 1.0 / STANDARD_GRAVITY, 'mg': 1e3 / STANDARD_GRAVITY, 'mm/s^2': 1e3}
"""Units that drivers send instead of m/s^2: how many of them one m/s^2 is."""


def mended(factor: float, unit: str) -> str:
    """Say how readings in a unit become SI: where they are made, or where a table was read."""
    return (f'multiply by {factor:.6g} in the driver (where forcecal import read a table, write '
            f'"unit: {unit}" into its specification instead)')


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
    if 1.0 / limits.OTHER_UNIT < share < limits.OTHER_UNIT:
        return
    said = f'accelerometer: |f| at rest is {shown:.3g}, not the {gravity:.3g} m/s^2 of gravity'
    for unit, scale in _ACCELERATIONS.items():
        if abs(share / scale - 1.0) < limits.SAME_UNIT:
            raise DataError(f'{said}: it is in {unit}; {mended(1.0 / scale, unit)}')
    if share < limits.NO_GRAVITY and decays:
        raise DataError(f'{said}, and decays while the robot stands: the sensor is AC-coupled; '
                        'state --coupling ac')
    if share < limits.NO_GRAVITY:
        raise DataError(f'{said}, however long the robot stands: the driver takes gravity off; '
                        'let it publish specific force (REP-145)')
    raise DataError(f'{said}: no unit explains it, so its gain is another; divide by '
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
    shown, wanted = (float(np.linalg.norm(x.std(axis=0))) for x in (at_rest, gravity))
    g = float(np.linalg.norm(gravity, axis=1).mean())
    if wanted > limits.SPANNED * g and shown < limits.TURNS_ALONG * wanted:
        raise DataError(
            f'accelerometer: gravity changes by {shown:.2g} m/s^2 from pose to pose in it, by '
            f'{wanted:.2g} m/s^2 as the pose turns: it does not sit on the tool; name the one '
            'that does with --topic accelerometer=NAME')


_FORCES = {'kgf': STANDARD_GRAVITY, 'lbf': _POUND_FORCE, 'mN': 1e-3, 'kN': 1e3}
"""[N]"""

_TORQUES = {'N mm': 1e-3, 'N cm': 1e-2, 'dN m': 0.1, 'lbf in': _POUND_INCH,
            'kgf cm': 1e-2 * STANDARD_GRAVITY, 'kN m': 1e3}
"""[N m]"""


def force_unit_of(shown: float, mass: float) -> tuple[str, float] | None:
    """Name the unit in which forces make a known mass [kg] that shown [kg], and its newtons."""
    for unit, newtons in _FORCES.items():
        if abs(shown * newtons / mass - 1.0) < limits.SAME_MASS:
            return unit, newtons
    return None


def lever_units_of(shown: Array, com: Array, forces: bool = False) -> str:
    """
    Name the units of torques in which a centre of mass is where they show it; empty: none does.

    Parameters
    ----------
    shown, com : ndarray, shape (3,)
        By torques and forces, and as it is known otherwise [m].
    forces : bool
        The forces may be in another unit, too.
    """
    times = float(shown @ com) / max(float(com @ com), limits.TINY)
    away = float(np.linalg.norm(shown - times * com) / max(np.linalg.norm(shown), limits.TINY))

    def same(wanted: float) -> bool:
        far = max(wanted, 1.0 / wanted) > limits.LIKE_NONE
        most = limits.SAME_FAR_LEVER if far else limits.SAME_LEVER
        return away < most and abs(times / wanted - 1.0) < most

    found = [f'its torques are in {unit} (multiply by {size:.5g})'
             for unit, size in _TORQUES.items() if same(1.0 / size)]
    if forces:
        found += [f'its forces are in {unit} (multiply by {size:.6g}) and its torques in N m'
                  for unit, size in _FORCES.items() if same(size)]
    return ', or '.join(found)


def refuse_other_mass(found: float, std: float, stated: float) -> None:
    """
    Refuse a mass [kg], with its standard error, that is not what a scale says.

    Raises
    ------
    DataError
        Names the unit of the forces that explains it, or what else may.
    """
    if abs(found - stated) < limits.SAME_MASS * stated + limits.SURE_WEIGHT * std:
        return
    unit = force_unit_of(found, stated)
    why = (f'its forces are in {unit[0]}; {mended(unit[1], unit[0])}' if unit else
           'no unit explains it; put all on the scale that hangs below the sensor, couplings too. '
           'If the mass was right, the driver takes a load off or its gain is another')
    raise DataError(f'wrench: a tool of {stated:.4g} kg weighs {found:.4g} +- {std:.2g} kg in it: '
                    f'{why}')


def doubt_of_force_unit(mass: float) -> str:
    """Question a mass that is odd for a tool [kg], as another unit makes it; or empty."""
    if mass > limits.HEAVY:
        return (f'a mass of {mass:.3g} kg is much for a wrist to carry: weigh the tool and give '
                f'--tool-mass, which tells the unit; if it weighs {mass / 1000:.3g} kg, the '
                'wrench is in mN, else in counts of a converter: divide them by the counts a '
                'newton')
    if mass > limits.LIGHT:
        return ''
    kgf, lbf = mass * STANDARD_GRAVITY, mass * _POUND_FORCE
    return (f'a mass of {mass:.3g} kg is little for a wrist to carry: weigh the tool and give '
            f'--tool-mass, which tells the unit; if it weighs {kgf:.3g} kg, the wrench is in kgf, '
            f'if {lbf:.3g} kg, in lbf')


def doubt_of_torque_unit(away: float) -> str:
    """Question a centre of mass that is far [m], as torques in lbf in make it; or empty."""
    if away < limits.FAR:
        return ''
    inches, kgf = away * _POUND_INCH, away / STANDARD_GRAVITY
    return (f'a centre of mass {away:.3g} m away from the sensor is far: measure it; if it is '
            f'{inches:.2g} m, '
            f'the torques are in lbf in (multiply by {_POUND_INCH:.5g}), if {away / 10:.2g} m, '
            f'in dN m; if {away / _POUND_FORCE:.2g} or {kgf:.2g} m, the forces are in lbf or kgf '
            'and the torques in N m')
