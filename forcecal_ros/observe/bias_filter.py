"""
Filters ``ukf`` and ``ekf``: contact wrench and sensor biases together, after [Ukf2025].

With a known pose the model is linear, so both names run the same Kalman filter. A wrench F and
biases b that both wander freely have rank 6 of 12: a reading shows their sum. So

- while contact is excluded, F is expected to return to zero within 0.1 s and what stays is bias:
  rank 12, the biases learn;
- while contact is assumed, F wanders freely, and the biases are frozen at what they were, their
  uncertainty still counted (Schmidt's filter): a steady push never becomes a bias.

A push too weak for the test is read 6 % short and does become bias, over a minute or more; the
correlation of F and b in each sample shows how little the two can be separated.

The test for contact: under the hypothesis that nothing touches, a reading less load and bias is
noise: its Mahalanobis distance, the NIS of the hypothesis, is chi-square with 6 degrees of
freedom.
Two such tests run in parallel, on each reading for blows, and on an average over ``window`` for
a soft press. Both add the errors of weight and inertia (``floor``) to the noise, which do not
average out. The pose filter colours the noise of the pose: ``slow_noise`` is left of it in the
average.

Where [Ukf2025] leaves a choice open, this is ours:

- f and h. The paper prints neither; with h = identity the filter smooths the weight instead of
  removing it. Ours: y = F + b + load + v, load = weight and inertia of the tool.
- "Constant velocity" needs twelve more states than the paper has. Ours: a random walk, which
  returns to zero while contact is excluded.
- x0. The paper has both "the first reading" and zero. Ours: zero, since the first reading is
  mostly the weight; biases start from the calibration.
- n = 8 or 12. The paper lists b_f and b_m, two names of three numbers each. Ours: 12.
- Scale factors are no states: a scale on F cannot be separated from F. They belong into the
  calibration (``matrix``).
- Q, R, P0. The paper's R = 0.1 N^2 is a noise of 0.32 N: on a sensor that really is so noisy
  they give three times the errors of its own table. Ours: R is the covariance measured at rest,
  the accelerometer's part included; P0 of the biases the calibration's standard errors, of the
  wrench R, so that the first estimate is no raw reading; Q follows from the rise time. No free
  motion can show Q: it is the room left to contact.
"""

from collections.abc import Callable
from math import exp, log, nan
from typing import Any, NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.bandwidth import fast_share, noise_of_reading
from forcecal_ros.observe.gaussian import (
    condition,
    expect_linear,
    Expected,
    Gaussian,
    mahalanobis,
    NotPositiveDefinite,
    predict,
)
from forcecal_ros.observe.sample import (
    ContactSample,
    INVALID,
    Learned,
    NO_WRENCH,
    RESTARTED,
    Unloaded,
    Wrench,
)
from forcecal_ros.observe.settings import FilterSettings
import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

WRENCH, BIAS, MASS = slice(0, 6), slice(6, 12), 12
"""Where they are among the states; the mass where it is one."""

MAX_PERIOD_S = 10.0
"""A pause counts as at most this long: all but the biases is forgotten by then, and covariances
that grew further would lose their digits [s]."""


class ContactModel(NamedTuple):
    """When contact is assumed."""

    floor: Array
    """Covariance of errors that are not contact, (6, 6)."""
    slow_noise: Array
    """Covariance that the noise of the pose leaves in a mean over ``window``, (6, 6)."""
    limit: float
    """Of a chi-square with 6 degrees of freedom."""
    window: float
    """[s]"""
    release_time: float
    """[s]"""


class BiasModel(NamedTuple):
    """
    All that filters ``ukf`` and ``ekf`` need in addition to their state, SI, ft_sensor.

    Attributes
    ----------
    bias, bias_cov : ndarray, shape (6,), (6, 6)
        Where the biases start, and the covariance of that.
    R : ndarray, shape (6, 6)
        Covariance of one reading, and of the wrench before the first.
    walk : ndarray, shape (12, 12)
        Covariance that wrench and biases gain in one second.
    period : float
        Of the readings [s].
    contact : ContactModel
    """

    bias: Array
    bias_cov: Array
    R: Array
    walk: Array
    period: float
    contact: ContactModel


