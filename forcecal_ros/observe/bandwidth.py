"""Gains from noise: how fast each filter may be, by Riccati equation and the user's limits."""

from dataclasses import replace
from math import inf, log1p, pi, sqrt, tau
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration, Noise
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.estimation import stationary_gain
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.observe.settings import (
    BANDWIDTH_LIMITS,
    CONTACT_WALK,
    ObserverSettings,
    POSE_RATE_HZ,
)
import numpy as np
from scipy.integrate import quad

UNMEASURED_HZ = 24.7
"""Bandwidth where a calibration holds no noise that one could follow from: that of the nominal
rig's noise [Hz]."""

ROTATION_CORNERS = (30.0, 150.0)
"""Slowest and fastest corner of the filter that follows the orientation: it lags by 2/corner, 13
to 67 ms, and its angular acceleration is as noisy as corner^2.5 [rad/s]."""

_MIN_DENSITY = 1e-12
"""Least density: the noise of simulations without noise is rounding, of which no
gain can be made [N^2 s] and so on."""


class Poles(NamedTuple):
    """
    Poles of a third-order filter: ``-real`` and ``-mean +- sqrt(-split)`` [1/s, 1/s, 1/s^2].

    A positive ``split`` is a complex pair, a negative one a real pair.
    """

    real: float
    mean: float
    split: float


def butterworth(corner: float) -> Poles:
    """
    Return the poles of the stationary Kalman filter for a white third derivative.

    ``corner`` is the sixth root of the density of that derivative over that of the measurement
    [rad/s].
    """
    return Poles(corner, corner / 2, 0.75 * corner * corner)


class NoiseLevels(NamedTuple):
    """Densities of what enters the filters, per axis (mean of three)."""

    force: float
    """Of the force sensor [N^2 s]."""
    torque: float
    """[(N m)^2 s]"""
    specific_force: float
    """[(m/s^2)^2 s]"""
    rate: float
    """Of the wrench [Hz]."""
    accelerometer_rate: float
    """[Hz]"""


def noise_levels(noise: Noise | None, slow: bool = False) -> NoiseLevels:
    """
    Reduce the measured covariances to densities, or take the :func:`densities` of ``slow`` noise.

    Without any, a quarter of a newton, 0.02 N m and 0.03 m/s^2 at 1 kHz are assumed, the noise of
    the nominal rig.

    Raises
    ------
    ConfigError
        A covariance or rate is not a finite number.
    """
    if noise is None:
        return NoiseLevels(0.0625e-3, 4e-7, 1e-6, 1000.0, 1000.0)
    wrench, f = (np.diag(one) for one in densities(noise, slow))
    found = [float(one.mean()) for one in (wrench[:3], wrench[3:], f)]
    if not np.isfinite(found).all() or not 0 < noise.wrench_rate < inf:
        raise ConfigError('noise.wrench, noise.specific_force and their rates must be finite '
                          'numbers; calibrate from a recording with a phase at rest')
    force, torque, specific_force = (max(one, _MIN_DENSITY) for one in found)
    return NoiseLevels(force, torque, specific_force, noise.wrench_rate,
                       noise.accelerometer_rate if noise.specific_force else noise.wrench_rate)


def densities(noise: Noise, slow: bool = True) -> tuple[Array, Array]:
    """
    Return what wrench (6, 6) and specific force (3, 3) have of noise.

    It is that of white noise; of ``slow`` noise, which passes a filter of tens of hertz, the
    lag-window estimate where the calibration holds it. Zero without an accelerometer.
    """
    wrench, f = noise.wrench.value / noise.wrench_rate, np.zeros((3, 3))
    if slow and noise.wrench_density is not None:
        wrench = noise.wrench_density.value
    if slow and noise.specific_force_density is not None:
        f = noise.specific_force_density.value
    elif noise.specific_force is not None:
        f = noise.specific_force.value / noise.accelerometer_rate
    return wrench, f


