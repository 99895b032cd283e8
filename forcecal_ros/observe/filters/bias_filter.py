"""Gravity compensation's one step, for node and replay alike; [Ukf2025].

A wrench F and biases b that both wander freely have rank 6 of 12: a reading shows their sum. So

- while contact is excluded, F is expected to return to nil within ``relaxation`` and what stays
  is bias: rank 12, the biases learn;
- while contact is assumed, F wanders freely, and the biases are frozen at what they were, their
  uncertainty still counted (Schmidt's filter): a steady push never becomes a bias.

A push too weak for the test (see ``contact_test``) is read 6 % short and does
become bias, over a minute or more; the correlation of F and b in each estimate says how little the
two can be told apart.

The load comes from whoever knows the motion: the observer's ``inertial`` (accelerometer and pose),
or :func:`weight` (pose alone), which is all that the filter ``static`` wants.
"""

from functools import partial
from math import isfinite
from typing import NamedTuple

from forcecal_ros.geometry import Array
from forcecal_ros.observe.filters import ekf, ukf
from forcecal_ros.observe.filters.bias_model import measurement, Model, start, transition
from forcecal_ros.observe.filters.contact_test import assess, Contact, free_hypothesis, opened
from forcecal_ros.observe.filters.gaussian import condition, Gaussian, NotPositiveDefinite, predict
import numpy as np
from numpy.typing import ArrayLike

BAD_WRENCH = 1
"""The reading is no finite, sensible wrench; the last estimate is repeated."""
BAD_PERIOD = 2
"""Time did not advance; the last estimate is repeated."""
NO_LOAD = 4
"""Neither weight nor inertia is known; the last estimate is repeated."""
RESTARTED = 8
"""The filter lost its footing and started anew."""
NO_GYRO = 16
"""Without a pose: the gyro is silent; gravity is followed by the accelerometer alone."""
NO_ACCELEROMETER = 32
"""Without a pose: the accelerometer is silent; gravity is carried on by the gyro alone."""

INVALID = BAD_WRENCH | BAD_PERIOD | NO_LOAD

_TEXT = {
    BAD_WRENCH: 'the wrench is no finite, sensible number; the last estimate is repeated',
    BAD_PERIOD: 'time did not advance; the last estimate is repeated',
    NO_LOAD: 'weight unknown: neither pose nor accelerometer tells; the last estimate is repeated',
    RESTARTED: 'the filter started anew',
    NO_GYRO: 'the gyro is silent; gravity is followed by the accelerometer alone',
    NO_ACCELEROMETER: 'the accelerometer is silent; gravity is carried on by the gyro alone',
}

LONGEST_PERIOD = 10.0
"""A longer pause counts as this long; all but the biases is forgotten by then [s]."""

_SENSIBLE = 1e6
_NOTHING = np.zeros(6)


class State(NamedTuple):
    """
    What the filter remembers.

    Attributes
    ----------
    belief : Gaussian
        Wrench (6), or wrench and biases (12).
    contact : Contact
    """

    belief: Gaussian
    contact: Contact


class Estimate(NamedTuple):
    """
    One reading with gravity, inertia and bias taken off; in ft_sensor, wire sign.

    Attributes
    ----------
    wrench : ndarray, shape (6,)
        Contact wrench, environment on tool [N, N m].
    std : ndarray, shape (6,)
        Standard error of each.
    bias, bias_std : ndarray, shape (6,)
        [N, N m]
    correlation : ndarray, shape (6,)
        Of each wrench component with its bias; 0 where the biases are no states.
    innovation : ndarray, shape (6,)
        Reading less what the filter expected; NaN where it expected nothing.
    nis : float
        Normalised innovation squared of the hypothesis in force where that is "no contact":
        chi-square with 6 degrees of freedom. In contact, large.
    contact : bool
        Whether contact is assumed.
    status : int
        Bits above; 0 when all is well.
    """

    wrench: Array
    std: Array
    bias: Array
    bias_std: Array
    correlation: Array
    innovation: Array
    nis: float
    contact: bool
    status: int


def describe(status: int) -> tuple[str, ...]:
    """
    Say what the bits of a status mean.

    Parameters
    ----------
    status : int

    Returns
    -------
    tuple of str
        One sentence for each bit set.
    """
    return tuple(text for bit, text in _TEXT.items() if status & bit)


