"""From a calibration to the numbers the running step needs; everything slow happens here."""

from math import atan, exp, inf, log, tau
from typing import NamedTuple

from forcecal_ros.calibration import Accelerometer, Calibration, Estimate, Noise
from forcecal_ros.errors import ConfigError
from forcecal_ros.geometry import Array
from forcecal_ros.observe.inertial import Load
from forcecal_ros.observe.riccati import stationary_filter, StationaryFilter
from forcecal_ros.observe.settings import Settings
from forcecal_ros.observe.tracking import butterworth, Poles
import numpy as np

RISE_TIME = 0.015
"""10-90 % rise of a contact force that the default bandwidth keeps [s]."""

QUIET_BAND = (50.0, 200.0)
"""Band in which the default bandwidth takes 12 dB off white noise [Hz]."""

Gain = tuple[float, float, float, float, float, float]

STATES = ('position', 'velocity', 'accelerometer offset', 'contact force')

_QUIETEST = 1e-12
"""Least density that is believed, for calibrations from noise-free data."""

_REACH = 0.3
"""How far an arm is from where it is taken to be when no pose tells [m]."""


class Model(NamedTuple):
    """Everything the step needs besides its state; plain numbers, SI, ft_sensor."""

    newton: bool
    load: Load
    bias: tuple[float, ...]
    gravity: float
    accelerometer: bool
    ac_rate: float
    """Corner of the accelerometer's high-pass [rad/s]; 0 for a sensor that shows DC."""
    volts: tuple[float, ...]
    """Accelerometer: offset (3), then the inverse of its sensitivity, row by row (9)."""
    delay: float
    place: tuple[float, float, float]
    """Where the accelerometer sits at zero displacement."""
    stiffness: float
    relaxation: float
    """Tool: stiffness over damping [1/s]; inf without damping, stiffness 0 without spring."""
    rate: float
    """Corner of the contact wrench [rad/s]."""
    track_offset: bool
    rotation_poles: Poles
    offset_poles: Poles
    motion_poles: Poles
    reach_poles: Poles
    K: Gain
    timeout: float
    pose_timeout: float
    skew: float
    limited: bool
    """Whether ``wrench_limit`` is known."""
    wrench_limit: tuple[float, ...]
    accelerometer_limit: tuple[float, ...]


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


def noise_levels(noise: Noise | None) -> NoiseLevels:
    """
    Reduce the measured covariances to densities.

    Parameters
    ----------
    noise : Noise or None
        None: a quarter of a newton, 0.02 N m and 0.03 m/s^2 at 1 kHz are assumed.

    Returns
    -------
    NoiseLevels

    Raises
    ------
    ConfigError
        A covariance or rate is not a finite number.
    """
    if noise is None:
        return NoiseLevels(0.0625e-3, 4e-7, 1e-6, 1000.0)
    wrench = np.diag(noise.wrench.value)
    f = 0.0
    if noise.specific_force is not None:
        f = float(np.diag(noise.specific_force.value).mean()) / noise.accelerometer_rate
    force, torque = wrench[:3].mean() / noise.wrench_rate, wrench[3:].mean() / noise.wrench_rate
    if not np.isfinite([force, torque, f]).all() or not 0 < noise.wrench_rate < inf:
        raise ConfigError('noise.wrench, noise.specific_force and their rates want finite '
                          'numbers; calibrate with a phase at rest')
    return NoiseLevels(max(float(force), _QUIETEST), max(float(torque), _QUIETEST),
                       max(f, _QUIETEST), noise.wrench_rate)


def joint_model(
        levels: NoiseLevels, mass: float, settings: Settings, dt: float, position: bool,
) -> tuple[Array, Array, Array, Array, Array]:
    """
    Write one axis of the whole problem: place, offset and contact force together.

    x = [p, v, o, F], the accelerometer as input: dv/dt = f - o + g. Measured are p and
    u - m a = F + m o, whose noise (m times the accelerometer's) is also the noise that drives v.

    Parameters
    ----------
    levels : NoiseLevels
    mass : float
        [kg]
    settings : Settings
    dt : float
        Period [s].
    position : bool
        Whether p is measured.

    Returns
    -------
    A, C, Q, R, S : ndarray
        Shapes (4, 4), (m, 4), (4, 4), (m, m), (4, m), as :func:`stationary_filter` takes them.
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
        levels: NoiseLevels, mass: float, settings: Settings, dt: float, position: bool = True,
) -> StationaryFilter:
    """
    Design the unconstrained filter for all four states, the yardstick of the one that runs.

    Parameters
    ----------
    levels : NoiseLevels
    mass, dt : float
        [kg], [s]
    settings : Settings
    position : bool
        Whether the pose tells the position.

    Returns
    -------
    StationaryFilter

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


