"""What a calibration may expect of a rig's tool and sensors."""

from math import sqrt

from forcecal_ros.effects.rig import Rig
from forcecal_ros.motion.information import Sensors
import numpy as np


def expected_sensors(rig: Rig) -> Sensors:
    """Return mass, centre of mass and noise densities of a rig."""
    wrench, accelerometer = rig.wrench_sensor, rig.accelerometer
    return Sensors(
        rig.tool.mass, np.array(rig.tool.com), wrench.force_noise / sqrt(wrench.rate),
        wrench.torque_noise / sqrt(wrench.rate), accelerometer.noise / sqrt(accelerometer.rate),
        float(np.abs(accelerometer.model().gain).mean()), float(np.linalg.norm(rig.gravity)))
