"""Error analysis, [Gamez2005] Eq. 21, 22 and 25: what no figure of a calibration is made of.

The other equations, by which a calibration is judged, are in ``identify.error_analysis``.
"""

from forcecal_ros.geometry import Array
from forcecal_ros.identify.error_analysis import x_of


def mass_from_weight(R_h: Array, R_v: Array, weight_h: Array, weight_v: Array,
                     gravity: float) -> float:
    """
    Mass from the weight along x in two orientations, [Gamez2005] Eq. 21, [Gamez2005] Eq. 22.

    Parameters
    ----------
    R_h, R_v : ndarray, shape (3, 3)
        R_base_sensor of steps 1 and 3: the real ones (Eq. 21) or those assumed (Eq. 22).
    weight_h, weight_v : ndarray, shape (3,)
        The paper's P_z and P_x: tool weight in base as carried in each pose [N].
    gravity : float
        Magnitude [m/s^2].

    Returns
    -------
    float
        [kg]
    """
    return (x_of(R_h, weight_h) - x_of(R_v, weight_v)) / gravity


def gain_error(u: float, u_assumed: float, a: float, a_assumed: float, offset: float,
               mass: float, offset_error: float, mass_error: float) -> float:
    """
    Error of the gain, [Gamez2005] Eq. 25.

    Parameters
    ----------
    u, u_assumed : float
        Force along x by the real and by the assumed orientation, R u in the paper [N].
    a, a_assumed : float
        Acceleration likewise, R a.
    offset, mass : float
        V_o and m.
    offset_error, mass_error : float
        e_v, which is the paper's e_o, and e_m.

    Returns
    -------
    float
        Zero where both orientations are as assumed and both errors are zero.
    """
    true = (u - offset * mass) / (a * mass)
    found_mass = mass + mass_error
    found = (u_assumed - (offset + offset_error) * found_mass) / (a_assumed * found_mass)
    return true - found
