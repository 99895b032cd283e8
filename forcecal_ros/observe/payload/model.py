"""What a reading of a tool of unknown mass is made of, and what is known of it beforehand.

[Ukf2025] with mass and centre of mass among the states. A reading is

    y = F + b - [m f + A h + e a; r x (m f + A h) + J alpha + omega x J omega],   h = m c

with r = c + s x_hat, A = [alpha]x + [omega]x^2, f the specific force at the tool's origin and a
its acceleration. h, the first moment, keeps what gravity shows linear; what turning adds is not,
h x A h / m, and is left to the sigma points. The inertia J about the centre of mass is kept as
calibrated: a payload moves the centre of mass, its own inertia is not estimated.

F is what no tool explains while nothing touches: errors of weight and inertia, which go with the
motion and do not average out as noise does. b is the sensor's bias, or a steady push that turns
with the sensor. e is the mass that accelerations show beyond the mass that gravity shows: zero
for a payload, minus its apparent mass for a push that only looks like weight.
"""

from dataclasses import dataclass
from math import exp, hypot
from typing import Annotated, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.schema import Row, Section
from forcecal_ros.observe.filters.bias_model import ContactModel
from forcecal_ros.observe.filters.covariances import noise_of_reading
from forcecal_ros.observe.filters.gaussian import Function, Gaussian, linear
import numpy as np
from scipy.special import chdtri

WRENCH, BIAS = slice(0, 6), slice(6, 12)
MASS, MOMENT, EXCESS = 12, slice(13, 16), 16
TOOL = slice(12, 17)
STATES = 17

_PAIR = tuple[float, float]

MOTION_TIME = 0.5
"""Time in which errors of weight and inertia become others: that of an arm's own motion [s]."""

REACH = 0.3
"""A payload is expected within so much of the sensor: a gripper's length and a half [m]."""

FALSE_ALARM = 1e-3
"""Probability that a free reading is called contact; it costs a pause of the tracking, where a
push that is missed costs a wrong mass [1]."""

WINDOW = 0.3
"""Time over which a weak contact is averaged: a third of that in which a payload is to be heard of
[s]."""

RELEASE = 1.0
"""Quiet after which contact counts as ended: longer than a light payload is hidden by a vibration,
and than a grasp takes to let go [s]."""

MASS_WALK = 2e-3
"""Wander of the mass, relative: a change too small to be noticed at once, as of glue or paint, is
followed within some seconds, and the standard error never falls below what could go unnoticed
[1/sqrt(s)]."""

INERT_PRIOR = 0.3
"""Relative difference between mass by accelerations and mass by gravity that sensors bring along,
which is learned in free motion: delays and gains, a fifth on a real arm [1]."""

BIAS_WALK = (4e-3, 4e-4)
"""Wander of the biases: 0.1 N and 0.01 N m in ten minutes, as force sensors warm up
[N/sqrt(s), N m/sqrt(s)]."""


@dataclass(frozen=True)
class PayloadSettings(Section, name='payload'):
    """Choices of the payload's estimation."""

    floor: Annotated[_PAIR, Row(
        'Errors of weight and inertia that are no contact; the default is what an arm that moves '
        'freely leaves in means over 0.2 s', 'N, N m', 0.0)] = (0.05, 0.004)
    share: Annotated[float, Row(
        'The same as a share of the weight: errors of gains and angles', above=0.0)] = 0.003
    largest: Annotated[float | None, Row(
        "Largest payload that is expected; None: the tool's own mass", 'kg', above=0.0)] = None
    bias_prior: Annotated[_PAIR, Row(
        'How far the biases may have moved since the calibration', 'N, N m', 0.0)] = (0.3, 0.03)
    accuracy: Annotated[float, Row(
        'Relative standard error of the mass at which a change is taken over',
        above=0.0, below=0.5)] = 0.01


class PayloadModel(NamedTuple):
    """
    All that the step needs, SI, ft_sensor.

    Attributes
    ----------
    start : Gaussian
        Before the first reading, of 17 states.
    density : ndarray, shape (6, 6)
        Of a reading's noise [N^2 s].
    floor : ndarray, shape (6, 6)
        Covariance of F.
    bias_prior : ndarray, shape (6, 6)
        Covariance of what the biases may have become since the calibration.
    walk : ndarray, shape (17, 17)
        Gained in one second.
    opening : ndarray, shape (17, 17)
        What a change of the load may add.
    contact : ContactModel
    inertia : ndarray, shape (3, 3)
        About the centre of mass [kg m^2].
    gravity : float
    accuracy : float
        See :class:`PayloadSettings`.
    """

    start: Gaussian
    density: Array
    floor: Array
    bias_prior: Array
    walk: Array
    opening: Array
    contact: ContactModel
    inertia: Array
    gravity: float
    accuracy: float


def payload_model(calibration: Calibration, settings: PayloadSettings = PayloadSettings()
                  ) -> PayloadModel:
    """
    Turn a calibration into what the step needs.

    Raises
    ------
    ConfigError
        The calibration holds no mass above zero.
    """
    m, c = float(calibration.mass), calibration.com.value
    if not m > 0:
        raise ConfigError(f'mass is {m} kg: a payload is tracked from a calibrated tool on; '
                          'calibrate again')
    weight = m * calibration.gravity
    arm = float(np.linalg.norm(c))
    floor = _pair(hypot(settings.floor[0], settings.share * weight),
                  hypot(settings.floor[1], settings.share * weight * arm))
    largest = m if settings.largest is None else settings.largest
    return PayloadModel(
        _start(calibration, floor, settings), _density(calibration), floor,
        _pair(*settings.bias_prior), _walk(m),
        _opening(largest, calibration.gravity),
        ContactModel(floor, float(chdtri(6, FALSE_ALARM)), WINDOW, RELEASE),
        np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value,
        calibration.gravity, settings.accuracy)