def initial_state(model: Model) -> State:
    """
    Return the state before the first reading.

    Parameters
    ----------
    model : Model

    Returns
    -------
    State
    """
    return State(start(model), Contact())


def weight(R_base_sensor: ArrayLike, model: Model) -> Array:
    """
    Weight of the tool on the wire, [m g; c x m g].

    Parameters
    ----------
    R_base_sensor : array_like, shape (..., 3, 3)
    model : Model

    Returns
    -------
    ndarray, shape (..., 6)
        [N, N m]
    """
    g_sensor = -model.gravity * np.asarray(R_base_sensor, dtype=float)[..., 2, :]
    return np.asarray(g_sensor @ model.weight.T)


def step(state: State, wrench: ArrayLike, load: ArrayLike | None, dt: float,
         model: Model) -> tuple[State, Estimate]:
    """
    Take in one reading of the force sensor. Never raises on a bad one.

    Parameters
    ----------
    state : State
    wrench : array_like, shape (6,)
        As on the wire: environment on tool, bias included [N, N m].
    load : array_like, shape (6,), or None
        What weight and motion of the tool put on the wire [N, N m]; None: not known.
    dt : float
        Time since the reading before [s].
    model : Model

    Returns
    -------
    State
    Estimate
    """
    y = np.asarray(wrench, dtype=float)
    status = check(y, dt)
    if load is None:
        status |= NO_LOAD
    else:
        load = np.asarray(load, dtype=float)
        if not sensible(load):
            status |= NO_LOAD
    if status or load is None:
        return state, estimate_of(state, model, status)
    if model.settings.filter == 'static':
        belief = Gaussian(y - load - model.bias, model.covariances.R)
        return (state._replace(belief=belief),
                estimate_of(State(belief, state.contact), model, 0))
    dt = min(dt, LONGEST_PERIOD)
    try:
        return _filter(state, y, load, dt, model)
    except NotPositiveDefinite:
        state = initial_state(model)
        return state, estimate_of(state, model, RESTARTED)


def sensible(values: Array) -> bool:
    """Whether all are numbers a sensor could mean; neither NaN nor infinite."""
    return bool((np.abs(values) < _SENSIBLE).all())


def check(y: Array, dt: float) -> int:
    """Return the status bits of a wrench and a period before they are used."""
    status = 0 if y.shape == (6,) and sensible(y) else BAD_WRENCH
    return status if isfinite(dt) and dt > 0 else status | BAD_PERIOD


def _filter(state: State, y: Array, load: Array, dt: float,
            model: Model) -> tuple[State, Estimate]:
    R = model.covariances.R
    expect = ekf.expect
    if model.settings.filter == 'ukf':
        expect = partial(ukf.expect, scaling=model.settings.scaling)
    moved = predict(state.belief, *transition(model, dt, state.contact.assumed))
    h = measurement(model, load)
    expected = expect(moved, h, R)
    contact, nis = assess(state.contact, free_hypothesis(moved, expected, y, R), dt,
                          model.contact)
    frozen = slice(6, 12) if contact.assumed and model.augmented else None
    if frozen and not state.contact.assumed:
        moved = opened(moved)
        expected = expect(moved, h, R)
    state = State(condition(moved, expected, y, frozen), contact)
    return state, estimate_of(state, model, 0, y - expected.mean, nis)


def estimate_of(state: State, model: Model, status: int, innovation: Array | None = None,
                nis: float = float('nan')) -> Estimate:
    """Put together what a state says; see :class:`Estimate`."""
    mean, cov = state.belief
    std = np.sqrt(cov.diagonal())
    if len(mean) == 12:
        bias, bias_std = mean[6:], std[6:]
        correlation = cov.diagonal(6) / (std[:6] * bias_std)
    else:
        bias, bias_std, correlation = model.bias, np.sqrt(model.bias_cov.diagonal()), _NOTHING
    return Estimate(mean[:6], std[:6], bias, bias_std, correlation,
                    np.full(6, np.nan) if innovation is None else innovation, nis,
                    state.contact.assumed, status)
