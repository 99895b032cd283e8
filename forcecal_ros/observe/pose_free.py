"""
The model without a pose: gravity's direction is estimated along with biases and mass.

Beside the frame ``level``, whose third axis is down, the states are wrench F (6), biases b (6),
mass m, tilt of ``level`` about its first two axes (2) and acceleration a of the centre of mass
(3), all in ft_sensor. A gyro turns the frame, the accelerometer sees a - g, the force sensor
m (g - a). Here the model of [Ukf2025] is no longer linear: mass, gravity and acceleration multiply
and g moves on a sphere. (As a vector of known length g fools the unscented filter: it takes the
same length, read a thousand times a second, for a thousand independent readings, and its estimate
of the direction ends up 5 deg off, twenty times what it claims.)
"""

from math import exp, nan, sqrt
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array, rotation_from_vector, skew
from forcecal_ros.observe.bias_filter import (
    BIAS,
    BiasModel,
    Contact,
    expected_share,
    learned_of,
    MASS,
    MAX_PERIOD_S,
    take_reading,
    WRENCH,
    wrench_tuple,
)
from forcecal_ros.observe.design import design
from forcecal_ros.observe.gaussian import (
    expect,
    first,
    Function,
    Gaussian,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.sample import (
    BAD_WRENCH,
    ByImu,
    ContactSample,
    MAX_READING,
    NO_ACCELEROMETER,
    NO_GRAVITY,
    NO_GYRO,
    NO_WRENCH,
    RESTARTED,
)
from forcecal_ros.observe.settings import LEARNING, ObserverSettings
import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

TILT, ACCELERATION = slice(13, 15), slice(15, 18)
"""Where they are among the states, behind wrench, bias and mass."""

STATES = ACCELERATION.stop

LEARNED = slice(6, 13)
"""Biases and mass: what only readings without contact may teach."""

_SWAP = np.array([-1.0, 1.0])


class Imu(NamedTuple):
    """
    How the arm moves and how well the IMU sees it.

    Attributes
    ----------
    gyro_std : float
        Noise of the gyro, per sample [rad/s].
    gyro_offset : float
        Its offset, which counts as constant for ten seconds [rad/s].
    unknown_rate : float
        How fast the arm may turn, for a second, when the gyro is silent [rad/s].
    acceleration_std, acceleration_time : float
        Size and duration of the arm's accelerations [m/s^2], [s].
    tilt_std : float
        Of the direction of gravity at the start [rad].
    payload_std : float
        How much may have been taken up, at the centre of mass, since the calibration [kg].
    payload_walk : float
        Wander of the mass [kg/sqrt(s)].
    corner : float
        Of the filter that differentiates the gyro [rad/s].
    """

    gyro_std: float = 0.005
    gyro_offset: float = 0.003
    unknown_rate: float = 0.5
    acceleration_std: float = 1.0
    acceleration_time: float = 0.5
    tilt_std: float = 0.1
    payload_std: float = 0.0
    payload_walk: float = 1e-5
    corner: float = 100.0


class PoseFreeModel(NamedTuple):
    """
    All the pose-free step needs.

    Attributes
    ----------
    wrench : BiasModel
    imu : Imu
    gravity : float
        [m/s^2]
    mass, mass_std : float
        [kg]
    spread : ndarray, shape (6, 3)
        [1; c x], from a force at the centre of mass to its wrench.
    lever : ndarray, shape (3,)
        From the centre of mass to the accelerometer [m].
    inertia : ndarray, shape (3, 3)
        About the centre of mass [kg m^2].
    noise : ndarray, shape (9, 9)
        Of the :func:`readings`.
    """

    wrench: BiasModel
    imu: Imu
    gravity: float
    mass: float
    mass_std: float
    spread: Array
    lever: Array
    inertia: Array
    noise: Array


def pose_free_model(calibration: Calibration, settings: ObserverSettings = ObserverSettings('ukf'),
                    imu: Imu = Imu()) -> PoseFreeModel:
    """
    Turn a calibration into the pose-free model, for filter ``ukf`` or ``ekf`` of twelve states.

    Raises
    ------
    ConfigError
        The filter is another one, or the calibration has no accelerometer that shows gravity, or
        no noise.
    """
    accelerometer, noise = calibration.accelerometer, calibration.noise
    if accelerometer is None or accelerometer.coupling != 'dc':
        raise ConfigError('without a pose, gravity requires a DC-coupled accelerometer; record '
                          'the pose')
    if noise is None or noise.specific_force is None:
        raise ConfigError('the calibration has no noise.specific_force; calibrate from a '
                          'recording with a phase at rest')
    wrench = design(calibration, settings).bias_filter
    if wrench is None:
        raise ConfigError(f'filter {settings.filter} needs a pose; without one use {LEARNING[0]}')
    com = calibration.com.value
    place = com if accelerometer.position is None else accelerometer.position.value
    inertia = np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value
    mass_std = float(np.nan_to_num(calibration.mass.std))
    R = block_diag(noise.wrench.value, noise.specific_force.value)
    return PoseFreeModel(
        wrench, imu, calibration.gravity, float(calibration.mass),
        sqrt(mass_std ** 2 + imu.payload_std ** 2 + 1e-12),
        np.vstack([np.eye(3), skew(com)]), place - com, inertia, R)


class Turning(NamedTuple):
    """Angular velocity [rad/s] and acceleration [rad/s^2], (3,) each."""

    omega: Array
    alpha: Array


class LevelBelief(NamedTuple):
    """``level`` (3, 3), which maps a frame whose z is down to ft_sensor, and the states (18,)."""

    level: Array
    states: Gaussian


def start_pose_free(model: PoseFreeModel, specific_force: Array) -> LevelBelief:
    """
    Return the belief before the first reading, from the first specific force (3,) [m/s^2].

    Gravity is taken to oppose it, so it must not be zero.
    """
    wrench, imu = model.wrench, model.imu
    mean = np.zeros(STATES)
    mean[BIAS], mean[MASS] = wrench.bias, model.mass
    cov = block_diag(wrench.R, wrench.bias_cov, model.mass_std ** 2,
                     imu.tilt_std ** 2 * np.eye(2), imu.acceleration_std ** 2 * np.eye(3))
    return LevelBelief(_level(-specific_force), Gaussian(mean, cov))


def _level(down: Array) -> Array:
    """Rotation whose third column points down; the other two as they come."""
    z = down / np.linalg.norm(down)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def differentiate(turning: Turning | None, omega: Array, dt: float, corner: float) -> Turning:
    """
    Find the angular acceleration from the gyro, by a critically damped second-order filter.

    Parameters
    ----------
    turning
        As filtered so far.
    omega : ndarray, shape (3,)
        [rad/s]
    dt, corner : float
        [s], [rad/s]
    """
    if turning is None:
        return Turning(omega, np.zeros(3))
    r = exp(-corner * dt)
    predicted = turning.omega + dt * turning.alpha
    error = omega - predicted
    return Turning(predicted + (1 - r * r) * error, turning.alpha + (1 - r) ** 2 / dt * error)


def follow_gyro(belief: LevelBelief, model: PoseFreeModel, omega: Array | None, dt: float,
           contact: bool) -> tuple[Array, Array, Array]:
    """
    Carry ``level`` along with the gyro, and return how the states move in a period ``dt`` [s].

    ``omega`` (3,) [rad/s] is None where the gyro is silent.

    Returns
    -------
    level : ndarray, shape (3, 3)
    A : ndarray, shape (18, 18)
    Q : ndarray, shape (18, 18)
    """
    imu = model.imu
    A, Q = np.eye(STATES), np.zeros((STATES, STATES))
    turn = np.eye(3) if omega is None else rotation_from_vector(-dt * omega)
    fade = exp(-dt / imu.acceleration_time)
    A[WRENCH, WRENCH] *= expected_share(dt, contact)
    A[ACCELERATION, ACCELERATION] = fade * turn
    Q[:12, :12] = model.wrench.walk * dt
    Q[MASS, MASS] = imu.payload_walk ** 2 * dt
    tilt = imu.unknown_rate ** 2 * dt
    if omega is not None:
        # the offset of a gyro is not estimated; it counts as noise that is drawn anew this often.
        # As white noise, anew at every sample, the same size would turn gravity by much less [s]
        tilt = (imu.gyro_std * dt) ** 2 + imu.gyro_offset ** 2 * 10.0 * dt
    Q[TILT, TILT] = tilt * np.eye(2)
    Q[ACCELERATION, ACCELERATION] = imu.acceleration_std ** 2 * (1 - fade * fade) * np.eye(3)
    return turn @ belief.level, A, Q


def relevelled(level: Array, states: Gaussian) -> LevelBelief:
    """Move the tilt from the states into ``level`` (3, 3)."""
    mean = states.mean
    level = level @ rotation_from_vector([*mean[TILT], 0.0])
    # one Newton step back to orthogonality, for a filter that runs for days
    level = 1.5 * level - 0.5 * level @ level.T @ level
    mean[TILT] = 0.0
    return LevelBelief(level, states)


def readings(level: Array, model: PoseFreeModel, turning: Turning) -> Function:
    """
    Return what the sensors show: wrench (6) and specific force (3).

    y = F + b + [m (g - a); c x m (g - a) - I alpha - omega x I omega]; specific force
    a - g + alpha x d + omega x (omega x d) at d from the centre of mass. With tilt t of size h,
    g = G level [t_y sin(h)/h, -t_x sin(h)/h, cos h].

    The mass learns from how the weight turns, not from accelerations: the difference
    leaves dm a out. a carries the accelerometer's noise, which a filter would take for excitation:
    it then seems to separate mass from bias at rest, and both end up ten standard errors off.

    The difference holds at tilt 0, where the filter is.
    """
    spread, G = model.spread, model.gravity
    W = skew(turning.omega)
    offset = np.zeros(9)
    offset[3:6] = -model.inertia @ turning.alpha - W @ (model.inertia @ turning.omega)
    offset[6:] = (skew(turning.alpha) + W @ W) @ model.lever
    down = G * level[:, 2]
    across = G * level[:, 1::-1] * _SWAP

    def value(x: Array) -> Array:
        fall = down - x[ACCELERATION]
        if x[13] or x[14]:
            fall = fall + _fallen(x[None, TILT], across, down)[0]
        return np.concatenate([x[WRENCH] + x[BIAS] + spread @ (x[MASS] * fall), -fall]) + offset

    def difference(x: Array, dx: Array) -> Array:
        fall = _fallen(dx[:, TILT], across, down) - dx[:, ACCELERATION]
        dm = dx[:, MASS, None]
        push = dm * down + (x[MASS] + dm) * fall
        return np.concatenate(
            [dx[:, WRENCH] + dx[:, BIAS] + push @ spread.T, -fall], axis=1)

    return Function(value, difference)


def _fallen(tilt: Array, across: Array, down: Array) -> Array:
    """Change of g for each tilt (p, 2), without the digits that 1 - cos loses."""
    half = 0.5 * np.sqrt(np.einsum('pi,pi->p', tilt, tilt))
    s = np.sin(half)
    along = np.divide(s, half, out=np.ones_like(s), where=half > 0) * np.cos(half)
    return np.asarray((along[:, None] * tilt) @ across.T - np.outer(2 * s * s, down))


_NOTHING = np.zeros(3)

_STILL = Turning(_NOTHING, _NOTHING)

_UNKNOWN = LevelBelief(np.full((3, 3), np.nan),
                       Gaussian(np.full(STATES, np.nan), np.full((STATES, STATES), np.nan)))


class PoseFreeState(NamedTuple):
    """
    What the filter remembers.

    Attributes
    ----------
    t : float
        Stamp of the last wrench that was used [s]; NaN before the first.
    belief : LevelBelief or None
        None until an accelerometer spoke.
    contact : Contact
    turning : Turning or None
        As the gyro has it, filtered.
    """

    t: float = nan
    belief: LevelBelief | None = None
    contact: Contact = Contact()
    turning: Turning | None = None


class PoseFreeSample(NamedTuple):
    """One wrench answered, as with a pose but its NIS of the wrench alone, and by the IMU."""

    contact: ContactSample
    by_imu: ByImu


def _usable(values: ArrayLike | None, size: int) -> Array | None:
    """Return the values as an array; None where they are no readings of that many channels."""
    if values is None:
        return None
    array = np.asarray(values, dtype=float)
    return array if array.shape == (size,) and (np.abs(array) < MAX_READING).all() else None


def pose_free_step(
        state: PoseFreeState, t: float, wrench: ArrayLike, specific_force: ArrayLike | None,
        angular_velocity: ArrayLike | None, model: PoseFreeModel,
        ) -> tuple[PoseFreeState, PoseFreeSample]:
    """
    Take in one reading of the force sensor and what the IMU showed then. Never raises on it.

    Parameters
    ----------
    t : float
        Stamp [s]; a wrench that is not later than the one before is BAD_WRENCH.
    wrench : array_like, shape (6,)
        As on the wire: environment on tool, bias included [N, N m].
    specific_force, angular_velocity : array_like, shape (3,), or None
        In ft_sensor [m/s^2], [rad/s]; None or not finite: silent.
    """
    y, f = _usable(wrench, 6), _usable(specific_force, 3)
    omega = _usable(angular_velocity, 3)
    dt = t - state.t if state.t == state.t else model.wrench.period
    if y is None or not 0 < dt < np.inf:
        return state, _report(state, model, t, BAD_WRENCH)
    if state.belief is None:
        # a specific force below this, a tenth of gravity, does not tell where down is [m/s^2]
        if f is None or np.linalg.norm(f) < 1.0:
            return state, _report(state, model, t, NO_GRAVITY)
        state = state._replace(belief=start_pose_free(model, f))
    status = (NO_GYRO if omega is None else 0) | (NO_ACCELEROMETER if f is None else 0)
    try:
        return _filter(state, t, y, f, omega, min(dt, MAX_PERIOD_S), model, status)
    except NotPositiveDefinite:
        return PoseFreeState(t), _report(PoseFreeState(), model, t, status | RESTARTED)


def _filter(state: PoseFreeState, t: float, y: Array, f: Array | None, omega: Array | None,
            dt: float, model: PoseFreeModel, status: int
            ) -> tuple[PoseFreeState, PoseFreeSample]:
    assert state.belief is not None
    filtered = None if omega is None else differentiate(state.turning, omega, dt, model.imu.corner)
    turning = _STILL if filtered is None or omega is None else Turning(omega, filtered.alpha)
    level, A, Q = follow_gyro(state.belief, model, omega, dt, state.contact.assumed)
    moved = predict(state.belief.states, A, Q)
    h, k = readings(level, model, turning), 6 if f is None else 9
    reading = np.concatenate([y, _NOTHING if f is None else f])[:k]
    states, contact, expected, nis = take_reading(
        moved, lambda states: first(k, expect(states, h, model.noise)), reading,
        model.noise[:6, :6], state.contact, dt, model.wrench.contact, LEARNED)
    inertial = expected.mean[:6] - moved.mean[WRENCH] - moved.mean[BIAS]
    state = PoseFreeState(t, relevelled(level, states), contact, filtered)
    return state, _report(state, model, t, status, nis, y - expected.mean[:6], inertial,
                          y - model.wrench.bias - inertial)


def _report(state: PoseFreeState, model: PoseFreeModel, t: float, status: int, nis: float = nan,
            *wrenches: Array) -> PoseFreeSample:
    """Report a state; ``wrenches`` are innovation, inertial and measured, where known."""
    level, (mean, cov) = _UNKNOWN if state.belief is None else state.belief
    innovation, inertial, measured = (
        (wrench_tuple(one) for one in wrenches) if wrenches else (NO_WRENCH,) * 3)
    learned = learned_of(Gaussian(mean[:12], cov[:12, :12]), state.contact, nis)
    return PoseFreeSample(
        ContactSample(t, NO_WRENCH if state.belief is None else wrench_tuple(mean), status,
                      measured, innovation, inertial, learned),
        ByImu(model.gravity * level[:, 2], float(mean[MASS]), sqrt(cov[MASS, MASS])))
