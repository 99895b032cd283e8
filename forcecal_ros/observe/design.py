"""From a calibration to the numbers the running step needs; everything slow happens here."""

from collections.abc import Iterable
from dataclasses import replace
from math import exp, inf, log, tau
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Accelerometer, Calibration, Estimate, Noise
from forcecal_ros.core.errors import ConfigError, UnobservableError
from forcecal_ros.core.geometry import Array, Vector, ZERO
from forcecal_ros.core.sensor_matrix import sensor_matrix, SensorMatrix
from forcecal_ros.observe.bandwidth import (
    acceleration_variance,
    as_calibrated,
    butterworth,
    contact_bandwidth,
    fast_share,
    load_maps,
    motion_corner,
    noise_levels,
    noise_of_reading,
    offset_poles,
    place_of,
    Poles,
    pose_noise,
    rotation_corner,
    UNMEASURED_HZ,
    within_limits,
)
from forcecal_ros.observe.bias_filter import bias_model, BiasModel
from forcecal_ros.observe.settings import LEARNING, ObserverSettings
import numpy as np

KALMAN, NEWTON, UNFILTERED = range(3)
"""``Model.filter``; see :func:`forcecal_ros.observe.contact.filtered`."""

SMOOTHING_TIME_S = 0.004
"""A third of the rise of a contact by the nominal rig's noise, and more than half a period of
vibrations above 100 Hz [s]."""

Gain = tuple[float, float, float, float, float, float]


class Load(NamedTuple):
    """
    What hangs on the sensor, as plain numbers.

    Attributes
    ----------
    m : float
        [kg]
    cx, cy, cz : float
        Centre of mass at zero displacement, in ft_sensor [m].
    dx, dy, dz : float
        From the accelerometer to the centre of mass [m].
    ixx, iyy, izz, ixy, ixz, iyz : float
        Inertia about the centre of mass [kg m^2].
    """

    m: float
    cx: float
    cy: float
    cz: float
    dx: float
    dy: float
    dz: float
    ixx: float
    iyy: float
    izz: float
    ixy: float
    ixz: float
    iyz: float


class Model(NamedTuple):
    """Everything the step needs in addition to its state; plain numbers, SI, ft_sensor."""

    filter: int
    """One of KALMAN, NEWTON or UNFILTERED."""
    bias_filter: BiasModel | None
    """Of the filter that follows an UNFILTERED wrench: ``ukf`` or ``ekf``; None: none does."""
    weight_only: bool
    """Whether the load is the weight by the pose alone, without inertia (``static``)."""
    load: Load
    sensor_matrix: SensorMatrix | None
    """Turns raw channels into a wrench before anything else; None where they are one."""
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
    adaptive: bool
    """Whether ``rate`` falls where the wrench is noisier than calibrated."""
    innovation_scale: Vector
    """See :func:`scale_of`."""
    slowest: float
    """Slowest corner then [rad/s]."""
    track_offset: bool
    rotation_poles: Poles
    offset_poles: Poles
    motion_poles: Poles
    reach_poles: Poles
    K: Gain
    pause: float
    """After a longer pause of the wrench the filter starts anew [s]."""
    timeout: float
    """Longest gap of the accelerometer that is bridged [s]."""
    displacement_timeout: float
    pose_timeout: float
    skew: float
    keep: float
    """Samples are kept that much longer than the wrench needs them, for poses that come late; an
    older pose is followed in its rotation only [s]."""
    reach: float
    """Poses further behind a wrench than this do not count for it [s]."""
    memory: float
    """Samples older than this are not kept, whether a wrench comes or not [s]."""
    limited: bool
    """Whether ``wrench_limit`` is known."""
    wrench_limit: tuple[float, ...]
    accelerometer_limit: tuple[float, ...]