def bias_model(calibration: Calibration, settings: FilterSettings, pose_noise: Array,
               corner: float) -> BiasModel:
    """
    Turn a calibration into the model of the running filter.

    R is the noise of the force sensor, of the accelerometer and of the pose. Q = R k^2 / (1 - k)
    is the random walk whose stationary gain k gives the rise time, the same on all axes.

    Parameters
    ----------
    pose_noise : ndarray, shape (6, 6)
        Covariance of the load by the noise of the pose.
    corner : float
        Of the filter that follows the orientation, which colours that noise [rad/s].

    Raises
    ------
    ConfigError
        The calibration holds no noise.
    """
    noise = calibration.noise
    if noise is None or not noise.wrench_rate > 0:
        raise ConfigError('the calibration has no noise.wrench with its rate, so R is unknown; '
                          'calibrate again')
    rate = noise.wrench_rate
    R = noise_of_reading(calibration, noise)[0] + pose_noise
    k = 1 - exp(-log(9.0) / (settings.rise_time * rate))
    std = np.nan_to_num(calibration.wrench_bias.std, nan=0.0)
    # time over which a weak contact is averaged, and quiet after which contact counts as ended [s]
    window, release_time = 0.1, 0.2
    # probability that a sample without contact is called contact
    false_alarm = 1e-6
    return BiasModel(
        bias=calibration.wrench_bias.value,
        # a bias of which nothing is uncertain would leave a singular covariance
        bias_cov=np.diag(std ** 2) + pair(*settings.bias_prior) + 1e-4 * R,
        # wander of the biases [N/sqrt(s), N m/sqrt(s)]
        R=R, walk=block_diag(R * k * k / (1 - k) * rate, pair(4e-4, 4e-5)), period=1 / rate,
        contact=ContactModel(
            pair(*settings.contact_floor), (1 - fast_share(1 / window / corner)) * pose_noise,
            float(chdtri(6, false_alarm)), window, release_time))


def pair(force: float, torque: float) -> Array:
    """Return the covariance (6, 6) of standard deviations that are the same on three axes."""
    return np.diag([force ** 2] * 3 + [torque ** 2] * 3)


def expected_share(dt: float, contact: bool) -> float:
    """
    Return the share of a wrench that is expected to be left after ``dt`` [s].

    While contact is excluded it returns to zero; in contact it wanders freely.
    """
    # time in which it does [s]
    relaxation = 0.1
    return 1.0 if contact else exp(-dt / relaxation)


def transition(model: BiasModel, dt: float, contact: bool) -> tuple[Array, Array]:
    """Return how wrench and biases move in a period ``dt`` [s], and the covariance that adds."""
    A = np.eye(12)
    A[WRENCH, WRENCH] *= expected_share(dt, contact)
    return A, model.walk * dt


_SUM = np.hstack([np.eye(6), np.eye(6)])
"""An unloaded reading: y = F + b. [Ukf2025] measures F alone; weight and inertia are removed."""


class Contact(NamedTuple):
    """
    What the test remembers.

    Attributes
    ----------
    assumed : bool
        Whether contact is assumed.
    quiet : float
        Time since the tests last spoke of contact [s].
    average : ndarray, shape (6,)
        Of the residuals [N, N m].
    share : float
        Variance of the average over that of one residual.
    """

    assumed: bool = False
    quiet: float = 0.0
    average: Array = np.zeros(6)
    share: float = 0.0


def assess(contact: Contact, belief: Gaussian, expected: Expected, reading: Array, R: Array,
           dt: float, model: ContactModel) -> tuple[Contact, float]:
    """
    Test one reading for contact, ``dt`` [s] after the one before.

    The first six states are the wrench, which adds to the reading (6,): without contact it is
    taken out of what was expected. ``R`` (6, 6) is the covariance of the reading's noise.

    Returns
    -------
    Contact
    nis : float
        Of the hypothesis of no contact, this reading alone.

    Raises
    ------
    NotPositiveDefinite
        The covariance is none.
    """
    cross = expected.cross[:6, :6]
    residual = reading - expected.mean[:6] + belief.mean[:6]
    cov = expected.cov[:6, :6] - cross - cross.T + belief.cov[:6, :6]
    # what is no noise of this reading: that of the biases
    uncertainty = cov - R
    k = 1 - exp(-dt / model.window)
    average = contact.average + k * (residual - contact.average)
    share = (1 - k) ** 2 * contact.share + k * k
    blow = mahalanobis(residual, cov + model.floor)
    push = mahalanobis(average, share * R + uncertainty + model.floor + model.slow_noise)
    nis = mahalanobis(residual, cov)
    if max(blow, push) > model.limit:
        return Contact(True, 0.0, average, share), nis
    quiet = contact.quiet + dt
    # half a period of slack: how stamps were rounded must not decide
    held = contact.assumed and quiet + dt / 2 < model.release_time
    return Contact(held, quiet, average, share), nis


