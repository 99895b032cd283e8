"""Contact-force observer: one pure step for node and replay.

calibration, settings -> design (bandwidth, riccati) -> model
events -> step (align -> contact (tracking, inertial, newton)) -> contact wrench, status
recording -> batch (the same functions, compiled) -> the same for all wrenches at once
"""

from forcecal_ros.observe.bandwidth import noise_levels, NoiseLevels
from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.gains import kalman_gains, with_kalman_gains
from forcecal_ros.observe.playback import ContactEstimate, replay
from forcecal_ros.observe.settings import Settings
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
    'ContactEstimate', 'ContactSample', 'Model', 'NoiseLevels', 'Settings', 'State', 'Status',
    'Tare', 'describe', 'design', 'finish', 'kalman_gains', 'level', 'noise_levels',
    'on_accelerometer', 'on_displacement', 'on_pose', 'on_wrench', 'replay', 'tare', 'with_bias',
    'with_kalman_gains',
]
