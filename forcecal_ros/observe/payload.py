"""
The tool as it is: mass and centre of mass estimated while the robot works.

[Ukf2025] with mass and centre of mass among the states. A reading is

    y = F + b - [m f + A h + e a; r x (m f + A h) + J alpha + omega x J omega],   h = m c

with r = c + s x_hat, A = [alpha]x + [omega]x^2, f the specific force at the tool's origin and a
its acceleration. h, the first moment, keeps the effect of gravity linear; the effect of rotation
is not, h x A h / m, and is left to the sigma points. The inertia J about the centre of mass is
kept as calibrated: a payload moves the centre of mass, its own inertia is not estimated.

F is what no tool explains while nothing touches: errors of weight and inertia, which go with the
motion and do not average out as noise does. b is the sensor's bias, or a steady push that rotates
with the sensor. e is the mass that accelerations show beyond the mass that gravity shows: zero
for a payload, minus its apparent mass for a push that only looks like weight.

One step: the tool is what it was, or something touches it, or it carries more. The belief that
counts is updated while a reading is what its tool explains. Once it is not, that belief is kept
as it is, and a second one is opened: mass, first moment and a steady push that rotates with the
sensor may be anything now. It is opened anew whenever its own readings contradict it, as those of
a hand, a wall or a grasp that is still closing do. It counts from then on once it has lasted, once
orientations have shown the mass within the accuracy required, no steady push is left next to the
weight, and accelerations do not contradict.

What no force sensor can show: a vertical push of steady size at one place of the tool is a weight
as long as nothing accelerates; and without rotation a weight is no more than a force. Nothing is
taken over then.
"""

from dataclasses import dataclass
from math import exp, hypot, nan, sqrt
from typing import Annotated, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.rigid_body import BodyMotion, regressor
from forcecal_ros.core.schema import Row, Section
from forcecal_ros.observe.bandwidth import noise_of_reading
from forcecal_ros.observe.bias_filter import (
    assess,
    BIAS,
    Contact,
    ContactModel,
    MASS,
    pair,
    WRENCH,
)
from forcecal_ros.observe.gaussian import (
    condition,
    expect,
    Function,
    Gaussian,
    mahalanobis,
    NotPositiveDefinite,
    predict,
)
import numpy as np
from scipy.special import chdtri

MOMENT, EXCESS, STATES = slice(13, 16), 16, 17
"""Where they are among the states, behind wrench, bias and mass, and how many those are."""

TOOL = slice(MASS, EXCESS)
"""Mass and moment."""

_PAIR = tuple[float, float]

REACH_M = 0.3
"""A payload is expected within so much of the sensor: a gripper's length and a half [m]."""

TRACKING, FROZEN, NOT_EXCITED = 'tracking', 'frozen', 'not_excited'

LASTING_S = 0.4
"""What explains all readings for so long is no blow and no grasp that is closing [s]."""


@dataclass(frozen=True)
class PayloadSettings(Section, name='payload'):
    """Choices of the payload's estimation."""

    floor: Annotated[_PAIR, Row(
        'Residual of weight and inertia in free motion, averaged over 0.2 s', 'N, N m', 0.0
        )] = (0.05, 0.004)
    largest: Annotated[float | None, Row(
        "Largest payload that is expected; None: the tool's own mass", 'kg', above=0.0)] = None


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
        raise ConfigError(f'the calibrated mass is {m} kg; tracking requires a mass above '
                          'zero; calibrate again')
    weight = m * calibration.gravity
    # errors of gains and angles, as a share of the weight
    share = 3e-3
    floor = pair(hypot(settings.floor[0], share * weight),
                 hypot(settings.floor[1], share * weight * float(np.linalg.norm(c))))
    # how far the biases may have moved since the calibration [N], [N m]
    bias_prior = pair(0.3, 0.03)
    density = np.zeros((6, 6))
    if calibration.noise is not None:
        density = noise_of_reading(calibration, calibration.noise)[1]
    # false alarm: probability that a free reading is called contact; it costs a pause of the
    # tracking, where a push that is missed costs a wrong mass
    # window: time over which a weak contact is averaged: a third of that in which a payload is to
    # be noticed [s]
    # release: quiet after which contact counts as ended: longer than a light payload is hidden by
    # a vibration, and than a grasp takes to let go [s]
    return PayloadModel(
        _start(calibration, floor, bias_prior), density, floor, bias_prior, _walk(m),
        _opening(m if settings.largest is None else settings.largest, calibration.gravity),
        ContactModel(floor, np.zeros((6, 6)), float(chdtri(6, 1e-3)), 0.3, 1.0),
        np.zeros((3, 3)) if calibration.inertia is None else calibration.inertia.value,
        calibration.gravity)