def place_of(calibration: Calibration) -> Array:
    """Return where the accelerometer is in ft_sensor, (3,) [m]: at the CoM where not known."""
    sensor = calibration.accelerometer
    if sensor is None or sensor.position is None:
        return calibration.com.value
    return sensor.position.value


def load_maps(calibration: Calibration) -> tuple[Array, Array]:
    """Return what specific force and angular acceleration do to the load, two of shape (6, 3)."""
    m, c = float(calibration.mass), calibration.com.value
    by_force = -m * np.vstack([np.eye(3), skew(c)])
    by_alpha = by_force @ -skew(c - place_of(calibration))
    if calibration.inertia is not None:
        by_alpha[3:] -= calibration.inertia.value
    return by_force, by_alpha


def noise_of_reading(calibration: Calibration, noise: Noise) -> tuple[Array, Array]:
    """Return covariance and low-frequency density of u - m a, two of shape (6, 6)."""
    by_force, _ = load_maps(calibration)
    sample, (density, f_density) = noise.wrench.value, densities(noise)
    if noise.specific_force is not None:
        sample = sample + by_force @ noise.specific_force.value @ by_force.T
    return sample, density + by_force @ f_density @ by_force.T


def as_calibrated(settings: ObserverSettings, calibration: Calibration) -> ObserverSettings:
    """
    Fill in what the settings leave to the calibration: walk and limits of the bandwidth.

    Raises
    ------
    ConfigError
        The slowest corner is above the fastest.
    """
    kept = {} if calibration.observer is None else calibration.observer.kalman
    given = (settings.contact_walk, settings.bandwidth_min_hz, settings.bandwidth_max_hz)
    walk, low, high = (
        float(kept.get(name, usual)) if one is None else one for name, one, usual in zip(
            ('contact_walk', 'bandwidth_min', 'bandwidth_max'), given,
            (CONTACT_WALK, *BANDWIDTH_LIMITS)))
    return replace(settings, contact_walk=walk, bandwidth_min_hz=low, bandwidth_max_hz=high)


def _poles(A: Array, gain: Array, dt: float) -> Poles:
    """Continuous poles of a stationary filter's error, slowest first if all are real."""
    modes = np.log(np.linalg.eigvals((np.eye(3) - gain @ np.eye(1, 3)) @ A).astype(complex)) / dt
    modes = modes[np.argsort(np.abs(modes.imag) + 1e-9 * np.abs(modes))]
    real, first, second = modes
    mean = -(first + second).real / 2
    product = (first * second).real
    return Poles(float(-real.real), float(mean), float(product - mean * mean))


