"""Gains from noise: how fast each filter may be, by Riccati equation, response and quiet."""

from math import atan, inf, log, tau
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration, Noise
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
from forcecal_ros.observe.inertial import Load
from forcecal_ros.observe.riccati import stationary_filter, StationaryFilter
from forcecal_ros.observe.settings import ObserverSettings
from forcecal_ros.observe.tracking import Poles
import numpy as np

RISE_TIME = 0.015
"""Longest 10-90 % rise of a contact force that the default bandwidth may have, which is the bar
of benchmark/observer_response.py [s]."""

QUIET_BAND = (50.0, 200.0)
"""Band in which the default bandwidth takes 12 dB off white noise: there the same benchmark wants
10 dB [Hz]."""

STATES = ('position', 'velocity', 'accelerometer offset', 'contact force')

ROTATION_CORNERS = (30.0, 150.0)
"""Slowest and fastest corner of the filter that follows the orientation: it lags by 2/corner, 13
to 67 ms, and its angular acceleration is as noisy as corner^2.5 [rad/s]."""

MOTION_CORNERS = (20.0, 100.0)
"""The same of the filter that finds the acceleration where there is no accelerometer, from
positions that are noisier than orientations [rad/s]."""

_QUIETEST = 1e-12
"""Least density that is believed: the noise of simulations without noise is rounding, of which no
gain can be made [N^2 s] and so on."""


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


def noise_levels(noise: Noise | None) -> NoiseLevels:
    """
    Reduce the measured covariances to densities.

    Without any, a quarter of a newton, 0.02 N m and 0.03 m/s^2 at 1 kHz are assumed, the noise of
    the nominal rig.

    Raises
    ------
    ConfigError
        A covariance or rate is not a finite number.
    """
    if noise is None:
        return NoiseLevels(0.0625e-3, 4e-7, 1e-6, 1000.0, 1000.0)
    wrench = np.diag(noise.wrench.value)
    f, f_rate = 0.0, noise.wrench_rate
    if noise.specific_force is not None:
        f_rate = noise.accelerometer_rate
        f = float(np.diag(noise.specific_force.value).mean()) / f_rate
    force, torque = wrench[:3].mean() / noise.wrench_rate, wrench[3:].mean() / noise.wrench_rate
    if not np.isfinite([force, torque, f]).all() or not 0 < noise.wrench_rate < inf:
        raise ConfigError('noise.wrench, noise.specific_force and their rates want finite '
                          'numbers; calibrate with a phase at rest')
    return NoiseLevels(max(float(force), _QUIETEST), max(float(torque), _QUIETEST),
                       max(f, _QUIETEST), noise.wrench_rate, f_rate)


def joint_model(
        levels: NoiseLevels, mass: float, settings: ObserverSettings, dt: float, position: bool,
) -> tuple[Array, Array, Array, Array, Array]:
    """
    Write one axis of the whole problem: place, offset and contact force together.

    x = [p, v, o, F], the accelerometer as input: dv/dt = f - o + g. Measured are p and
    u - m a = F + m o, whose noise (m times the accelerometer's) is also the noise that drives v.

    Returns A, C, Q, R, S of shapes (4, 4), (m, 4), (4, 4), (m, m), (4, m) for a period ``dt``
    [s], as :func:`stationary_filter` takes them; ``position`` says whether p is measured.
    """
    A = np.eye(4)
    A[0, 1], A[0, 2], A[1, 2] = dt, -dt * dt / 2, -dt
    f = levels.specific_force / dt
    drive = np.array([dt * dt / 2, dt, 0.0, 0.0])
    Q = f * np.outer(drive, drive)
    Q[2, 2] += settings.offset_walk ** 2 * dt
    Q[3, 3] += settings.contact_walk ** 2 * dt
    C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, mass, 1.0]])
    p_variance = settings.pose_position_std ** 2 / settings.pose_rate / dt
    R = np.diag([p_variance, levels.force / dt + mass ** 2 * f])
    S = np.stack([np.zeros(4), mass * f * drive], axis=1)
    rows = [0, 1] if position else [1]
    return A, C[rows], Q, R[np.ix_(rows, rows)], S[:, rows]


def design_joint(
        levels: NoiseLevels, mass: float, settings: ObserverSettings, dt: float,
        position: bool = True,
) -> StationaryFilter:
    """
    Design the unconstrained filter for all four states, the yardstick of the one that runs.

    Raises
    ------
    UnobservableError
        Without the position, offset and contact force cannot be told apart.
    """
    A, C, Q, R, S = joint_model(levels, mass, settings, dt, position)
    return stationary_filter(A, C, Q, R, STATES, S)


