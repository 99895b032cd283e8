"""From a calibration to the numbers the running step needs; everything slow happens here."""

from math import exp, inf, sqrt, tau
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Accelerometer, Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.sensor_matrix import sensor_matrix, SensorMatrix
from forcecal_ros.observe.bandwidth import (
    as_calibrated,
    contact_bandwidth,
    design_joint,
    motion_corner,
    noise_levels,
    offset_poles,
    rotation_corner,
    slow_levels,
    UNMEASURED,
    within_limits,
)
from forcecal_ros.observe.filters.bias_model import bias_model, BiasModel
from forcecal_ros.observe.filters.covariances import noise_of_reading
from forcecal_ros.observe.filters.memory import KALMAN, NEWTON, UNFILTERED
from forcecal_ros.observe.filters.noise_level import scale_of
from forcecal_ros.observe.inertial import Load
from forcecal_ros.observe.settings import LEARNING, ObserverSettings
from forcecal_ros.observe.tracking import butterworth, Poles, Vector, ZERO
import numpy as np

Gain = tuple[float, float, float, float, float, float]

PAUSE = 0.1
"""``Model.pause`` of live wrenches: sensors send at 100 Hz and more, so that ten or more are lost
[s]."""

KEEP = 0.005
"""``Model.keep`` of live streams: more than one period of a wrench at 200 Hz and faster [s]."""

_REACH = 0.3
"""Where no pose tells the position it is taken to stay; an arm that works in place keeps within
about this of it, which is the noise of such a position [m]."""


class Model(NamedTuple):
    """Everything the step needs besides its state; plain numbers, SI, ft_sensor."""

    filter: int
    """One of ``filters.memory``: KALMAN, NEWTON or UNFILTERED."""
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
    weighs: bool
    """Whether some axis of the accelerometer counts for less than all of it."""
    share: Vector
    level: Vector
    """See ``weighing.weigh``."""
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
    """See ``filters.noise_level.scale_of``."""
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
    """Return the delay; zero where it was not identified."""
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


def _weight(accelerometer: Accelerometer | None) -> dict[str, Any]:
    """Return how the axes of the accelerometer are weighed."""
    if accelerometer is None or accelerometer.share is None or accelerometer.level is None:
        return {'weighs': False, 'share': (1.0, 1.0, 1.0), 'level': ZERO}
    share, level = accelerometer.share.value.tolist(), accelerometer.level.value.tolist()
    return {'weighs': min(share) < 1.0, 'share': tuple(share), 'level': tuple(level)}


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


def _filter(calibration: Calibration, settings: ObserverSettings) -> str:
    """Return the name of the filter that runs."""
    observer = calibration.observer
    name = settings.filter or (observer.mode if observer is not None else 'kalman')
    if name == 'newton' and observer is None:
        raise ConfigError('filter newton needs observer.K in the calibration; '
                          'use filter kalman')
    return name


def _bias_filter(calibration: Calibration, name: str, rotation_corner: float,
                 settings: ObserverSettings) -> BiasModel | None:
    if name not in LEARNING:
        return None
    # what white noise leaves in the third state of a Butterworth filter
    density = settings.pose_rotation_std ** 2 / settings.pose_rate
    return bias_model(calibration, name == 'ukf', settings.learning,
                      sqrt(density * rotation_corner ** 5 / 3))


def _bandwidth(calibration: Calibration, mass: float, settings: ObserverSettings) -> float:
    if calibration.noise is None:
        return settings.bandwidth_hz or within_limits(UNMEASURED, settings)
    return contact_bandwidth(slow_levels(calibration.noise), mass, settings)


def _is_adaptive(calibration: Calibration, settings: ObserverSettings) -> bool:
    """Whether the bandwidth follows the noise: not where it is said, or no noise was measured."""
    return bool(settings.adaptive and settings.bandwidth_hz is None and calibration.noise)


def _innovation_scale(calibration: Calibration, rate: float, settings: ObserverSettings) -> Vector:
    if not _is_adaptive(calibration, settings) or calibration.noise is None:
        return ZERO
    dt = 1 / calibration.noise.wrench_rate
    reading, density = noise_of_reading(calibration, calibration.noise)
    k = 1 - exp(-rate * dt)
    # of a reading, and of an estimate that balances noise and walk
    variance = np.diag(reading) + np.diag(density) / dt * k
    return scale_of(tuple(np.maximum(variance[:3], 1e-12).tolist()), dt)


def design(calibration: Calibration, settings: ObserverSettings = ObserverSettings()) -> Model:
    """
    Turn a calibration into the model of the running chain.

    Raises
    ------
    ConfigError
        The calibration does not hold what the filter needs, or the slowest bandwidth is above the
        fastest.
    UnobservableError
        The offset was asked for (``offset: on``) where nothing makes it detectable.
    """
    load, levels = _load(calibration), noise_levels(calibration.noise)
    settings = as_calibrated(settings, calibration)
    name, accelerometer = _filter(calibration, settings), calibration.accelerometer
    track = settings.offset == 'on' or (settings.offset == 'auto' and settings.position)
    if track:
        design_joint(levels, load.m, settings, 1 / levels.rate, settings.position)
    rate = tau * _bandwidth(calibration, load.m, settings)
    tool = calibration.tool
    stiffness = float(tool.stiffness) if tool is not None else 0.0
    damping = float(tool.damping) if tool is not None else 0.0
    corner = rotation_corner(calibration, load, levels, rate, settings)
    timeout, delay = settings.accelerometer_timeout, _delay(accelerometer)
    return with_reach(Model(
        filter={'kalman': KALMAN, 'newton': NEWTON}.get(name, UNFILTERED),
        bias_filter=_bias_filter(calibration, name, corner, settings),
        weight_only=name == 'static', load=load, sensor_matrix=sensor_matrix(calibration),
        bias=_bias(calibration),
        gravity=calibration.gravity, accelerometer=accelerometer is not None,
        ac_rate=_ac_rate(accelerometer),
        volts=_volts(calibration),
        delay=delay,
        **_weight(accelerometer),
        place=(load.cx - load.dx, load.cy - load.dy, load.cz - load.dz),
        stiffness=stiffness, relaxation=stiffness / damping if damping > 0 else inf,
        rate=rate, adaptive=_is_adaptive(calibration, settings),
        innovation_scale=_innovation_scale(calibration, rate, settings),
        slowest=tau * within_limits(0.0, settings), track_offset=track,
        rotation_poles=butterworth(corner),
        offset_poles=offset_poles(levels, settings, settings.pose_position_std),
        motion_poles=butterworth(motion_corner(levels, load.m, rate, settings)),
        reach_poles=offset_poles(levels, settings, _REACH), K=_gain(calibration),
        pause=PAUSE, timeout=timeout, displacement_timeout=timeout,
        pose_timeout=settings.pose_timeout, skew=settings.skew, keep=KEEP, reach=0.0, memory=0.0,
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


def with_reach(model: Model) -> Model:
    """Return the model with what follows from its time-outs."""
    longest = max(
        model.pause, model.timeout, model.displacement_timeout, model.pose_timeout)
    reach = 2 * (longest + model.skew)
    return model._replace(reach=reach, memory=2 * reach + abs(model.delay))
