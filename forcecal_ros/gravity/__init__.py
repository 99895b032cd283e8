"""Gravity compensation after [Ukf2025]: what is left of a wrench once weight and inertia are off.

:mod:`gaussian`, :mod:`sigma_points`, :mod:`ukf`, :mod:`kalman` are filters as pure functions;
:mod:`model` says what a reading is made of, :mod:`contact` when biases may learn, :mod:`step`
puts them together; :mod:`live` and :mod:`playback` feed it from the observer. Without a pose:
:mod:`orientation` and :mod:`pose_free`.
"""

from forcecal_ros.gravity.live import begin, Live, on_sample
from forcecal_ros.gravity.playback import Compensated, replay, replay_pose_free
from forcecal_ros.observe.filters.bias_filter import (
    describe,
    Estimate,
    initial_state,
    State,
    step,
    weight,
)
from forcecal_ros.observe.filters.bias_model import (
    Model,
    model_from_calibration,
    observability_rank,
)
from forcecal_ros.observe.pose_free.model import Imu, pose_free_model, PoseFreeModel
from forcecal_ros.observe.pose_free.step import pose_free_step, PoseFreeEstimate, PoseFreeState
from forcecal_ros.observe.settings import FilterSettings as Settings

__all__ = [
    'Compensated', 'Estimate', 'Imu', 'Live', 'Model', 'PoseFreeEstimate', 'PoseFreeModel',
    'PoseFreeState', 'Settings', 'State', 'begin', 'describe', 'initial_state',
    'model_from_calibration', 'observability_rank', 'on_sample', 'pose_free_model',
    'pose_free_step', 'replay', 'replay_pose_free', 'step', 'weight',
]
