"""What the filter without a pose knows of arm, tool and IMU."""

from math import sqrt
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array, skew
from forcecal_ros.observe.design import design
from forcecal_ros.observe.filters.bias_model import BiasModel
from forcecal_ros.observe.settings import LEARNING, ObserverSettings
import numpy as np
from scipy.linalg import block_diag


class Imu(NamedTuple):
    """
    How the arm moves and how well the IMU sees it.

    Attributes
    ----------
    gyro_std : float
        Noise of the gyro, per sample [rad/s].
    gyro_offset : float
        Its offset, which counts as constant for ten seconds [rad/s].
    unknown_rate : float
        How fast the arm may turn, for a second, when the gyro is silent [rad/s].
    acceleration_std, acceleration_time : float
        Size and duration of the arm's accelerations [m/s^2], [s].
    tilt_std : float
        Of the direction of gravity at the start [rad].
    payload_std : float
        How much may have been taken up, at the centre of mass, since the calibration [kg].
    payload_walk : float
        Wander of the mass [kg/sqrt(s)].
    corner : float
        Of the filter that differentiates the gyro [rad/s].
    """

    gyro_std: float = 0.005
    gyro_offset: float = 0.003
    unknown_rate: float = 0.5
    acceleration_std: float = 1.0
    acceleration_time: float = 0.5
    tilt_std: float = 0.1
    payload_std: float = 0.0
    payload_walk: float = 1e-5
    corner: float = 100.0


class PoseFreeModel(NamedTuple):
    """
    All the pose-free step needs.

    Attributes
    ----------
    wrench : BiasModel
    imu : Imu
    gravity : float
        [m/s^2]
    mass, mass_std : float
        [kg]
    spread : ndarray, shape (6, 3)
        [1; c x], from a force at the centre of mass to its wrench.
    lever : ndarray, shape (3,)
        From the centre of mass to the accelerometer [m].
    inertia : ndarray, shape (3, 3)
        About the centre of mass [kg m^2].
    noise : ndarray, shape (9, 9)
        Of the :func:`~forcecal_ros.observe.pose_free.orientation.readings`.
    """

    wrench: BiasModel
    imu: Imu
    gravity: float
    mass: float
    mass_std: float
    spread: Array
    lever: Array
    inertia: Array
    noise: Array


def pose_free_model(calibration: Calibration, settings: ObserverSettings = ObserverSettings('ukf'),
                    imu: Imu = Imu()) -> PoseFreeModel:
    """
    Turn a calibration into the pose-free model, for filter ``ukf`` or ``ekf`` of twelve states.

    Raises
    ------
    ConfigError
        The filter is another one, or the calibration has no accelerometer that shows gravity, or
        no noise.
    """
    accelerometer, noise = calibration.accelerometer, calibration.noise
    if accelerometer is None or accelerometer.coupling != 'dc':
        raise ConfigError('without a pose gravity needs a DC-coupled accelerometer; calibrate '
                          'with one, or record the pose')
    if noise is None or noise.specific_force is None:
        raise ConfigError('the calibration holds no noise.specific_force; calibrate with a '
                          'stretch at rest')
    wrench = design(calibration, settings).bias_filter
    if wrench is None or not wrench.augmented:
        raise ConfigError(f'filter {settings.filter} with {settings.learning.states} states needs '
                          f'a pose; without one use {" or ".join(LEARNING)} with 12')
    com = calibration.com.value
    place = com if accelerometer.position is None else accelerometer.position.value
    inertia = np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value
    mass_std = float(np.nan_to_num(calibration.mass.std))
    paper = settings.learning.covariances == 'paper'
    R = block_diag(wrench.covariances.R if paper else noise.wrench.value,
                   noise.specific_force.value)
    return PoseFreeModel(
        wrench, imu, calibration.gravity, float(calibration.mass),
        sqrt(mass_std ** 2 + imu.payload_std ** 2 + 1e-12),
        np.vstack([np.eye(3), skew(com)]), place - com, inertia, R)
