"""One step without a pose: wrench, accelerometer and gyro in, contact wrench and gravity out."""

from functools import partial
from math import sqrt
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.observe.filters import ekf, ukf
from forcecal_ros.observe.filters.bias_filter import (
    check,
    Estimate,
    estimate_of,
    LONGEST_PERIOD,
    NO_ACCELEROMETER,
    NO_GYRO,
    NO_LOAD,
    RESTARTED,
    sensible,
    State,
)
from forcecal_ros.observe.filters.contact_test import assess, Contact, free_hypothesis, opened
from forcecal_ros.observe.filters.gaussian import (
    condition,
    first,
    Gaussian,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.pose_free.model import PoseFreeModel
from forcecal_ros.observe.pose_free.orientation import (
    Belief,
    differentiate,
    LEARNED,
    LEAST_FORCE,
    MASS,
    Motion,
    readings,
    relevelled,
    start_pose_free,
    STATES,
    TILT,
    turned,
)
import numpy as np
from numpy.typing import ArrayLike

_NOTHING = np.zeros(3)
_STILL = Motion(_NOTHING, _NOTHING)
_UNKNOWN = Belief(np.full((3, 3), np.nan),
                  Gaussian(np.full(STATES, np.nan), np.full((STATES, STATES), np.nan)))


class PoseFreeState(NamedTuple):
    """
    What the filter remembers.

    Attributes
    ----------
    belief : Belief or None
        None until an accelerometer spoke.
    contact : Contact
    motion : Motion or None
        As the gyro has it, filtered.
    """

    belief: Belief | None = None
    contact: Contact = Contact()
    motion: Motion | None = None


class PoseFreeEstimate(NamedTuple):
    """
    One reading compensated, and what it was compensated with.

    Attributes
    ----------
    contact : Estimate
        As with a pose; its NIS covers the wrench alone.
    gravity, gravity_std : ndarray, shape (3,)
        In ft_sensor [m/s^2].
    mass, mass_std : float
        [kg]
    """

    contact: Estimate
    gravity: Array
    gravity_std: Array
    mass: float
    mass_std: float


def _vector(values: ArrayLike | None) -> Array | None:
    if values is None:
        return None
    array = np.asarray(values, dtype=float)
    return array if array.shape == (3,) and sensible(array) else None


def pose_free_step(
        state: PoseFreeState, wrench: ArrayLike, specific_force: ArrayLike | None,
        angular_velocity: ArrayLike | None, dt: float, model: PoseFreeModel,
        ) -> tuple[PoseFreeState, PoseFreeEstimate]:
    """
    Take in one reading of the force sensor and what the IMU showed then. Never raises on it.

    Parameters
    ----------
    state : PoseFreeState
    wrench : array_like, shape (6,)
        As on the wire: environment on tool, bias included [N, N m].
    specific_force, angular_velocity : array_like, shape (3,), or None
        In ft_sensor [m/s^2], [rad/s]; None or not finite: silent.
    dt : float
        Time since the reading before [s].
    model : PoseFreeModel

    Returns
    -------
    PoseFreeState
    PoseFreeEstimate
    """
    y, f, omega = np.asarray(wrench, dtype=float), _vector(specific_force), _vector(
        angular_velocity)
    status = check(y, dt)
    if state.belief is None and (f is None or np.linalg.norm(f) < LEAST_FORCE):
        status |= NO_LOAD
    if status:
        return state, _report(state, model, status)
    if state.belief is None and f is not None:
        state = state._replace(belief=start_pose_free(model, f))
    status = (NO_GYRO if omega is None else 0) | (NO_ACCELEROMETER if f is None else 0)
    try:
        return _filter(state, y, f, omega, min(dt, LONGEST_PERIOD), model, status)
    except NotPositiveDefinite:
        return PoseFreeState(), _report(PoseFreeState(), model, status | RESTARTED)


def _filter(state: PoseFreeState, y: Array, f: Array | None, omega: Array | None, dt: float,
            model: PoseFreeModel, status: int) -> tuple[PoseFreeState, PoseFreeEstimate]:
    assert state.belief is not None
    filtered = None if omega is None else differentiate(state.motion, omega, dt, model.imu.corner)
    motion = _STILL if filtered is None or omega is None else Motion(omega, filtered.alpha)
    settings = model.wrench.settings
    expect = ekf.expect
    if settings.filter == 'ukf':
        expect = partial(ukf.expect, scaling=settings.scaling)
    level, transition, Q = turned(state.belief, model, omega, dt, state.contact.assumed)
    moved = predict(state.belief.states, transition, Q)
    h, k = readings(level, model, motion), 6 if f is None else 9
    reading = np.concatenate([y, _NOTHING if f is None else f])[:k]
    expected = first(k, expect(moved, h, model.noise))
    free = free_hypothesis(moved, expected, y, model.noise[:6, :6])
    contact, nis = assess(state.contact, free, dt, model.wrench.contact)
    frozen = LEARNED if contact.assumed else None
    if frozen and not state.contact.assumed:
        moved = opened(moved)
        expected = first(k, expect(moved, h, model.noise))
    belief = relevelled(level, condition(moved, expected, reading, frozen))
    state = PoseFreeState(belief, contact, filtered)
    return state, _report(state, model, status, y - expected.mean[:6], nis)


def _report(state: PoseFreeState, model: PoseFreeModel, status: int,
            innovation: Array | None = None, nis: float = float('nan')) -> PoseFreeEstimate:
    level, (mean, cov) = _UNKNOWN if state.belief is None else state.belief
    wrench = State(Gaussian(mean[:12], cov[:12, :12]), state.contact)
    # tilt about the first axis moves gravity along the second, and the other way round
    across = level[:, 1::-1] * (-1.0, 1.0)
    variance = ((across @ cov[TILT, TILT]) * across).sum(axis=1)
    G = model.wrench.gravity
    return PoseFreeEstimate(
        estimate_of(wrench, model.wrench, status, innovation, nis),
        G * level[:, 2], G * np.sqrt(variance),
        float(mean[MASS]), sqrt(cov[MASS, MASS]))