def _load(calibration: Calibration) -> Load:
    com = calibration.com.value
    J = np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value
    numbers = (*com, *(com - place_of(calibration)),
               J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    mass = float(calibration.mass)
    if not mass > 0.0:
        raise ConfigError(f'the calibration holds no usable mass: {mass}; calibrate again')
    return Load(*_finite('com or inertia', (mass, *numbers), 'calibrate again'))


def _finite(what: str, numbers: Iterable[float], remedy: str) -> tuple[float, ...]:
    found = tuple(map(float, numbers))
    if not np.isfinite(found).all():
        raise ConfigError(f'the calibration holds no usable {what}: {found}; {remedy}')
    return found


def _volts(calibration: Calibration) -> tuple[float, ...]:
    accelerometer = calibration.accelerometer
    if accelerometer is None:
        return (0.0,) * 12
    matrix = accelerometer.matrix
    condition = float(np.linalg.cond(matrix)) if np.isfinite(matrix).all() else inf
    if condition > 1e6:
        raise ConfigError(f'the accelerometer map cannot be inverted (condition {condition:.0e}); '
                          'calibrate it in three or more orientations')
    offset = _finite('accelerometer offset', accelerometer.offset.value, 'calibrate it at rest')
    return (*offset, *np.linalg.inv(matrix).ravel().tolist())


def _ac_rate(accelerometer: Accelerometer | None) -> float:
    if accelerometer is None or accelerometer.coupling != 'ac':
        return 0.0
    if accelerometer.cutoff is None:
        raise ConfigError('accelerometer.coupling is ac but accelerometer.cutoff is missing; '
                          'set it to the corner of the high-pass [Hz]')
    return tau * float(accelerometer.cutoff)


def _filter(calibration: Calibration, settings: ObserverSettings) -> str:
    """Return the name of the filter that runs."""
    observer = calibration.observer
    name = settings.filter or (observer.mode if observer is not None else 'kalman')
    if name == 'newton' and observer is None:
        raise ConfigError('filter newton needs observer.K in the calibration; '
                          'use filter kalman')
    return name


def _innovation_scale(calibration: Calibration, noise: Noise, rate: float) -> Vector:
    dt = 1 / noise.wrench_rate
    reading, density = noise_of_reading(calibration, noise)
    k = 1 - exp(-rate * dt)
    # of a reading, and of an estimate that balances noise and walk
    variance = np.diag(reading) + np.diag(density) / dt * k
    return scale_of(tuple(np.maximum(variance[:3], 1e-12).tolist()), dt)


def scale_of(variance: tuple[float, ...], dt: float) -> Vector:
    """Return what makes z of squares, for white innovations of these variances (3,) [N^2]."""
    k = 1 - exp(-dt / SMOOTHING_TIME_S)
    x, y, z = (1 / (3 * one * (1 + k / (2 - k))) for one in variance)
    return x, y, z


def design(calibration: Calibration, settings: ObserverSettings = ObserverSettings(),
           accelerometer_comes: bool = True) -> Model:
    """
    Turn a calibration into the model of the running chain.

    Parameters
    ----------
    accelerometer_comes : bool
        Whether readings of the calibrated accelerometer are expected.

    Raises
    ------
    ConfigError
        The calibration does not hold what the filter needs, or the slowest bandwidth is above the
        fastest.
    UnobservableError
        The offset was requested (``offset: on``) where nothing makes it detectable.
    """
    load, levels = _load(calibration), noise_levels(calibration.noise)
    settings = as_calibrated(settings, calibration)
    name, accelerometer = _filter(calibration, settings), calibration.accelerometer
    track = settings.offset == 'on' or (settings.offset == 'auto' and settings.position)
    if track and not settings.position:
        raise UnobservableError('without positions in the poses, accelerometer offset and contact '
                                'force cannot be separated; set observer.offset to off')
    noise, observer = calibration.noise, calibration.observer
    bandwidth = settings.bandwidth_hz or within_limits(UNMEASURED_HZ, settings)
    if noise is not None:
        bandwidth = contact_bandwidth(noise_levels(noise, slow=True), load.m, settings)
    rate = tau * bandwidth
    scale = ZERO
    adaptive = settings.adaptive and settings.bandwidth_hz is None and noise is not None
    if adaptive and noise is not None:
        scale = _innovation_scale(calibration, noise, rate)
    gain: Gain = (0.0,) * 6
    if observer is not None:
        (a, b, c), (d, e, f) = observer.K.value.tolist()
        gain = (a, b, c, d, e, f)
    tool = calibration.tool
    stiffness = float(tool.stiffness) if tool is not None else 0.0
    damping = float(tool.damping) if tool is not None else 0.0
    corner = rotation_corner(calibration, levels, rate, settings)
    motion = motion_corner(levels, load.m, rate, settings)
    by_pose = pose_noise(calibration, corner, motion,
                         accelerometer is not None and accelerometer_comes, settings)
    timeout = settings.accelerometer_timeout
    # max pause: ``Model.pause`` of live wrenches: sensors send at 100 Hz and more, so that ten or
    # more are lost [s]
    # keep: ``Model.keep`` of live streams: more than one period of a wrench at 200 Hz
    # and faster [s]
    # reach: where no pose shows the position it is taken to stay; an arm that works in place
    # keeps within about this of it, which is the noise of such a position [m]
    return with_reach(Model(
        filter={'kalman': KALMAN, 'newton': NEWTON}.get(name, UNFILTERED),
        bias_filter=(bias_model(calibration, settings.learning, by_pose, corner)
                     if name in LEARNING else None),
        weight_only=name == 'static', load=load, sensor_matrix=sensor_matrix(calibration),
        bias=_finite('wrench_bias', calibration.wrench_bias.value,
                     'calibrate in three or more orientations'),
        gravity=calibration.gravity, accelerometer=accelerometer is not None,
        ac_rate=_ac_rate(accelerometer),
        volts=_volts(calibration),
        # zero where it was not identified
        delay=0.0 if accelerometer is None else float(
            np.nan_to_num(accelerometer.delay.value, posinf=0.0, neginf=0.0)),
        place=(load.cx - load.dx, load.cy - load.dy, load.cz - load.dz),
        stiffness=stiffness, relaxation=stiffness / damping if damping > 0 else inf,
        rate=rate, adaptive=adaptive, innovation_scale=scale,
        slowest=tau * within_limits(0.0, settings), track_offset=track,
        rotation_poles=butterworth(corner),
        offset_poles=offset_poles(levels, settings.pose_position_std),
        motion_poles=butterworth(motion),
        reach_poles=offset_poles(levels, 0.3), K=gain,
        pause=0.1, timeout=timeout, displacement_timeout=timeout,
        pose_timeout=settings.pose_timeout, skew=settings.skew, keep=0.005, reach=0.0, memory=0.0,
        limited=settings.wrench_limit is not None,
        wrench_limit=settings.wrench_limit or (inf,) * 6,
        accelerometer_limit=(settings.accelerometer_limit or inf,) * 3))


def with_tool(model: Model, mass: float, com: Vector, inertia: Array | None = None) -> Model:
    """
    Return the model with another tool on the sensor.

    Parameters
    ----------
    mass : float
        Of all that hangs on the sensor [kg].
    com : tuple of 3 float
        In ft_sensor [m].
    inertia : ndarray, shape (3, 3), or None
        About the centre of mass [kg m^2]; None: as it was.
    """
    load, J = model.load, inertia
    turning = load[7:] if J is None else (
        J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
    numbers = (mass, *com, *(c - place for c, place in zip(com, model.place)), *turning)
    return model._replace(load=Load(*(float(x) for x in numbers)))


def with_bias(model: Model, bias: Array | tuple[float, ...]) -> Model:
    """Return the model with another wrench bias (6,) [N, N m]."""
    values = np.array(bias, dtype=float)
    learning = model.bias_filter
    return model._replace(
        bias=tuple(values.tolist()),
        bias_filter=None if learning is None else learning._replace(bias=values))


def with_reach(model: Model) -> Model:
    """Return the model with what follows from its time-outs."""
    longest = max(
        model.pause, model.timeout, model.displacement_timeout, model.pose_timeout)
    reach = 2 * (longest + model.skew)
    return model._replace(reach=reach, memory=2 * reach + abs(model.delay))


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
    acceleration, which the poses show slowly, the filter removes the fast share.

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
    walk[:3] = (as_calibrated(settings, calibration).contact_walk or 0.0) ** 2 / noise.wrench_rate
    error = R * k / (2 - k) + np.diag(walk) * (1 - k) ** 2 / (k * (2 - k))
    _, by_alpha = load_maps(calibration)
    corner = model.rotation_poles.real
    turning = acceleration_variance(settings.pose_rotation_std, corner) * by_alpha @ by_alpha.T
    fast = fast_share(model.rate / corner)
    bandwidth = model.rate / tau
    return Accuracy(bandwidth, rise_time(bandwidth), error + (1 - fast) * turning,
                    error + np.diag(walk) + sample + fast * turning,
                    np.sqrt(walk * noise.wrench_rate))


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
    # what an observer without other settings designs the same gains by
    kalman = kalman_gains(model, observer.dt) | {
        name: Estimate(value, 0.0, unit) for name, value, unit in (
            ('contact_walk', settings.contact_walk, 'N/sqrt(s)'),
            ('bandwidth_min', settings.bandwidth_min_hz, 'Hz'),
            ('bandwidth_max', settings.bandwidth_max_hz, 'Hz')) if value is not None}
    if promised := accuracy(by_kalman, model, settings):
        kalman |= {'rise_time': Estimate(promised.rise_time, 0.0, 's'),
                   'std': Estimate(promised.std, 0.0, 'N, N m')}
    return replace(calibration, observer=replace(calibration.observer, kalman=kalman))
