"""A filter of gravity compensation and what it remembers, for a node to carry along."""

from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.gravity.live import begin, Live, on_sample
from forcecal_ros.observe.contact import ContactSample
from forcecal_ros.observe.filters.bias_model import Model, model_from_calibration
from forcecal_ros.observe.settings import FilterSettings as Settings
from forcecal_ros.observe.settings import Settings as ObserverSettings
from forcecal_ros.observe.tracking import Rotation
import numpy as np


class Compensation(NamedTuple):
    """Model and memory of one filter."""

    model: Model
    live: Live


def compensation_of(calibration: Calibration, name: str, observer: ObserverSettings
                    ) -> Compensation:
    """
    Begin a filter.

    Parameters
    ----------
    calibration : Calibration
    name : str
        ``ukf``, ``ekf`` or ``static``.
    observer : observe.Settings
        Of the observer that the samples come from.

    Returns
    -------
    Compensation

    Raises
    ------
    ConfigError
        There is no such filter, or the calibration does not hold what it needs.
    """
    model = model_from_calibration(calibration, Settings(filter=name), observer)
    return Compensation(model, begin(model))


def rebiased(compensation: Compensation | None, bias: tuple[float, ...]) -> Compensation | None:
    """
    Begin a filter anew with the bias its observer has now.

    Parameters
    ----------
    compensation : Compensation or None
    bias : tuple of 6 float
        [N], [N m]

    Returns
    -------
    Compensation or None
        None where there is no filter.
    """
    if compensation is None:
        return None
    model = compensation.model._replace(bias=np.array(bias))
    return Compensation(model, begin(model))


def compensated(compensation: Compensation, sample: ContactSample, rotation: Rotation | None
                ) -> tuple[Compensation, tuple[float, ...]]:
    """
    Take in one sample of the observer.

    Parameters
    ----------
    compensation : Compensation
    sample : ContactSample
    rotation : Rotation or None
        Orientation as the observer follows it.

    Returns
    -------
    compensation : Compensation
    wrench : tuple of 6 float
        Contact wrench, environment on tool, in ft_sensor [N], [N m].
    """
    live, estimate = on_sample(compensation.live, sample, rotation, compensation.model)
    return Compensation(compensation.model, live), tuple(estimate.wrench.tolist())
