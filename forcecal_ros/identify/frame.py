"""The frame of the wrench and the way down, asked of the static poses before any fit."""

from forcecal_ros.geometry import Array
from forcecal_ros.identify.poses import StaticPose
from forcecal_ros.identify.settings import IdentificationSettings
from forcecal_ros.identify.static_readings import check_weight, Statics
from forcecal_ros.recording.axes import DOWN, level_from_base
from forcecal_ros.recording.checks.frame_faults import (
    refuse_other_frame,
    refuse_unexplained,
    refuse_weightless,
    slightly_off,
)
from forcecal_ros.recording.checks.frames import Forces, judge
from forcecal_ros.recording.checks.orientations import refuse_other_orientation
from forcecal_ros.recording.checks.torques import refuse_exchanged, refuse_other_torques
import numpy as np


def slight_misfit(poses: list[StaticPose], statics: Statics,
                  settings: IdentificationSettings) -> str:
    """
    Name a small turn of the sensor or tilt of the base; empty: there is none.

    Raises
    ------
    UnobservableError
        The poses do not tell mass from bias, or show no weight.
    DataError
        The wrench is in another frame, has other axes, its torques other ones than its forces,
        or base is far from level.
    """
    R_level_base = level_from_base(settings.gravity_direction)
    back: Array = np.eye(3) if R_level_base is None else R_level_base.T
    believed = back @ DOWN
    noise = None
    if statics.covariance is not None:
        noise = np.sqrt(np.trace(statics.covariance[:, :3, :3], axis1=1, axis2=2) / 3.0)
    forces = Forces(back @ np.stack([pose.R_base_sensor for pose in poses]),
                    statics.wrench[:, :3], settings.gravity * believed, noise)
    judgement = judge(forces)
    refuse_exchanged(forces, statics.wrench[:, 3:])
    refuse_other_orientation(forces, judgement)
    refuse_other_frame(judgement, believed, settings.wrench_sign, settings.sensor_rotation)
    check_weight(statics.gravity, settings.thresholds.condition)
    refuse_weightless(judgement)
    refuse_unexplained(judgement)
    torque_noise = None if statics.covariance is None else np.sqrt(np.diagonal(
        statics.covariance[:, 3:, 3:], axis1=1, axis2=2).mean(axis=0))
    refuse_other_torques(judgement.plain.mass * statics.gravity, statics.wrench[:, 3:],
                         torque_noise, forces.R_base_sensor)
    return slightly_off(judgement, believed)
