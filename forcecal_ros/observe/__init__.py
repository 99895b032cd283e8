"""The observer: weight, inertia and bias off a wrench, live and over recordings.

calibration, settings -> design (bandwidth, riccati) -> model
events -> step (align -> motion -> unload -> filters) -> contact wrench, status
recording -> playback (batch: the same functions, compiled) -> the same for all wrenches at once
"""

from forcecal_ros.observe.bandwidth import noise_levels, NoiseLevels
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.gains import kalman_gains, with_kalman_gains
from forcecal_ros.observe.playback import replay
from forcecal_ros.observe.pose_free.model import Imu
from forcecal_ros.observe.sample import ContactEstimate, ContactSample
from forcecal_ros.observe.settings import FilterSettings, ObserverSettings
from forcecal_ros.observe.status import describe, level, Status
from forcecal_ros.observe.step import (
    finish,
    on_accelerometer,
    on_displacement,
    on_pose,
    on_wrench,
    State,
)
from forcecal_ros.observe.tare import Tare, tare, with_bias

__all__ = [
    'ContactEstimate', 'ContactSample', 'FilterSettings', 'Imu', 'Model', 'NoiseLevels',
    'ObserverSettings', 'State', 'Status', 'Tare', 'describe', 'design', 'finish', 'kalman_gains',
    'level', 'noise_levels', 'on_accelerometer', 'on_displacement', 'on_pose', 'on_wrench',
    'replay', 'tare', 'with_bias', 'with_kalman_gains',
]