def offset_poles(levels: NoiseLevels, position_std: float) -> Poles:
    """
    Design place, velocity and offset of the accelerometer from the pose (its std in m).

    Along one axis x = [p, v, o], the accelerometer as input: dv/dt = f - o + g; p is measured.
    """
    dt = 1 / POSE_RATE_HZ
    # wander of the offset [m/s^2/sqrt(s)]
    offset_walk = 5e-4
    A = np.array([[1.0, dt, -dt * dt / 2], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    # white acceleration noise between two poses, not one sample of it
    Q = levels.specific_force * np.array([
        [dt ** 3 / 3, dt * dt / 2, 0.0], [dt * dt / 2, dt, 0.0], [0.0, 0.0, 0.0]])
    Q[2, 2] = offset_walk ** 2 * dt
    return _poles(A, stationary_gain(A, np.eye(1, 3), Q, np.full((1, 1), position_std ** 2)), dt)


def contact_bandwidth(levels: NoiseLevels, mass: float, settings: ObserverSettings) -> float:
    """
    Choose the bandwidth of the contact wrench by the noise that was measured.

    The Riccati equation of the random walk balances ``contact_walk`` against the noise of
    u - m a: quiet sensors make it fast, noisy ones slow, between ``bandwidth_min_hz`` and
    ``bandwidth_max_hz``; ``bandwidth_hz`` overrides all three [Hz].
    """
    if settings.bandwidth_hz is not None:
        return settings.bandwidth_hz
    dt = 1 / levels.rate
    noise = (levels.force + mass ** 2 * levels.specific_force) / dt
    walk = (CONTACT_WALK if settings.contact_walk is None else settings.contact_walk) ** 2 * dt
    variance = (walk + sqrt(walk * walk + 4 * walk * noise)) / 2
    return within_limits(log1p(variance / noise) / dt / tau, settings)


def within_limits(bandwidth: float, settings: ObserverSettings) -> float:
    """Return the bandwidth nearest to this one that the settings allow [Hz]."""
    low, high = (usual if given is None else given for given, usual in zip(
        (settings.bandwidth_min_hz, settings.bandwidth_max_hz), BANDWIDTH_LIMITS))
    return min(max(bandwidth, low), high)


def acceleration_variance(std: float, corner: float) -> float:
    """Noise that poses with this deviation leave in the third state of a Butterworth filter."""
    return std ** 2 / POSE_RATE_HZ * corner ** 5 / 3


def fast_share(ratio: float) -> float:
    """
    Share of that noise that a first-order low-pass removes.

    Its spectrum is x^4 / (1 + x^6) at x times the corner of the pose filter; ``ratio`` is the
    corner of the low-pass over that one.
    """
    share, _ = quad(lambda x: x ** 6 / (1 + x ** 6) / (x * x + ratio * ratio), 0.0, inf)
    return float(3 / pi * share)


def pose_noise(calibration: Calibration, rotation: float, motion: float, accelerometer: bool,
               settings: ObserverSettings) -> Array:
    """
    Covariance of the load by the noise of the pose, shape (6, 6).

    Parameters
    ----------
    rotation, motion : float
        Corners of the filters that follow orientation and place [rad/s].
    accelerometer : bool
        Whether there is one; without it the pose also shows gravity and acceleration.
    """
    by_force, by_alpha = load_maps(calibration)
    std = settings.pose_rotation_std
    cov = acceleration_variance(std, rotation) * by_alpha @ by_alpha.T
    if not accelerometer:
        variance = 2 * rotation * (std * calibration.gravity) ** 2 / POSE_RATE_HZ
        if settings.position:
            variance += acceleration_variance(settings.pose_position_std, motion)
        cov += variance * by_force @ by_force.T
    return np.asarray(cov)


def rotation_corner(
        calibration: Calibration, levels: NoiseLevels, rate: float, settings: ObserverSettings,
) -> float:
    """
    Find the fastest pose filter whose angular acceleration adds no more noise than the wrench has.

    White noise leaves (its density) corner^5 / 3 in the third state of a Butterworth filter.
    """
    m, c = float(calibration.mass), calibration.com.value
    arm = float(np.linalg.norm(c))
    lever = m * float(np.linalg.norm(c - place_of(calibration)))
    J = np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value
    inertia = float(np.abs(np.diag(J)).max()) + arm * lever
    force = (levels.force + m * m * levels.specific_force) * rate / 2
    torque = (levels.torque + (arm * m) ** 2 * levels.specific_force) * rate / 2
    alpha = min(force / lever ** 2 if lever > 0 else inf,
                torque / inertia ** 2 if inertia > 0 else inf)
    return _corner(alpha, settings.pose_rotation_std, ROTATION_CORNERS)


def motion_corner(levels: NoiseLevels, mass: float, rate: float, settings: ObserverSettings
                  ) -> float:
    """Find the same for the acceleration that stands in where there is no accelerometer."""
    variance = levels.force * rate / 2 / mass ** 2
    # motion corners: the same of the filter that finds the acceleration where there is no
    # accelerometer, from positions that are noisier than orientations [rad/s]
    return _corner(variance, settings.pose_position_std, (20.0, 100.0))


def _corner(variance: float, std: float, limits: tuple[float, float]) -> float:
    """Return the corner within limits that makes :func:`acceleration_variance` so large."""
    low, high = limits
    return float(min(max((3 * variance * POSE_RATE_HZ / std ** 2) ** 0.2, low), high))