def _start(calibration: Calibration, floor: Array, bias_prior: Array) -> Gaussian:
    m, c = float(calibration.mass), calibration.com.value
    mean, cov = np.zeros(STATES), np.zeros((STATES, STATES))
    mean[BIAS], mean[MASS], mean[MOMENT] = calibration.wrench_bias.value, m, m * c
    mass_std = max(float(np.nan_to_num(calibration.mass.std)), 1e-3 * m)
    com_std = np.maximum(np.nan_to_num(calibration.com.std), 1e-4)
    bias_std = np.nan_to_num(calibration.wrench_bias.std)
    cov[WRENCH, WRENCH] = floor
    cov[BIAS, BIAS] = np.diag(bias_std ** 2) + bias_prior
    to_moment = np.array([1.0, *c])
    cov[TOOL, TOOL] = mass_std ** 2 * np.outer(to_moment, to_moment)
    cov[MOMENT, MOMENT] += np.diag((m * com_std) ** 2)
    # relative difference between mass by accelerations and mass by gravity that sensors bring
    # along, which is learned in free motion: delays and gains, a fifth on a real arm
    cov[EXCESS, EXCESS] = (0.3 * m) ** 2
    return Gaussian(mean, cov)


def _walk(m: float) -> Array:
    # wander of the mass, relative: a change too small to be noticed at once, as of glue or paint,
    # is followed within some seconds, and the standard error never falls below what could
    # go unnoticed [1/sqrt(s)]
    mass_walk = 2e-3
    walk = np.zeros(STATES)
    # wander of the biases: 0.1 N and 0.01 N m in ten minutes, as force sensors warm
    # up [N/sqrt(s), N m/sqrt(s)]
    walk[BIAS] = np.repeat((4e-3, 4e-4), 3)
    walk[MASS], walk[MOMENT] = mass_walk * m, mass_walk * m * REACH_M / 3
    return np.diag(walk ** 2)


def _opening(largest: float, gravity: float) -> Array:
    std = np.zeros(STATES)
    std[BIAS] = np.repeat([largest * gravity, largest * gravity * REACH_M], 3)
    std[MASS], std[MOMENT], std[EXCESS] = largest, largest * REACH_M, largest
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


def transition(model: PayloadModel, dt: float) -> tuple[Array, Array]:
    """Return how the states move in ``dt`` [s]: F is forgotten, the others wander."""
    # time in which errors of weight and inertia become others: that of an arm's own motion [s]
    k = exp(-dt / 0.5)
    A, Q = np.eye(STATES), model.walk * dt
    A[WRENCH, WRENCH] *= k
    Q[WRENCH, WRENCH] = (1 - k * k) * model.floor
    return A, Q


def measurement(block: Block, model: PayloadModel) -> Function:
    """Return what a block's reading is made of, as a function of the 17 states."""
    omega, alpha, J = block.omega, block.alpha, model.inertia
    motion = BodyMotion(*(np.array([one]) for one in (block.t, -block.f, omega, alpha)))
    linear_part = np.zeros((6, STATES))
    linear_part[:, WRENCH] = linear_part[:, BIAS] = np.eye(6)
    linear_part[:, TOOL] = regressor(motion, np.array([block.s]))[0, :, :4]
    linear_part[:3, EXCESS] = -(block.f + block.down)
    by_moment = linear_part[:3, MOMENT]
    spin = J @ alpha + np.cross(omega, J @ omega)
    least = 0.1 * model.start.mean[MASS]

    def turning(x: Array) -> Array:
        """Torque of -c x A h about the origin; ``least`` where a hypothesis has no mass."""
        h, m = x[..., MOMENT], np.maximum(x[..., MASS], least)
        return np.asarray(np.cross(h, h @ by_moment.T) / m[..., np.newaxis])

    def value(x: Array) -> Array:
        y = linear_part @ x
        y[3:] += turning(x) - spin
        return np.asarray(y)

    def difference(x: Array, dx: Array) -> Array:
        y = dx @ linear_part.T
        y[:, 3:] += turning(x + dx) - turning(x)
        return np.asarray(y)

    return Function(value, difference)


