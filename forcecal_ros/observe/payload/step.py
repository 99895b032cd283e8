"""One step: the tool is what it was, or something touches it, or it carries more.

The belief that counts is updated while a reading is what its tool explains. Once it is not, that
belief is kept as it is, and a second one is opened beside it: mass, first moment and a steady
push that turns with the sensor may be anything now. It is opened anew whenever its own readings
contradict it, as those of a hand, a wall or a grasp that is still closing do. It counts
from then on once it has lasted, orientations have told the mass within the accuracy asked for,
no steady push is left beside the weight, and accelerations do not contradict.

What no force sensor can tell: a vertical push of steady size at one place of the tool is a weight
as long as nothing accelerates; and without rotation a weight is no more than a force. Nothing is
taken over then.
"""

from math import exp, nan, sqrt
from typing import NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters import ukf
from forcecal_ros.observe.filters.contact_test import assess, Contact, free_hypothesis
from forcecal_ros.observe.filters.gaussian import (
    condition,
    Function,
    Gaussian,
    mahalanobis,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.payload.model import (
    BIAS,
    Block,
    EXCESS,
    MASS,
    measurement,
    MOMENT,
    PayloadModel,
    transition,
    WRENCH,
)
import numpy as np

TRACKING, FROZEN, NOT_EXCITED = 'tracking', 'frozen', 'not_excited'

LASTING = 0.4
"""What explains all readings for so long is no blow and no grasp that is closing [s]."""

SURE = 3.0
"""A push counts as told from a payload by accelerations where the two would differ by so many
standard errors of the mass that accelerations show [1]."""

UNHEARD = 10
"""Blocks in which a contact may have begun before it is noticed: what was learned in them is
forgotten then, half a second."""


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
    What is believed.

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
        may have changed, or its mass is not known, and too little rotation has told which.
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
    """Return what is believed before the first reading: the calibration."""
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
        return state._replace(main=main, before=(*state.before, main.states)[-UNHEARD:],
                              change=None)
    if not touched:
        main = main._replace(states=_forgetful((*state.before, main.states)[0], model, dt))
    change = _advance(state.change or _open(main, model), block, h, dt, model, learns=True)
    if change.contact.assumed:
        change = _advance(_open(main, model), block, h, dt, model, learns=True)
    if not _settled(change, main, model):
        return state._replace(main=main, before=(), change=change)
    gained = float(change.states.mean[MASS] - main.states.mean[MASS])
    return PayloadState(state.t, change._replace(contact=Contact()), (), None,
                        (*state.changes, Change(
                            state.t, gained, _tells(change.states, main.states))))


def tared(state: PayloadState, shift: Array, model: PayloadModel) -> PayloadState:
    """
    Return what is believed after a tare by ``shift`` (6,), in which nothing touched the tool.

    Readings have their bias put back on, so that a tare changes none of them. One that is more
    than a drift tells of another bias or another load, and from then on either may be.
    """
    expected = state.main.states.cov[BIAS, BIAS] + model.floor
    if mahalanobis(shift, expected) <= model.contact.limit:
        return state
    return state._replace(main=_open(state.main, model), before=(), change=None)


def _advance(hypothesis: Hypothesis, block: Block, h: Function, dt: float, model: PayloadModel,
             learns: bool) -> Hypothesis:
    """Test a reading against a hypothesis, and learn from it where it does not contradict."""
    states = predict(hypothesis.states, *transition(model, dt))
    R = model.density / block.duration + np.diag(block.scatter) + 1e-6 * model.floor
    expected = ukf.expect(states, h, R)
    contact, _ = assess(hypothesis.contact, free_hypothesis(states, expected, block.reading, R),
                        dt, model.contact)
    age = hypothesis.age + dt
    if contact.assumed or not learns:
        return Hypothesis(_forgetful(hypothesis.states, model, dt), contact, age)
    learned = condition(states, expected, block.reading)
    # what is known by now also explains the readings that the average is of
    explained = h.value(_unforced(learned.mean)) - h.value(_unforced(states.mean))
    heard = 1 - exp(-age / model.contact.window)
    return Hypothesis(
        learned, contact._replace(average=contact.average - heard * explained), age)


def _unforced(x: Array) -> Array:
    """Return the states as if nothing but tool and bias made the reading."""
    return np.concatenate([np.zeros(6), x[6:]])


def _forgetful(states: Gaussian, model: PayloadModel, dt: float) -> Gaussian:
    """Keep a belief through contact; what motion left unexplained before says nothing after."""
    mean, cov = states.mean.copy(), states.cov + model.walk * dt
    mean[WRENCH], cov[WRENCH, :], cov[:, WRENCH] = 0.0, 0.0, 0.0
    cov[WRENCH, WRENCH] = model.floor
    return Gaussian(mean, cov)


def _open(main: Hypothesis, model: PayloadModel) -> Hypothesis:
    """Return the belief that the load has changed just now, from what was known before."""
    return Hypothesis(Gaussian(main.states.mean, main.states.cov + model.opening))


def _settled(change: Hypothesis, main: Hypothesis, model: PayloadModel) -> bool:
    """Whether a change counts from now on."""
    return (change.age >= LASTING and is_known(change.states, model)
            and _is_weight(change.states, main.states, model))


def is_known(states: Gaussian, model: PayloadModel) -> bool:
    """Whether the mass is known as well as asked for, as a share of the larger of both tools."""
    m = float(states.mean[MASS])
    most = model.accuracy * max(m, float(model.start.mean[MASS]))
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
    return not _tells(change, main) or abs(excess) < abs(excess + gained)


def _tells(change: Gaussian, main: Gaussian) -> bool:
    """Whether accelerations tell a payload of this mass from a push."""
    variance = change.cov[EXCESS, EXCESS] + main.cov[EXCESS, EXCESS]
    return bool(SURE * sqrt(variance) < abs(change.mean[MASS] - main.mean[MASS]))


_TO_TOOL = Function(lambda x: np.array([x[0], *(x[1:4] / x[0])]),
                    lambda x, dx: np.column_stack([
                        dx[:, 0], (x[1:4] + dx[:, 1:4]) / (x[0] + dx[:, :1]) - x[1:4] / x[0]]),
                    lambda x: np.eye(4))


def estimate(state: PayloadState, model: PayloadModel) -> ToolEstimate:
    """Say what hangs on the sensor; the standard error of its place by sigma points."""
    mean, cov = state.main.states
    tool = ukf.transform(Gaussian(mean[12:16], cov[12:16, 12:16]), _TO_TOOL)
    std = np.sqrt(tool.cov.diagonal())
    known = is_known(state.main.states, model)
    word, change = TRACKING if known else NOT_EXCITED, state.change
    suspected = suspected_std = nan
    if change is not None:
        word = FROZEN
        if change.age >= LASTING:
            suspected = float(change.states.mean[MASS] - mean[MASS])
            suspected_std = sqrt(change.states.cov[MASS, MASS])
            if not is_known(change.states, model):
                word = NOT_EXCITED
    return ToolEstimate(state.t, word, float(mean[MASS]), float(std[0]), mean[MOMENT] / mean[MASS],
                        std[1:], suspected, suspected_std)
