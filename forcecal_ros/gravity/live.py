"""Gravity compensation behind the observer: from its samples to compensated wrenches.

The observer brings the streams together, knows their delays, and works out the load of the tool
from accelerometer and pose; what is left to do here is one ``bias_filter.step``
a sample. Node and replay both call :func:`on_sample` and nothing else.
"""

from typing import NamedTuple

from forcecal_ros.geometry import Array, matrix_from_quaternion
from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.filters.bias_filter import (
    Estimate,
    initial_state,
    INVALID,
    State,
    step,
    weight,
)
from forcecal_ros.observe.filters.bias_model import Model
from forcecal_ros.observe.status import BAD_WRENCH, NO_GRAVITY
from forcecal_ros.observe.tracking import Rotation, turned
import numpy as np

POSE_TIMEOUT = 0.1
"""Age of a pose up to which ``static`` takes the weight from it [s]."""


class Live(NamedTuple):
    """
    What is remembered between two samples.

    Attributes
    ----------
    t : float
        Stamp of the last sample that was used [s]; NaN before the first.
    state : State
    """

    t: float
    state: State


def begin(model: Model) -> Live:
    """Return what is remembered before the first sample."""
    return Live(float('nan'), initial_state(model))


def on_sample(live: Live, sample: ContactSample, rotation: Rotation | None, model: Model,
              ) -> tuple[Live, Estimate]:
    """
    Compensate one sample of the observer.

    Parameters
    ----------
    live : Live
    sample : ContactSample
        Of an observer with the same bias as ``model``.
    rotation : Rotation or None
        Orientation as the observer follows it; ``static`` takes the weight from it, the other
        filters take the sample's load.
    model : Model

    Returns
    -------
    Live
    Estimate
    """
    if live.t >= sample.t:
        # the observer lets time go back only where it starts anew itself
        live = begin(model)
    dt = sample.t - live.t if live.t == live.t else model.covariances.period
    wire, load = np.full(6, np.nan), None
    if not sample.status & BAD_WRENCH:
        wire = np.array(sample.measured) + model.bias + sample.inertial
    if not sample.status & NO_GRAVITY:
        static = model.settings.filter == 'static'
        load = _weight(sample.t, rotation, model) if static else np.array(sample.inertial)
    state, estimate = step(live.state, wire, load, dt, model)
    return Live(live.t if estimate.status & INVALID else sample.t, state), estimate


def _weight(t: float, rotation: Rotation | None, model: Model) -> Array | None:
    if rotation is None or not t - rotation.t <= POSE_TIMEOUT:
        return None
    h = t - rotation.t
    x, y, z = rotation.omega
    return weight(matrix_from_quaternion(turned(rotation.q, h * x, h * y, h * z)), model)