def take_reading(states: Gaussian, expect: Callable[[Gaussian], Expected], reading: Array,
                 R: Array, contact: Contact, dt: float, model: ContactModel, learns: slice
                 ) -> tuple[Gaussian, Contact, Expected, float]:
    """
    Test a reading for contact, ``dt`` [s] after the one before, and take it in.

    At the onset of contact a wrench of any size may have come up. The biases are frozen from
    there on: where little is known of them yet, a wrench thought to be small would take a second
    to follow, for all that time suspecting the bias.

    Parameters
    ----------
    states : Gaussian
        Wrench (6), its biases (6) and others.
    reading : ndarray, shape (k,)
        A wrench, then what else was read; ``R`` (6, 6) is the covariance of the wrench's noise.
    learns : slice
        States that only readings without contact may teach.

    Returns
    -------
    states : Gaussian
    contact : Contact
    expected : Expected
        The reading before it was taken.
    nis : float
        Of the hypothesis of no contact.
    """
    expected = expect(states)
    after, nis = assess(contact, states, expected, reading[:6], R, dt, model)
    if after.assumed and not contact.assumed:
        cov = states.cov.copy()
        # at the onset the wrench is held for that many times as uncertain, in variance, as its
        # bias: then what came up is read as wrench (91 % of it at once), not as bias
        cov[WRENCH, WRENCH] += 10.0 * cov[BIAS, BIAS]
        states = Gaussian(states.mean, cov)
        expected = expect(states)
    frozen = learns if after.assumed else None
    return condition(states, expected, reading, frozen), after, expected, nis


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
    """Return the belief before the first reading: no wrench, the calibration's biases."""
    return Belief(nan, Gaussian(np.concatenate([np.zeros(6), model.bias]),
                                block_diag(model.R, model.bias_cov)), Contact())


def learn(memory: Any, reading: Unloaded, model: BiasModel) -> tuple[Belief, ContactSample]:
    """
    Take in one unloaded wrench: predict, test for contact, update.

    Never raises on a reading. The memory of another filter is as good as none.
    """
    belief = memory if isinstance(memory, Belief) else begin(model)
    t, status, measured, inertial, _ = reading
    innovation, nis = NO_WRENCH, nan
    if not status & INVALID:
        dt = min(t - belief.t, MAX_PERIOD_S) if belief.t == belief.t else model.period
        y = np.array(measured) + model.bias
        try:
            states, contact, expected, nis = take_reading(
                predict(belief.states, *transition(model, dt, belief.contact.assumed)),
                lambda states: expect_linear(states, _SUM, 0.0, model.R), y, model.R,
                belief.contact, dt, model.contact, BIAS)
            belief = Belief(t, states, contact)
            innovation = wrench_tuple(y - expected.mean)
        except NotPositiveDefinite:
            belief, status = begin(model)._replace(t=t), status | RESTARTED
    return belief, ContactSample(
        t, wrench_tuple(belief.states.mean), status, measured, innovation, inertial,
        learned_of(belief.states, belief.contact, nis))


def wrench_tuple(values: Array) -> Wrench:
    """Return the first six values as plain floats."""
    a, b, c, d, e, f = values[:6].tolist()
    return a, b, c, d, e, f


def learned_of(states: Gaussian, contact: Contact, nis: float) -> Learned:
    """Put together the quality of a belief of 12 states."""
    mean, cov = states
    std = np.sqrt(cov.diagonal())
    return Learned(std[WRENCH], mean[BIAS], std[BIAS],
                   cov.diagonal(6) / (std[WRENCH] * std[BIAS]), nis, contact.assumed)
