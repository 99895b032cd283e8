"""Gains of filter ``kalman`` in the form in which a calibration keeps and publishes them."""

from dataclasses import replace
from math import exp, tau

from forcecal_ros.calibration.model import Calibration, Estimate
from forcecal_ros.observe.accuracy import Accuracy, accuracy
from forcecal_ros.observe.bandwidth import as_calibrated
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.settings import ObserverSettings


def kalman_gains(model: Model, dt: float) -> dict[str, Estimate]:
    """
    Return the gains of filter ``kalman`` as a calibration keeps them.

    ``bandwidth`` (-3 dB) [Hz], ``contact`` (gain of one update, ``dt`` [s] after the last), and
    the poles of the pose filters as (real, mean of the pair, split of the pair)
    [1/s, 1/s, 1/s^2].
    """
    return {
        'bandwidth': Estimate(model.rate / tau, 0.0, 'Hz'),
        'contact': Estimate(1 - exp(-model.rate * dt), 0.0, '1'),
        'rotation': Estimate(model.rotation_poles, 0.0, '1/s, 1/s, 1/s^2'),
        'offset': Estimate(model.offset_poles, 0.0, '1/s, 1/s, 1/s^2'),
    }


def _promised(found: Accuracy | None) -> dict[str, Estimate]:
    """Return the rise of a step and the standard deviation of the contact wrench; see Accuracy."""
    if found is None:
        return {}
    return {'rise_time': Estimate(found.rise_time, 0.0, 's'),
            'std': Estimate(found.std, 0.0, 'N, N m')}


def _chosen_by(settings: ObserverSettings) -> dict[str, Estimate]:
    """Return what an observer that is told nothing else designs the same gains by."""
    return {name: Estimate(value, 0.0, unit) for name, value, unit in (
        ('contact_walk', settings.contact_walk, 'N/sqrt(s)'),
        ('bandwidth_min', settings.bandwidth_min_hz, 'Hz'),
        ('bandwidth_max', settings.bandwidth_max_hz, 'Hz')) if value is not None}


def with_kalman_gains(calibration: Calibration, settings: ObserverSettings = ObserverSettings()
                      ) -> Calibration:
    """
    Return the calibration with the gains of filter ``kalman`` written into it.

    The gains are a record of what runs: the observer designs its own, by the noise, walk and
    limits that the calibration holds. Returned as it is where it has no observer part.
    """
    if calibration.observer is None:
        return calibration
    observer = replace(calibration.observer, mode='kalman', kalman={})
    by_kalman = replace(calibration, observer=observer)
    settings = as_calibrated(settings, by_kalman)
    model = design(by_kalman, settings)
    kalman = (kalman_gains(model, observer.dt) | _chosen_by(settings)
              | _promised(accuracy(by_kalman, model, settings)))
    return replace(calibration, observer=replace(calibration.observer, kalman=kalman))