def offset_poles(levels: NoiseLevels, settings: Settings, position_std: float) -> Poles:
    """
    Design place, velocity and offset of the accelerometer from the pose.

    Parameters
    ----------
    levels : NoiseLevels
    settings : Settings
    position_std : float
        Of one pose [m].

    Returns
    -------
    Poles
    """
    dt = 1 / settings.pose_rate
    A, C, Q, R, _ = joint_model(levels, 1.0, settings, dt, True)
    A, C, Q, R = A[:3, :3], C[:1, :3], Q[:3, :3], R[:1, :1]
    R = np.full((1, 1), position_std ** 2)
    # white acceleration noise between two poses, not one sample of it
    Q[:2, :2] = levels.specific_force * np.array([[dt ** 3 / 3, dt * dt / 2], [dt * dt / 2, dt]])
    return _poles(A, stationary_filter(A, C, Q, R, STATES[:3]).gain, dt)


def contact_bandwidth(levels: NoiseLevels, mass: float, settings: Settings) -> float:
    """
    Choose the bandwidth of the contact wrench by noise against response.

    The Riccati equation of the random walk balances ``contact_walk`` against the measured noise
    of u - m a: quiet sensors make it fast, noisy ones slow. Two limits stand on its sides: never
    slower than a rise in 14.6 ms (24 Hz), never so fast that less than 12 dB come off white noise
    between 50 and 200 Hz (26 Hz). ``bandwidth_hz`` overrides all three.

    Parameters
    ----------
    levels : NoiseLevels
    mass : float
        [kg]
    settings : Settings

    Returns
    -------
    float
        [Hz]
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


def _rotation_corner(
        calibration: Calibration, load: Load, levels: NoiseLevels, rate: float,
        settings: Settings) -> float:
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
    return float(min(max((3 * alpha / density) ** 0.2, 30.0), 150.0, 0.6 * settings.pose_rate))


def _motion_corner(levels: NoiseLevels, mass: float, rate: float, settings: Settings) -> float:
    """Find the same for the acceleration that stands in where there is no accelerometer."""
    variance = levels.force * rate / 2 / mass ** 2
    density = settings.pose_position_std ** 2 / settings.pose_rate
    return float(min(max((3 * variance / density) ** 0.2, 20.0), 100.0, 0.6 * settings.pose_rate))


def _load(calibration: Calibration) -> Load:
    com = calibration.com.value
    accelerometer = calibration.accelerometer
    place = com
    if accelerometer is not None and accelerometer.position is not None:
        place = accelerometer.position.value
    J = np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value
    numbers = (float(calibration.mass), *com, *(com - place),
               J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    if not np.isfinite(numbers).all() or numbers[0] <= 0:
        raise ConfigError(f'the calibration holds no usable mass, com or inertia: {numbers}; '
                          'calibrate again')
    return Load(*(float(x) for x in numbers))


def _bias(calibration: Calibration) -> tuple[float, ...]:
    bias = tuple(float(x) for x in calibration.wrench_bias.value)
    if not np.isfinite(bias).all():
        raise ConfigError(f'wrench_bias is {bias}; calibrate in three or more orientations')
    return bias


def _delay(accelerometer: Accelerometer | None) -> float:
    """Return the delay; nil where it was not identified."""
    if accelerometer is None or not np.isfinite(accelerometer.delay.value):
        return 0.0
    return float(accelerometer.delay)


def _volts(calibration: Calibration) -> tuple[float, ...]:
    accelerometer = calibration.accelerometer
    if accelerometer is None:
        return (0.0,) * 12
    matrix = accelerometer.matrix
    condition = float(np.linalg.cond(matrix)) if np.isfinite(matrix).all() else inf
    if condition > 1e6:
        raise ConfigError(f'the accelerometer map cannot be inverted (condition {condition:.0e}); '
                          'calibrate it in three or more orientations')
    offset = accelerometer.offset.value
    if not np.isfinite(offset).all():
        raise ConfigError(f'the accelerometer offset is {offset}; calibrate it at rest')
    return tuple(float(x) for x in (*offset, *np.linalg.inv(matrix).ravel()))


def _ac_rate(accelerometer: Accelerometer | None) -> float:
    if accelerometer is None or accelerometer.coupling != 'ac':
        return 0.0
    if accelerometer.cutoff is None:
        raise ConfigError('accelerometer.coupling is ac but its cutoff is missing; '
                          'state the corner of its high-pass [Hz]')
    return tau * float(accelerometer.cutoff)


def _gain(calibration: Calibration) -> Gain:
    if calibration.observer is None:
        return (0.0,) * 6
    (a, b, c), (d, e, f) = calibration.observer.K.value.tolist()
    return a, b, c, d, e, f


def design(calibration: Calibration, settings: Settings = Settings()) -> Model:
    """
    Turn a calibration into the model of the running observer.

    Parameters
    ----------
    calibration : Calibration
    settings : Settings

    Returns
    -------
    Model

    Raises
    ------
    ConfigError
        The calibration does not hold what the mode needs.
    UnobservableError
        The offset was asked for (``offset: on``) where nothing makes it detectable.
    """
    load, levels = _load(calibration), noise_levels(calibration.noise)
    observer, accelerometer = calibration.observer, calibration.accelerometer
    mode = settings.mode or (observer.mode if observer is not None else 'kalman')
    if mode == 'newton' and observer is None:
        raise ConfigError('mode newton wants observer.K in the calibration; '
                          'calibrate with a step, or use mode kalman')
    track = settings.offset == 'on' or (settings.offset == 'auto' and settings.position)
    if track:
        design_joint(levels, load.m, settings, 1 / levels.rate, settings.position)
    rate = tau * contact_bandwidth(levels, load.m, settings)
    tool = calibration.tool
    stiffness = float(tool.stiffness) if tool is not None else 0.0
    damping = float(tool.damping) if tool is not None else 0.0
    rotation = _rotation_corner(calibration, load, levels, rate, settings)
    return Model(
        newton=mode == 'newton', load=load,
        bias=_bias(calibration),
        gravity=calibration.gravity, accelerometer=accelerometer is not None,
        ac_rate=_ac_rate(accelerometer),
        volts=_volts(calibration),
        delay=_delay(accelerometer),
        place=(load.cx - load.dx, load.cy - load.dy, load.cz - load.dz),
        stiffness=stiffness, relaxation=stiffness / damping if damping > 0 else inf,
        rate=rate, track_offset=track, rotation_poles=butterworth(rotation),
        offset_poles=offset_poles(levels, settings, settings.pose_position_std),
        motion_poles=butterworth(_motion_corner(levels, load.m, rate, settings)),
        reach_poles=offset_poles(levels, settings, _REACH), K=_gain(calibration),
        timeout=settings.accelerometer_timeout, pose_timeout=settings.pose_timeout,
        skew=settings.skew, limited=settings.wrench_limit is not None,
        wrench_limit=settings.wrench_limit or (inf,) * 6,
        accelerometer_limit=(settings.accelerometer_limit or inf,) * 3)


def kalman_gains(model: Model, dt: float) -> dict[str, Estimate]:
    """
    Return the gains of mode ``kalman`` as a calibration keeps them.

    Parameters
    ----------
    model : Model
    dt : float
        Period of the wrench [s].

    Returns
    -------
    dict of str to Estimate
        ``bandwidth`` [Hz], ``contact`` (gain of one update), and the poles of the pose filters as
        (real, mean of the pair, split of the pair) [1/s, 1/s, 1/s^2].
    """
    return {
        'bandwidth': Estimate(model.rate / tau, 0.0, 'Hz'),
        'contact': Estimate(1 - exp(-model.rate * dt), 0.0, '1'),
        'rotation': Estimate(model.rotation_poles, 0.0, '1/s, 1/s, 1/s^2'),
        'offset': Estimate(model.offset_poles, 0.0, '1/s, 1/s, 1/s^2'),
    }