class Hypothesis(NamedTuple):
    """
    A belief and whether its readings contradict it.

    Attributes
    ----------
    states : Gaussian
        See :mod:`forcecal_ros.observe.payload.model`.
    contact : Contact
    age : float
        Since it was opened [s].
    """

    states: Gaussian
    contact: Contact = Contact()
    age: float = 0.0


class Change(NamedTuple):
    """
    A payload that was taken up or put down.

    Attributes
    ----------
    t : float
        When it was known [s].
    mass : float
        Gained [kg].
    inert : bool
        Whether accelerations have shown it too. Where not, a steady push straight down at one
        place of the tool is not excluded.
    """

    t: float
    mass: float
    inert: bool


class PayloadState(NamedTuple):
    """
    The beliefs.

    Attributes
    ----------
    t : float
        Of the last block [s]; NaN before the first.
    main : Hypothesis
        The one that counts.
    before : tuple of Gaussian
        What it was in the last blocks, oldest first.
    change : Hypothesis or None
        What may have been taken up or put down since.
    changes : tuple of Change
        Those taken over.
    """

    t: float
    main: Hypothesis
    before: tuple[Gaussian, ...] = ()
    change: Hypothesis | None = None
    changes: tuple[Change, ...] = ()


class ToolEstimate(NamedTuple):
    """
    What hangs on the sensor.

    Attributes
    ----------
    t : float
        [s]
    state : str
        ``tracking``; ``frozen``: something touches the tool, or may; ``not_excited``: the tool
        may have changed, or its mass is not known, and too little rotation has shown which.
    mass, mass_std : float
        [kg]
    com, com_std : ndarray, shape (3,)
        In ft_sensor [m].
    suspected : float
        Change of the mass that readings may speak of, NaN where they do not [kg].
    suspected_std : float
        Of that, a steady push allowed for [kg].
    """

    t: float
    state: str
    mass: float
    mass_std: float
    com: Array
    com_std: Array
    suspected: float = nan
    suspected_std: float = nan


def begin(model: PayloadModel) -> PayloadState:
    """Return the beliefs before the first reading: the calibration."""
    return PayloadState(nan, Hypothesis(model.start), (model.start,))


def on_block(state: PayloadState, block: Block, model: PayloadModel) -> PayloadState:
    """Take in one block; never raises on it."""
    dt = block.t - state.t
    if not 0 < dt < 1.0:
        dt = block.duration
    try:
        return _follow(state._replace(t=block.t), block, dt, model)
    except NotPositiveDefinite:
        return begin(model)._replace(t=block.t, changes=state.changes)


def _follow(state: PayloadState, block: Block, dt: float, model: PayloadModel) -> PayloadState:
    h, touched = measurement(block, model), state.main.contact.assumed
    main = _advance(state.main, block, h, dt, model, learns=not touched)
    if not main.contact.assumed:
        # blocks in which a contact may have begun before it is noticed: what was learned in them
        # is forgotten then, half a second
        return state._replace(main=main, before=(*state.before, main.states)[-10:],
                              change=None)
    if not touched:
        main = main._replace(states=_forgetful((*state.before, main.states)[0], model, dt))
    change = _advance(state.change or _open(main, model), block, h, dt, model, learns=True)
    if change.contact.assumed:
        change = _advance(_open(main, model), block, h, dt, model, learns=True)
    if not (change.age >= LASTING_S and is_known(change.states, model)
            and _is_weight(change.states, main.states, model)):
        return state._replace(main=main, before=(), change=change)
    gained = float(change.states.mean[MASS] - main.states.mean[MASS])
    return PayloadState(state.t, change._replace(contact=Contact()), (), None,
                        (*state.changes, Change(
                            state.t, gained, _is_distinct(change.states, main.states))))


