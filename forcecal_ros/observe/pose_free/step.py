"""One step without a pose: wrench, accelerometer and gyro in, contact wrench and gravity out."""

from math import nan, sqrt
from typing import NamedTuple

from forcecal_ros.checks.signals import ABSURD
from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters.bias_filter import (
    expect,
    learned_of,
    LONGEST_PERIOD,
    wrench_tuple,
)
from forcecal_ros.observe.filters.contact_test import assess, Contact, free_hypothesis, opened
from forcecal_ros.observe.filters.gaussian import (
    condition,
    first,
    Gaussian,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.pose_free.model import (
    BIAS,
    differentiate,
    follow_gyro,
    LEARNED,
    LEAST_FORCE,
    LevelBelief,
    MASS,
    PoseFreeModel,
    readings,
    relevelled,
    start_pose_free,
    STATES,
    TILT,
    Turning,
    WRENCH,
)
from forcecal_ros.observe.sample import ContactSample, NO_WRENCH
from forcecal_ros.observe.status import (
    BAD_WRENCH,
    NO_ACCELEROMETER,
    NO_GRAVITY,
    NO_GYRO,
    RESTARTED,
)
import numpy as np
from numpy.typing import ArrayLike

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
    """
    One wrench answered, and what was taken off it.

    Attributes
    ----------
    contact : ContactSample
        As with a pose; the NIS it has learned covers the wrench alone.
    gravity, gravity_std : ndarray, shape (3,)
        In ft_sensor [m/s^2].
    mass, mass_std : float
        [kg]
    """

    contact: ContactSample
    gravity: Array
    gravity_std: Array
    mass: float
    mass_std: float


def _usable(values: ArrayLike | None, size: int) -> Array | None:
    """Return the values as an array; None where they are no readings of that many channels."""
    if values is None:
        return None
    array = np.asarray(values, dtype=float)
    return array if array.shape == (size,) and (np.abs(array) < ABSURD).all() else None


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
    dt = t - state.t if state.t == state.t else model.wrench.covariances.period
    if y is None or not 0 < dt < np.inf:
        return state, _report(state, model, t, BAD_WRENCH)
    if state.belief is None:
        if f is None or np.linalg.norm(f) < LEAST_FORCE:
            return state, _report(state, model, t, NO_GRAVITY)
        state = state._replace(belief=start_pose_free(model, f))
    status = (NO_GYRO if omega is None else 0) | (NO_ACCELEROMETER if f is None else 0)
    try:
        return _filter(state, t, y, f, omega, min(dt, LONGEST_PERIOD), model, status)
    except NotPositiveDefinite:
        return PoseFreeState(t), _report(PoseFreeState(), model, t, status | RESTARTED)


def _filter(state: PoseFreeState, t: float, y: Array, f: Array | None, omega: Array | None,
            dt: float, model: PoseFreeModel, status: int
            ) -> tuple[PoseFreeState, PoseFreeSample]:
    assert state.belief is not None
    filtered = None if omega is None else differentiate(state.turning, omega, dt, model.imu.corner)
    turning = _STILL if filtered is None or omega is None else Turning(omega, filtered.alpha)
    level, transition, Q = follow_gyro(state.belief, model, omega, dt, state.contact.assumed)
    moved = predict(state.belief.states, transition, Q)
    h, k = readings(level, model, turning), 6 if f is None else 9
    reading = np.concatenate([y, _NOTHING if f is None else f])[:k]
    expected = first(k, expect(moved, h, model.noise, model.wrench))
    free = free_hypothesis(moved, expected, y, model.noise[:6, :6])
    contact, nis = assess(state.contact, free, dt, model.wrench.contact)
    frozen = LEARNED if contact.assumed else None
    if frozen and not state.contact.assumed:
        moved = opened(moved)
        expected = first(k, expect(moved, h, model.noise, model.wrench))
    inertial = expected.mean[:6] - moved.mean[WRENCH] - moved.mean[BIAS]
    belief = relevelled(level, condition(moved, expected, reading, frozen))
    state = PoseFreeState(t, belief, contact, filtered)
    return state, _report(state, model, t, status, nis, y - expected.mean[:6], inertial,
                          y - model.wrench.bias - inertial)


def _report(state: PoseFreeState, model: PoseFreeModel, t: float, status: int, nis: float = nan,
            *wrenches: Array) -> PoseFreeSample:
    """Say what a state says; ``wrenches`` are innovation, inertial and measured, where known."""
    level, (mean, cov) = _UNKNOWN if state.belief is None else state.belief
    innovation, inertial, measured = (
        (wrench_tuple(one) for one in wrenches) if wrenches else (NO_WRENCH,) * 3)
    learned = learned_of(Gaussian(mean[:12], cov[:12, :12]), state.contact, nis, model.wrench)
    # tilt about the first axis moves gravity along the second, and the other way round
    across = level[:, 1::-1] * (-1.0, 1.0)
    variance = ((across @ cov[TILT, TILT]) * across).sum(axis=1)
    G = model.gravity
    return PoseFreeSample(
        ContactSample(t, NO_WRENCH if state.belief is None else wrench_tuple(mean), status,
                      measured, innovation, inertial, learned),
        G * level[:, 2], G * np.sqrt(variance), float(mean[MASS]), sqrt(cov[MASS, MASS]))
