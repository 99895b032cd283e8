"""Contact-force observer: one pure step for node and replay."""

from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.design import Model, design, kalman_gains, noise_levels
from forcecal_ros.observe.playback import ContactEstimate, replay
from forcecal_ros.observe.settings import Settings
from forcecal_ros.observe.status import Status, describe, level
from forcecal_ros.observe.step import (
    State, finish, on_accelerometer, on_displacement, on_pose, on_wrench)
from forcecal_ros.observe.tare import Tare, tare, with_bias

__all__ = [
    'ContactEstimate', 'ContactSample', 'Model', 'Settings', 'State', 'Status', 'Tare',
    'describe', 'design', 'finish', 'kalman_gains', 'level', 'noise_levels', 'on_accelerometer',
    'on_displacement', 'on_pose', 'on_wrench', 'replay', 'tare', 'with_bias',
]