def _pair(force: float, torque: float) -> Array:
    return np.diag([force ** 2] * 3 + [torque ** 2] * 3)


def _density(calibration: Calibration) -> Array:
    if calibration.noise is None:
        return np.zeros((6, 6))
    return noise_of_reading(calibration, calibration.noise)[1]


def _start(calibration: Calibration, floor: Array, settings: PayloadSettings) -> Gaussian:
    m, c = float(calibration.mass), calibration.com.value
    mean, cov = np.zeros(STATES), np.zeros((STATES, STATES))
    mean[BIAS], mean[MASS], mean[MOMENT] = calibration.wrench_bias.value, m, m * c
    mass_std = max(float(np.nan_to_num(calibration.mass.std)), 1e-3 * m)
    com_std = np.maximum(np.nan_to_num(calibration.com.std), 1e-4)
    bias_std = np.nan_to_num(calibration.wrench_bias.std)
    cov[WRENCH, WRENCH] = floor
    cov[BIAS, BIAS] = np.diag(bias_std ** 2) + _pair(*settings.bias_prior)
    to_moment = np.array([1.0, *c])
    cov[12:16, 12:16] = mass_std ** 2 * np.outer(to_moment, to_moment)
    cov[MOMENT, MOMENT] += np.diag((m * com_std) ** 2)
    cov[EXCESS, EXCESS] = (INERT_PRIOR * m) ** 2
    return Gaussian(mean, cov)


def _walk(m: float) -> Array:
    walk = np.zeros(STATES)
    walk[BIAS] = np.repeat(BIAS_WALK, 3)
    walk[MASS], walk[MOMENT] = MASS_WALK * m, MASS_WALK * m * REACH / 3
    return np.diag(walk ** 2)


def _opening(largest: float, gravity: float) -> Array:
    std = np.zeros(STATES)
    std[BIAS] = np.repeat([largest * gravity, largest * gravity * REACH], 3)
    std[MASS], std[MOMENT], std[EXCESS] = largest, largest * REACH, largest
    return np.diag(std ** 2)


class Block(NamedTuple):
    """
    Means over some 50 ms: a reading, and how the tool moved.

    Attributes
    ----------
    t : float
        End [s].
    duration : float
        [s]
    reading : ndarray, shape (6,)
        Wrench as on the wire, bias included [N, N m].
    scatter : ndarray, shape (6,)
        Variance of this mean, as the samples scatter: noise and vibrations.
    f, down : ndarray, shape (3,)
        Specific force at the tool's origin, and gravity, in ft_sensor [m/s^2].
    omega, alpha : ndarray, shape (3,)
        [rad/s], [rad/s^2]
    s : float
        Displacement of the tool along x [m].
    """

    t: float
    duration: float
    reading: Array
    scatter: Array
    f: Array
    down: Array
    omega: Array
    alpha: Array
    s: float


def transition(model: PayloadModel, dt: float) -> tuple[Function, Array]:
    """Return how the states move in ``dt`` [s]: F is forgotten, the others wander."""
    k = exp(-dt / MOTION_TIME)
    A, Q = np.eye(STATES), model.walk * dt
    A[WRENCH, WRENCH] *= k
    Q[WRENCH, WRENCH] = (1 - k * k) * model.floor
    return linear(A), Q


def _cross(a: Array, b: Array) -> Array:
    """Do as ``numpy.cross``, which takes ten times as long over a few numbers."""
    i, j = (1, 2, 0), (2, 0, 1)
    return np.asarray(a[..., i] * b[..., j] - a[..., j] * b[..., i])


def measurement(block: Block, model: PayloadModel) -> Function:
    """Return what a block's reading is made of, as a function of the 17 states."""
    w = skew(block.omega)
    A = skew(block.alpha) + w @ w
    spin = model.inertia @ block.alpha + _cross(block.omega, model.inertia @ block.omega)
    slide = np.array([block.s, 0.0, 0.0])
    linear_part = np.zeros((6, STATES))
    linear_part[:, WRENCH] = linear_part[:, BIAS] = np.eye(6)
    linear_part[:3, MASS], linear_part[:3, MOMENT] = -block.f, -A
    linear_part[:3, EXCESS] = -(block.f + block.down)
    linear_part[3:, MASS] = -_cross(slide, block.f)
    linear_part[3:, MOMENT] = skew(block.f) - skew(slide) @ A
    least = 0.1 * model.start.mean[MASS]

    def turning(x: Array) -> Array:
        """Torque of -c x A h about the origin; ``least`` where a hypothesis has no mass."""
        h, m = x[..., MOMENT], np.maximum(x[..., MASS], least)
        return np.asarray(-_cross(h, h @ A.T) / m[..., np.newaxis])

    def value(x: Array) -> Array:
        y = linear_part @ x
        y[3:] += turning(x) - spin
        return np.asarray(y)

    def difference(x: Array, dx: Array) -> Array:
        y = dx @ linear_part.T
        y[:, 3:] += turning(x + dx) - turning(x)
        return np.asarray(y)

    def jacobian(x: Array) -> Array:
        h, m, J = x[MOMENT], max(float(x[MASS]), least), linear_part.copy()
        J[3:, MOMENT] -= (skew(h) @ A - skew(A @ h)) / m
        J[3:, MASS] += _cross(h, A @ h) / m ** 2 if x[MASS] > least else 0.0
        return J

    return Function(value, difference, jacobian)
