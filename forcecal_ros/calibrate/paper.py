"""The plain procedure of the paper on the same recording, next to the joint estimates.

And its error analysis, [Gamez2005] Eq. 21 to 27: how errors of orientation and of one estimate
travel. The paper writes R P for the x component in ft_sensor of a vector P given in the world, so
here ``x_of(R, P)`` is the first element of R_base_sensor^T P. e_v in its Eq. 27 is its e_o.
"""

from typing import NamedTuple

from forcecal_ros.calibrate.poses import StaticPose, window_mean
from forcecal_ros.calibrate.tool import mass_from_tilt
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.streams import Recording
import numpy as np

_HORIZONTAL = 0.05


class Plain(NamedTuple):
    """
    What the paper's equations give; NaN where the recording does not hold what they need.

    Attributes
    ----------
    mass, mass_theta : float
        Eq. 16 as printed and with the share of the weight that x really carries [kg].
    offset : float
        Eq. 15, of the axis that shows x [V].
    gain, gain_aligned : float
        Eq. 17 as printed; with the noise of the regressor (errors in variables) and the delay
        between the sensors taken out [V/(m/s^2)].
    operations : float
        Eq. 20.
    """

    mass: float
    mass_theta: float
    offset: float
    gain: float
    gain_aligned: float
    operations: float


class Alignment(NamedTuple):
    """Accelerometer axis that shows x, delay [s], noise variance of its samples [V^2]."""

    axis: int
    delay: float
    variance: float


def plain_procedure(recording: Recording, poses: list[StaticPose], gravity: float,
                    step: tuple[float, float] | None, alignment: Alignment | None) -> Plain:
    """
    Carry out steps 1 to 8 of the procedure as printed, [Gamez2005] Eq. 11 to Eq. 17, Eq. 20.

    Parameters
    ----------
    gravity : float
        [m/s^2]
    step : tuple of float or None
        Start and end of the step [s].
    alignment : Alignment or None
        None without accelerometer.
    """
    nan = float('nan')
    upright = [abs(p.R_base_sensor[2, 0]) for p in poses]
    h, v = int(np.argmax(upright)), _level_pose(recording, poses, step)
    vertical = 0.3
    if upright[h] < vertical or upright[v] > _HORIZONTAL:
        return Plain(nan, nan, nan, nan, nan, nan)
    assert recording.wrench is not None
    u_h, u_v = (-float(window_mean(recording.wrench, poses[i].start, poses[i].end)[0])
                for i in (h, v))
    mass = mass_from_tilt(u_h, u_v, gravity)
    mass_theta = mass_from_tilt(u_h, u_v, gravity, float(np.arccos(min(1.0, upright[h]))))
    offset, gains = nan, (nan, nan)
    accelerometer = recording.accelerometer
    if alignment is not None and accelerometer is not None:
        at_v = accelerometer.between(poses[v].start, poses[v].end).values
        if len(at_v):
            offset = float(plain_offset(at_v)[alignment.axis])
        if step is not None:
            gains = _gains(recording, step, alignment, offset, u_v, mass)
    operations = nan
    if step is not None:
        operations = operation_count((poses[h].start, poses[h].end, poses[v].start, poses[v].end,
                                      poses[v].end + step[1] - step[0]), recording.wrench.rate)
    return Plain(mass, mass_theta, offset, *gains, operations)


def _level_pose(recording: Recording, poses: list[StaticPose],
                step: tuple[float, float] | None) -> int:
    """Choose the v pose: x horizontal, and where there is a step, oriented as there."""
    upright = np.array([abs(p.R_base_sensor[2, 0]) for p in poses])
    level = upright < max(_HORIZONTAL, upright.min() + 1e-6)
    away = upright.copy()
    if step is not None and recording.pose is not None:
        there = recording.pose.between(*step).R_base_sensor
        if len(there):
            away = np.array([np.linalg.norm(p.R_base_sensor - there[0]) for p in poses])
    return int(np.argmin(np.where(level, away, np.inf)))


def _gains(recording: Recording, step: tuple[float, float], alignment: Alignment,
           offset: float, u_v: float, mass: float) -> tuple[float, float]:
    """Eq. 17 as printed, and corrected for noise and delay."""
    assert recording.accelerometer is not None and recording.wrench is not None
    cut = recording.accelerometer.between(*step)
    shown = cut.values[:, alignment.axis] - offset

    wrench = recording.wrench

    def Y(delay: float) -> Array:
        return np.asarray((-wrench.at(cut.t - delay)[:, 0] - u_v) / mass)

    try:
        return step_gain(shown, Y(0.0)), step_gain(shown, Y(alignment.delay), alignment.variance)
    except UnobservableError:
        return float('nan'), float('nan')


def operation_count(times: tuple[float, float, float, float, float], rate: float) -> float:
    """
    Arithmetic operations of the plain procedure, [Gamez2005] Eq. 20.

    Parameters
    ----------
    times : tuple of float
        t0 to t4: pose 1 from t0 to t1, pose 3 from t2 to t3, the step until t4 [s].
    rate : float
        Samples per second.
    """
    t0, t1, t2, t3, t4 = times
    return ((t1 - t0) + 2 * (t3 - t2) + (t4 - t3)) * rate


def plain_offset(volts_v: Array) -> Array:
    """
    Offset as the mean reading in the v pose, [Gamez2005] Eq. 15.

    Holds for an axis that is horizontal there, and for a sensor that shows DC: one with a
    high-pass of 16 s still remembers the gravity of the pose before.

    Parameters
    ----------
    volts_v : ndarray, shape (n, k)
        [V]

    Returns
    -------
    ndarray, shape (k,)
    """
    return np.asarray(volts_v.mean(axis=0))


def step_gain(theta: Array, Y: Array, theta_variance: float = 0.0) -> float:
    """
    Gain from a step, Kgain = 1 / ((theta^T theta)^-1 theta^T Y), [Gamez2005] Eq. 17.

    The regressor theta is the noisy one: its noise inflates theta^T theta, which pulls the slope
    towards zero and the gain up. With ``theta_variance`` that is taken off (errors in variables).
    A delay between the sensors does more harm: it turns theta^T Y down by the cosine of the
    phase it makes at the frequency of the ringing.

    Parameters
    ----------
    theta : ndarray, shape (n,)
        Volts less offset [V].
    Y : ndarray, shape (n,)
        (u - u^v) / m [m/s^2]: neither the sensor's bias nor a tare enters.
    theta_variance : float
        Of the noise of theta, 0 for Eq. 17 as printed [V^2].

    Returns
    -------
    float
        [V/(m/s^2)]

    Raises
    ------
    UnobservableError
        The step does not stand out of the noise.
    """
    energy = float(theta @ theta) - theta_variance * len(theta)
    product = float(theta @ Y)
    if not len(theta) or energy <= 0 or abs(product) < 1e-12:
        raise UnobservableError(
            f'the step is within the noise of the accelerometer ({len(theta)} samples, energy '
            f'{energy:.3g} V^2); make it faster')
    return energy / product


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