def _poles(A: Array, gain: Array, dt: float) -> Poles:
    """Continuous poles of a stationary filter's error, slowest first if all are real."""
    modes = np.log(np.linalg.eigvals((np.eye(3) - gain @ np.eye(1, 3)) @ A).astype(complex)) / dt
    modes = modes[np.argsort(np.abs(modes.imag) + 1e-9 * np.abs(modes))]
    real, first, second = modes
    mean = -(first + second).real / 2
    product = (first * second).real
    return Poles(float(-real.real), float(mean), float(product - mean * mean))


def offset_poles(levels: NoiseLevels, settings: ObserverSettings, position_std: float) -> Poles:
    """Design place, velocity and offset of the accelerometer from the pose (its std in m)."""
    dt = 1 / settings.pose_rate
    A, C, Q, R, _ = joint_model(levels, 1.0, settings, dt, True)
    A, C, Q, R = A[:3, :3], C[:1, :3], Q[:3, :3], R[:1, :1]
    R = np.full((1, 1), position_std ** 2)
    # white acceleration noise between two poses, not one sample of it
    Q[:2, :2] = levels.specific_force * np.array([[dt ** 3 / 3, dt * dt / 2], [dt * dt / 2, dt]])
    return _poles(A, stationary_filter(A, C, Q, R, STATES[:3]).gain, dt)


def contact_bandwidth(levels: NoiseLevels, mass: float, settings: ObserverSettings) -> float:
    """
    Choose the bandwidth of the contact wrench by noise against response.

    The Riccati equation of the random walk balances ``contact_walk`` against the measured noise
    of u - m a: quiet sensors make it fast, noisy ones slow. Two limits stand on its sides: never
    slower than a rise in 14.6 ms (24 Hz), never so fast that less than 12 dB come off white noise
    between 50 and 200 Hz (26 Hz). ``bandwidth_hz`` overrides all three [Hz].
    """
    if settings.bandwidth_hz is not None:
        return settings.bandwidth_hz
    dt = 1 / levels.rate
    one = np.eye(1)
    noise = (levels.force + mass ** 2 * levels.specific_force) / dt
    walk = settings.contact_walk ** 2 * dt
    k = float(stationary_filter(one, one, walk * one, noise * one, STATES[3:]).gain[0, 0])
    slowest = log(9.0) / (0.975 * RISE_TIME * tau)
    return min(max(-log(1 - k) / dt / tau, slowest), _quiet_bandwidth(12.0))


def _quiet_bandwidth(decibels: float) -> float:
    """Corner of the first-order filter that takes so much off white noise in QUIET_BAND [Hz]."""
    low, high = QUIET_BAND
    corner = low
    for _ in range(50):
        corner = 10 ** (-decibels / 10) * (high - low) / (atan(high / corner) - atan(low / corner))
    return corner


def rotation_corner(
        calibration: Calibration, load: Load, levels: NoiseLevels, rate: float,
        settings: ObserverSettings) -> float:
    """
    Find the fastest pose filter whose angular acceleration adds no more noise than the wrench has.

    White noise leaves (its density) corner^5 / 3 in the third state of a Butterworth filter.
    """
    m = load.m
    lever = m * float(np.linalg.norm(load[4:7]))
    arm = float(np.linalg.norm(calibration.com.value))
    inertia = float(np.abs(np.array(load[7:10])).max()) + arm * lever
    force = (levels.force + m * m * levels.specific_force) * rate / 2
    torque = (levels.torque + (arm * m) ** 2 * levels.specific_force) * rate / 2
    alpha = min(force / lever ** 2 if lever > 0 else inf,
                torque / inertia ** 2 if inertia > 0 else inf)
    density = settings.pose_rotation_std ** 2 / settings.pose_rate
    low, high = ROTATION_CORNERS
    return float(min(max((3 * alpha / density) ** 0.2, low), high, 0.6 * settings.pose_rate))


def motion_corner(levels: NoiseLevels, mass: float, rate: float, settings: ObserverSettings
                  ) -> float:
    """Find the same for the acceleration that stands in where there is no accelerometer."""
    variance = levels.force * rate / 2 / mass ** 2
    density = settings.pose_position_std ** 2 / settings.pose_rate
    low, high = MOTION_CORNERS
    return float(min(max((3 * variance / density) ** 0.2, low), high, 0.6 * settings.pose_rate))
