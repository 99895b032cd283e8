"""Error analysis, [Gamez2005] Eq. 21 to 27: how errors of orientation and of one estimate travel.

The paper writes R P for the x component in ft_sensor of a vector P given in the world, so here
``x_of(R, P)`` is the first element of R_base_sensor^T P. e_v in its Eq. 27 is its e_o.
"""

from forcecal_ros.core.geometry import Array
import numpy as np


def x_of(R_base_sensor: Array, vector_base: Array) -> float:
    """X component in ft_sensor of a vector in base, the R P of the paper."""
    return float(R_base_sensor[:, 0] @ vector_base)


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


def mass_error(R_h: Array, R_h_assumed: Array, R_v: Array, R_v_assumed: Array,
               weight_h: Array, weight_v: Array, gravity: float) -> float:
    """
    Error of the mass from errors of orientation, [Gamez2005] Eq. 23.

    It is Eq. 21 by the real orientations less Eq. 22 by those assumed.

    Parameters
    ----------
    R_h, R_h_assumed, R_v, R_v_assumed : ndarray, shape (3, 3)
    weight_h, weight_v : ndarray, shape (3,)
        [N]
    gravity : float
        [m/s^2]

    Returns
    -------
    float
        [kg]
    """
    return (x_of(R_h - R_h_assumed, weight_h) - x_of(R_v - R_v_assumed, weight_v)) / gravity


def offset_error(R_v: Array, R_accelerometer: Array, offset: Array) -> float:
    """
    Error of the offset from misalignment, e_o = (R_F3 - R_A4) V_o, [Gamez2005] Eq. 24.

    Zero where the accelerometer's frame is that of the sensor; see :func:`gravity_leak` for what
    a misaligned DC sensor adds on top.

    Parameters
    ----------
    R_v, R_accelerometer : ndarray, shape (3, 3)
        Orientation of ft_sensor in step 3 and of the accelerometer in step 4, in base.
    offset : ndarray, shape (3,)
        The paper's V_o as a vector in base [V].

    Returns
    -------
    float
        [V]
    """
    return x_of(R_v - R_accelerometer, offset)


def gravity_leak(R_accelerometer: Array, gain: float, gravity: float) -> float:
    """
    Say what gravity adds to the plain Eq. 15 where the accelerometer's x is not horizontal.

    Parameters
    ----------
    R_accelerometer : ndarray, shape (3, 3)
        Its orientation in base.
    gain, gravity : float
        [V/(m/s^2)], [m/s^2]

    Returns
    -------
    float
        [V]
    """
    return gain * gravity * float(R_accelerometer[2, 0])


def acceleration_error(volts: float, offset: float, gain: float, offset_error: float,
                       gain_error: float) -> float:
    """
    Error of the measured acceleration, [Gamez2005] Eq. 27.

    Parameters
    ----------
    volts, offset, offset_error : float
        [V]
    gain, gain_error : float
        [V/(m/s^2)]

    Returns
    -------
    float
        [m/s^2]
    """
    return (volts - offset) / gain - (volts - offset - offset_error) / (gain + gain_error)


def force_error(mass: float, mass_error: float, R_force: Array, R_accelerometer: Array,
                a: Array, acceleration_error: Array) -> float:
    """
    Error of the contact force, e_f = (m + e_m) R_A (a + e_a) - m R_F a, [Gamez2005] Eq. 26.

    Parameters
    ----------
    mass, mass_error : float
        [kg]
    R_force, R_accelerometer : ndarray, shape (3, 3)
        Orientation of ft_sensor and of the accelerometer in base.
    a, acceleration_error : ndarray, shape (3,)
        In base [m/s^2].

    Returns
    -------
    float
        [N]
    """
    return float((mass + mass_error) * x_of(R_accelerometer, np.asarray(a) + acceleration_error)
                 - mass * x_of(R_force, np.asarray(a)))
