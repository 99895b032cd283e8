"""The observer: weight, inertia and bias removed from a wrench, live and over recordings.

calibration, settings -> design (bandwidth) -> model
events -> step (align -> motion -> contact, bias_filter) -> contact wrench, status
recording -> playback (batch: the same functions, compiled) -> the same for all wrenches at once
"""

from forcecal_ros.observe.bandwidth import noise_levels, NoiseLevels
from forcecal_ros.observe.design import design, kalman_gains, Model, with_bias, with_kalman_gains
from forcecal_ros.observe.live import Tare, tare
from forcecal_ros.observe.playback import replay
from forcecal_ros.observe.pose_free import Imu
from forcecal_ros.observe.sample import (
    ContactEstimate,
    ContactSample,
    describe,
    level,
    Status,
)
from forcecal_ros.observe.settings import FilterSettings, ObserverSettings
from forcecal_ros.observe.step import (
    finish,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    State,
)

__all__ = [
    'ContactEstimate', 'ContactSample', 'FilterSettings', 'Imu', 'Model', 'NoiseLevels',
    'ObserverSettings', 'State', 'Status', 'Tare', 'describe', 'design', 'finish', 'kalman_gains',
    'level', 'noise_levels', 'on_accelerometer', 'on_displacement', 'on_pose', 'on_wrench',
    'replay', 'tare', 'with_bias', 'with_kalman_gains',
]
