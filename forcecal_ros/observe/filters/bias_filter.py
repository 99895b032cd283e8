"""Filters ``ukf`` and ``ekf``: contact wrench and sensor biases together, after [Ukf2025].

A wrench F and biases b that both wander freely have rank 6 of 12: a reading shows their sum. So

- while contact is excluded, F is expected to return to zero within ``relaxation`` and what stays
  is bias: rank 12, the biases learn;
- while contact is assumed, F wanders freely, and the biases are frozen at what they were, their
  uncertainty still counted (Schmidt's filter): a steady push never becomes a bias.

A push too weak for the test (see :mod:`forcecal_ros.observe.filters.contact_test`) is read 6 %
short and does become bias, over a minute or more; the correlation of F and b in each sample says
how little the two can be told apart.
"""

from math import nan
from typing import Any, NamedTuple

from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters import gaussian, ukf
from forcecal_ros.observe.filters.bias_model import BiasModel, measurement, start, transition
from forcecal_ros.observe.filters.contact_test import assess, Contact, free_hypothesis, opened
from forcecal_ros.observe.filters.gaussian import (
    condition,
    Expected,
    Function,
    Gaussian,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.sample import ContactSample, Learned, NO_WRENCH, Wrench
from forcecal_ros.observe.status import INVALID, RESTARTED
from forcecal_ros.observe.unload import Unloaded
import numpy as np

LONGEST_PERIOD = 10.0
"""A pause counts as at most this long: all but the biases is forgotten by then, and covariances
that grew further would lose their digits [s]."""

_UNCORRELATED = np.zeros(6)


class Belief(NamedTuple):
    """
    What the filter remembers.

    Attributes
    ----------
    t : float
        Stamp of the last wrench that was used [s]; NaN before the first.
    states : Gaussian
        Wrench (6), or wrench and biases (12).
    contact : Contact
    """

    t: float
    states: Gaussian
    contact: Contact


def begin(model: BiasModel) -> Belief:
    """Return the belief before the first reading."""
    return Belief(nan, start(model), Contact())


def learn(memory: Any, reading: Unloaded, model: BiasModel) -> tuple[Belief, ContactSample]:
    """
    Take in one unloaded wrench: predict, test for contact, update.

    Never raises on a reading. The memory of another filter is as good as none.
    """
    belief = memory if isinstance(memory, Belief) else begin(model)
    if reading.status & INVALID:
        return belief, _sample(belief, reading, model)
    dt = reading.t - belief.t if belief.t == belief.t else model.covariances.period
    try:
        return _filter(belief, reading, min(dt, LONGEST_PERIOD), model)
    except NotPositiveDefinite:
        belief = begin(model)._replace(t=reading.t)
        return belief, _sample(
            belief, reading._replace(status=reading.status | RESTARTED), model)


def _filter(belief: Belief, reading: Unloaded, dt: float, model: BiasModel
            ) -> tuple[Belief, ContactSample]:
    y, R = np.array(reading.measured) + model.bias, model.covariances.R
    moved = predict(belief.states, *transition(model, dt, belief.contact.assumed))
    h = measurement(model)
    expected = expect(moved, h, R, model)
    contact, nis = assess(belief.contact, free_hypothesis(moved, expected, y, R), dt,
                          model.contact)
    frozen = slice(6, 12) if contact.assumed and model.augmented else None
    if frozen and not belief.contact.assumed:
        moved = opened(moved)
        expected = expect(moved, h, R, model)
    belief = Belief(reading.t, condition(moved, expected, y, frozen), contact)
    return belief, _sample(belief, reading, model, y - expected.mean, nis)


def expect(belief: Gaussian, h: Function, R: Array, model: BiasModel) -> Expected:
    """Foretell a reading by sigma points or by the Jacobian."""
    if model.unscented:
        return ukf.expect(belief, h, R, model.settings.scaling)
    return gaussian.expect(belief, h, R)


def _sample(belief: Belief, reading: Unloaded, model: BiasModel,
            innovation: Array | None = None, nis: float = nan) -> ContactSample:
    t, status, measured, inertial, _ = reading
    return ContactSample(
        t, wrench_tuple(belief.states.mean), status, measured,
        NO_WRENCH if innovation is None else wrench_tuple(innovation), inertial,
        learned_of(belief.states, belief.contact, nis, model))


def wrench_tuple(values: Array) -> Wrench:
    """Return the first six values as plain floats."""
    a, b, c, d, e, f = values[:6].tolist()
    return a, b, c, d, e, f


def learned_of(states: Gaussian, contact: Contact, nis: float, model: BiasModel) -> Learned:
    """Put together what a belief of 6 or 12 states says of itself."""
    mean, cov = states
    std = np.sqrt(cov.diagonal())
    if len(mean) == 12:
        bias, bias_std = mean[6:], std[6:]
        correlation = cov.diagonal(6) / (std[:6] * bias_std)
    else:
        bias, bias_std = model.bias, np.sqrt(model.bias_cov.diagonal())
        correlation = _UNCORRELATED
    return Learned(std[:6], bias, bias_std, correlation, nis, contact.assumed)
