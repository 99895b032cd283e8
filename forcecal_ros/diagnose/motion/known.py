"""What is known of the tool and its sensors beforehand, and how well: calibration or rig."""

from dataclasses import dataclass

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.effects.rig import Rig
from forcecal_ros.geometry import Array
import numpy as np


@dataclass(frozen=True)
class Known:
    """
    Nominal numbers of tool and sensors with their spreads.

    Attributes
    ----------
    mass : float
        [kg]
    com : ndarray, shape (3,)
        In ft_sensor [m].
    bias : ndarray, shape (6,)
        [N], [N m]
    gravity : float
        [m/s^2]
    inertia : ndarray, shape (3, 3)
        About the centre of mass [kg m^2]; zero where it is not known.
    sensitivity, offset : ndarray or None, shapes (3, 3), (3,)
        Of the accelerometer: reading = offset + sensitivity @ f.
    unit : str
        Of its readings.
    delay : float
        How much later than the wrench it shows the same instant [s].
    place : ndarray or None, shape (3,)
        Of the accelerometer in ft_sensor [m]; None: at the centre of mass.
    dynamic : bool
        Whether it speaks of the tool in motion; one from static poses alone knows its weight only.
    spread : dict of str to ndarray
        One standard deviation of ``mass``, ``moment`` (mass times CoM), ``bias`` and ``accel``.
    """

    mass: float
    com: Array
    bias: Array
    gravity: float
    inertia: Array
    sensitivity: Array | None
    offset: Array | None
    unit: str
    delay: float
    place: Array | None
    dynamic: bool
    spread: dict[str, Array]


def known_from_calibration(calibration: Calibration) -> Known:
    """
    Take the numbers of a calibration, its standard errors as spreads.

    Parameters
    ----------
    calibration : Calibration

    Returns
    -------
    Known
    """
    c, a = calibration, calibration.accelerometer
    mass, std = float(c.mass), float(np.nan_to_num(c.mass.std))
    moment = np.hypot(std * c.com.value, mass * np.nan_to_num(c.com.std))
    off = np.zeros(3) if a is None else np.abs(
        np.linalg.solve(a.matrix, np.nan_to_num(a.offset.std)))
    return Known(
        mass, c.com.value, c.wrench_bias.value, c.gravity,
        np.zeros((3, 3)) if c.inertia is None else c.inertia.value,
        None if a is None else a.matrix, None if a is None else a.offset.value,
        '' if a is None else a.unit, 0.0 if a is None else float(a.delay),
        None if a is None or a.position is None else a.position.value,
        a is not None and bool(np.isfinite(a.delay.std)),
        {'mass': np.array([std]), 'moment': moment,
         'bias': np.nan_to_num(c.wrench_bias.std), 'accel': off})


def known_from_rig(rig: Rig, accelerometer: str | None = None) -> Known:
    """
    Take the numbers of a rig, its spreads as they are.

    Parameters
    ----------
    rig : Rig
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the mounted one where none is given.

    Returns
    -------
    Known
    """
    tool, spreads, model = rig.tool, rig.spreads, rig.accelerometer.model(accelerometer)
    com = np.array(tool.com)
    moment = np.hypot(spreads.mass * tool.mass * com, tool.mass * spreads.com)
    bias = np.repeat([spreads.force_bias, spreads.torque_bias], 3)
    return Known(
        tool.mass, com, np.array(rig.wrench_sensor.bias), float(np.linalg.norm(rig.gravity)),
        np.array(tool.inertia), np.diag(model.gain), np.array(model.offset), 'V', 0.0,
        np.array(rig.accelerometer.position), True,
        {'mass': np.array([spreads.mass * tool.mass]), 'moment': moment, 'bias': bias,
         'accel': spreads.accelerometer_offset / np.abs(model.gain)})
