"""The true calibration of a rig, and what an identification may expect of it."""

from math import sqrt

from forcecal_ros.core.geometry import Array
from forcecal_ros.effects.numbers import physical_rig
from forcecal_ros.effects.rig import AccelerometerModel, Rig
from forcecal_ros.motion.information import Sensors
import numpy as np


def true_calibration(rig: Rig, accelerometer: str | None = None) -> dict[str, Array]:
    """
    Return the true value of everything that is identified.

    Parameters
    ----------
    rig : Rig
        Of its effects, those that change numbers of tool and wall count.
    accelerometer : str, optional
        ``acc1`` or ``acc2``; the rig's mounted one where none is given.

    Returns
    -------
    dict of str to ndarray
        By key of ``calibration.yaml``, as ``accelerometer.gain``; SI units, ft_sensor.
    """
    rig = physical_rig(rig)
    name = accelerometer or rig.accelerometer.mounted
    model: AccelerometerModel = getattr(rig.accelerometer, name)
    truth: dict[str, object] = {
        'mass': rig.tool.mass,
        'com': rig.tool.com,
        'inertia': rig.tool.inertia,
        'wrench_bias': rig.wrench_sensor.bias,
        'accelerometer.offset': model.offset,
        'accelerometer.gain': model.gain,
        'accelerometer.map': np.eye(3),
        'accelerometer.delay': 0.0,
    }
    if rig.optidrive is not None:
        truth['tool.stiffness'] = rig.optidrive.stiffness
        truth['tool.damping'] = rig.optidrive.damping
    return {key: np.array(value, dtype=float) for key, value in truth.items()}


def expected_sensors(rig: Rig) -> Sensors:
    """Return mass, centre of mass and noise densities of a rig."""
    wrench, accelerometer = rig.wrench_sensor, rig.accelerometer
    return Sensors(
        rig.tool.mass, np.array(rig.tool.com), wrench.force_noise / sqrt(wrench.rate),
        wrench.torque_noise / sqrt(wrench.rate), accelerometer.noise / sqrt(accelerometer.rate),
        float(np.abs(accelerometer.model().gain).mean()), float(np.linalg.norm(rig.gravity)))