def _advance(hypothesis: Hypothesis, block: Block, h: Function, dt: float, model: PayloadModel,
             learns: bool) -> Hypothesis:
    """Test a reading against a hypothesis, and learn from it where it does not contradict."""
    states = predict(hypothesis.states, *transition(model, dt))
    R = model.density / block.duration + np.diag(block.scatter) + 1e-6 * model.floor
    expected = expect(states, h, R)
    contact, _ = assess(hypothesis.contact, states, expected, block.reading, R, dt, model.contact)
    age = hypothesis.age + dt
    if contact.assumed or not learns:
        return Hypothesis(_forgetful(hypothesis.states, model, dt), contact, age)
    learned = condition(states, expected, block.reading)
    # what is known by now also explains the readings that the average is of
    explained = h.value(_unforced(learned.mean)) - h.value(_unforced(states.mean))
    seen = 1 - exp(-age / model.contact.window)
    return Hypothesis(
        learned, contact._replace(average=contact.average - seen * explained), age)


def _unforced(x: Array) -> Array:
    """Return the states as if nothing but tool and bias made the reading."""
    return np.concatenate([np.zeros(6), x[6:]])


def _forgetful(states: Gaussian, model: PayloadModel, dt: float) -> Gaussian:
    """Keep a belief through contact; what motion left unexplained before means nothing after."""
    mean, cov = states.mean.copy(), states.cov + model.walk * dt
    mean[WRENCH], cov[WRENCH, :], cov[:, WRENCH] = 0.0, 0.0, 0.0
    cov[WRENCH, WRENCH] = model.floor
    return Gaussian(mean, cov)


def _open(main: Hypothesis, model: PayloadModel) -> Hypothesis:
    """Return the belief that the load has changed just now, from what was known before."""
    return Hypothesis(Gaussian(main.states.mean, main.states.cov + model.opening))


def is_known(states: Gaussian, model: PayloadModel) -> bool:
    """Whether the mass is known as well as required, as a share of the larger of both tools."""
    m = float(states.mean[MASS])
    # relative standard error of the mass at which a change is taken over
    most = 0.01 * max(m, float(model.start.mean[MASS]))
    return bool(m > 0 and states.cov[MASS, MASS] <= most ** 2)


def _is_weight(change: Gaussian, main: Gaussian, model: PayloadModel) -> bool:
    """
    Whether no steady push is left beside the weight, and the mass is as inert as heavy.

    A push that a bias may be does not count: one that turns with the sensor spoils no mass.
    """
    push = change.mean[BIAS] - main.mean[BIAS]
    cov = change.cov[BIAS, BIAS] + main.cov[BIAS, BIAS] + model.bias_prior
    return _is_inert(change, main) and mahalanobis(push, cov) <= model.contact.limit


def _is_inert(change: Gaussian, main: Gaussian) -> bool:
    """Whether accelerations show the mass gained, or do not tell; a push shows none of it."""
    gained, excess = (change.mean - main.mean)[[MASS, EXCESS]].tolist()
    return not _is_distinct(change, main) or abs(excess) < abs(excess + gained)


def _is_distinct(change: Gaussian, main: Gaussian) -> bool:
    """Whether accelerations tell a payload of this mass from a push."""
    variance = change.cov[EXCESS, EXCESS] + main.cov[EXCESS, EXCESS]
    # a push counts as separated from a payload by accelerations where the two would differ by so
    # many standard errors of the mass that accelerations show
    return bool(3.0 * sqrt(variance) < abs(change.mean[MASS] - main.mean[MASS]))


def estimate(state: PayloadState, model: PayloadModel) -> ToolEstimate:
    """Say what hangs on the sensor, with standard errors to first order."""
    mean, cov = state.main.states
    m, com = float(mean[MASS]), mean[MOMENT] / mean[MASS]
    from_states = np.eye(4)
    from_states[1:] /= m
    from_states[1:, 0] = -com / m
    std = np.sqrt((from_states @ cov[TOOL, TOOL] @ from_states.T).diagonal())
    known = is_known(state.main.states, model)
    word, change = TRACKING if known else NOT_EXCITED, state.change
    suspected = suspected_std = nan
    if change is not None:
        word = FROZEN
        if change.age >= LASTING_S:
            suspected = float(change.states.mean[MASS] - m)
            suspected_std = sqrt(change.states.cov[MASS, MASS])
            if not is_known(change.states, model):
                word = NOT_EXCITED
    return ToolEstimate(state.t, word, m, float(std[0]), com, std[1:], suspected, suspected_std)
