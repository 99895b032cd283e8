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


def gain_error(volts: float, offset: float, u: float, u_assumed: float, mass: float,
               offset_error: float, mass_error: float) -> float:
    """
    Error of the gain, [Gamez2005] Eq. 25, its dimensions put right.

    Printed is (R u - V_o m) / (R a m), newtons less volts times kilograms, over newtons. What
    steps 5 to 8 compute, by Eq. 2 and a = R u / m, is (V - V_o) m / (R u), of which the error is
    taken here.

    Parameters
    ----------
    volts, offset : float
        V and V_o [V].
    u, u_assumed : float
        Force along x by the real and by the assumed orientation, R u in the paper [N].
    mass : float
        [kg]
    offset_error, mass_error : float
        e_v, which is the paper's e_o, and e_m.

    Returns
    -------
    float
        [V/(m/s^2)]; zero where both orientations are as assumed and both errors are zero.
    """
    found = (volts - offset - offset_error) * (mass + mass_error) / u_assumed
    return (volts - offset) * mass / u - found
