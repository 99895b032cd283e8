"""Stiffness of the tool from its static sag."""

from typing import NamedTuple

from forcecal_ros.errors import DataError
from forcecal_ros.identify.static_readings import Statics
import numpy as np


class Sag(NamedTuple):
    """
    Compliance as the static poses show it, s = (m / k) g_x + zero.

    Attributes
    ----------
    stiffness, variance : float
        [N/m] and its square; the mass' uncertainty left out.
    zero : float
        What the Optidrive reads without load [m].
    """

    stiffness: float
    variance: float
    zero: float


def stiffness_from_sag(statics: Statics, mass: float) -> Sag | None:
    """
    Stiffness of the tool from how far it sags in each pose, [Gamez2005] Eq. 29 at rest.

    Parameters
    ----------
    statics : Statics
        With a slide.
    mass : float
        [kg]

    Returns
    -------
    Sag or None
        None where the poses hardly load x.

    Raises
    ------
    DataError
        The tool slides against its load.
    """
    slide = statics.slide_at_rest
    assert slide is not None
    weight = mass * statics.gravity[:, 0]
    rows = np.stack([weight, np.ones(len(weight))], axis=1)
    if np.ptp(weight) < 0.05 * mass * np.linalg.norm(statics.gravity[0]):
        return None
    (compliance, zero), *_ = np.linalg.lstsq(rows, slide, rcond=None)
    bread = np.linalg.inv(rows.T @ rows)
    slope = (bread @ (rows.T * statics.slide_variance) @ rows @ bread)[0, 0]
    if compliance**2 < 25 * slope:
        return None
    if compliance < 0:
        raise DataError('optidrive: the tool slides against its load '
                        f'({1e3 * compliance:.3g} mm for each N); turn the sign of the optidrive')
    return Sag(float(1 / compliance), float(slope / compliance**4), float(zero))
