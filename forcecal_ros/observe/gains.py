"""Gains of filter ``kalman`` as a calibration keeps them, and how sure and quick they make it."""

from dataclasses import replace
from math import exp, inf, log, pi, tau
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.bandwidth import as_calibrated
from forcecal_ros.observe.design import design, Model
from forcecal_ros.observe.filters.covariances import load_maps, noise_of_reading
from forcecal_ros.observe.filters.memory import KALMAN
from forcecal_ros.observe.settings import ObserverSettings
import numpy as np
from scipy.integrate import quad


class Accuracy(NamedTuple):
    """
    What is to be expected of the contact wrench [N, N m].

    Attributes
    ----------
    bandwidth : float
        Where its answer to a contact has fallen by 3 dB [Hz].
    rise_time : float
        From 10 to 90 % of a step [s].
    covariance : ndarray, shape (6, 6)
        Of its error while the contact wanders by ``walk``, about the origin of ft_sensor.
    innovation : ndarray, shape (6, 6)
        Of what a reading differs from the last estimate by, where the noise is white.
    walk : ndarray, shape (6,)
        Wander of a contact that is expected: of the force as the settings say, of the torque
        what the gain is best for [N/sqrt(s), N m/sqrt(s)].
    """

    bandwidth: float
    rise_time: float
    covariance: Array
    innovation: Array
    walk: Array

    @property
    def std(self) -> Array:
        """Standard deviation of the contact wrench, shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def rise_time(bandwidth: Any) -> Any:
    """10-90 % rise [s] of the first-order filter with this corner [Hz]."""
    return log(9.0) / (tau * bandwidth)


def accuracy(calibration: Calibration, model: Model,
             settings: ObserverSettings = ObserverSettings()) -> Accuracy | None:
    """
    Predict the error of filter ``kalman`` from the measured noise.

    With the gain k of one update, what the noise R leaves is R k / (2 - k), and what a random walk
    of variance q a period leaves q (1 - k)^2 / (k (2 - k)). Of the noise of the angular
    acceleration, which the poses tell slowly, the filter takes off the fast share.

    Parameters
    ----------
    model
        Its :func:`~forcecal_ros.observe.design.design` by these settings.

    Returns
    -------
    Accuracy or None
        None where the calibration holds no noise, or another filter runs.
    """
    noise = calibration.noise
    if noise is None or model.filter != KALMAN:
        return None
    sample, density = noise_of_reading(calibration, noise)
    k = 1 - exp(-model.rate / noise.wrench_rate)
    R = density * noise.wrench_rate
    walk = np.diag(R) * k * k / (1 - k)
    said = as_calibrated(settings, calibration).contact_walk
    if said is not None:
        walk[:3] = said ** 2 / noise.wrench_rate
    error = R * k / (2 - k) + np.diag(walk) * (1 - k) ** 2 / (k * (2 - k))
    _, by_alpha = load_maps(calibration)
    turning = _alpha_variance(model, settings) * by_alpha @ by_alpha.T
    fast = _fast_share(model.rate / model.rotation_poles.real)
    bandwidth = model.rate / tau
    return Accuracy(bandwidth, rise_time(bandwidth), error + (1 - fast) * turning,
                    error + np.diag(walk) + sample + fast * turning,
                    np.sqrt(walk * noise.wrench_rate))


def _alpha_variance(model: Model, settings: ObserverSettings) -> float:
    """Noise of the angular acceleration: the third state of a Butterworth filter of poses."""
    density = settings.pose_rotation_std ** 2 / settings.pose_rate
    return float(density * model.rotation_poles.real ** 5 / 3)


def _fast_share(ratio: float) -> float:
    """
    Share of the angular acceleration's noise that a first-order low-pass takes off.

    Its spectrum is x^4 / (1 + x^6) at x times the corner of the pose filter; ``ratio`` is the
    corner of the low-pass over that one.
    """
    share, _ = quad(lambda x: x ** 6 / (1 + x ** 6) / (x * x + ratio * ratio), 0.0, inf)
    return float(3 / pi * share)


def noise_of_force(calibration: Calibration, bandwidths: Array) -> Array | None:
    """
    Return the noise of a steady contact force at each bandwidth [Hz], shape (n, 3) [N].

    None where the calibration holds no noise.
    """
    noise = calibration.noise
    if noise is None:
        return None
    _, density = noise_of_reading(calibration, noise)
    k = 1 - np.exp(-tau * bandwidths / noise.wrench_rate)[:, np.newaxis]
    return np.asarray(np.sqrt(np.diag(density)[:3] * noise.wrench_rate * k / (2 - k)))


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
