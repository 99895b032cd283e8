"""Gains of filter ``kalman`` in the form in which a calibration keeps and publishes them."""

from dataclasses import replace
from math import exp, tau

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.settings import ObserverSettings


def kalman_gains(model: Model, dt: float) -> dict[str, Estimate]:
    """
    Return the gains of filter ``kalman`` as a calibration keeps them.

    ``bandwidth`` [Hz], ``contact`` (gain of one update, ``dt`` [s] after the last), and the poles
    of the pose filters as (real, mean of the pair, split of the pair) [1/s, 1/s, 1/s^2].
    """
    return {
        'bandwidth': Estimate(model.rate / tau, 0.0, 'Hz'),
        'contact': Estimate(1 - exp(-model.rate * dt), 0.0, '1'),
        'rotation': Estimate(model.rotation_poles, 0.0, '1/s, 1/s, 1/s^2'),
        'offset': Estimate(model.offset_poles, 0.0, '1/s, 1/s, 1/s^2'),
    }


def with_kalman_gains(calibration: Calibration) -> Calibration:
    """
    Return the calibration with the gains of filter ``kalman`` written into it.

    They are a record of what runs; the observer designs its own from the calibration's noise.
    Returned as it is where it has no observer part.
    """
    observer = calibration.observer
    if observer is None:
        return calibration
    gains = kalman_gains(design(calibration, ObserverSettings()), observer.dt)
    return replace(calibration, observer=replace(observer, kalman=gains))
