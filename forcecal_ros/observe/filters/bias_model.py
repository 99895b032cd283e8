"""The models of [Ukf2025]: what a reading is made of, and how wrench and biases wander."""

from math import exp, inf, sqrt
from typing import NamedTuple

from forcecal_ros.calibration.model import Calibration
from forcecal_ros.geometry import Array, skew
from forcecal_ros.observe.design import design
from forcecal_ros.observe.filters.covariances import (
    Covariances,
    measured_covariances,
    paper_covariances,
    PAPER_PERIOD,
)
from forcecal_ros.observe.filters.gaussian import Function, Gaussian, linear
from forcecal_ros.observe.settings import FilterSettings
from forcecal_ros.observe.settings import Settings as ObserverSettings
import numpy as np
from scipy.stats import chi2


class ContactModel(NamedTuple):
    """When contact is assumed; see :mod:`forcecal_ros.observe.filters.contact_test`."""

    floor: Array
    """Covariance of errors that are not contact, (6, 6)."""
    limit: float
    """Of a chi-square with 6 degrees of freedom."""
    window: float
    """[s]"""
    release_time: float
    """[s]"""


class Model(NamedTuple):
    """
    All the step needs besides its state, SI, ft_sensor.

    Attributes
    ----------
    settings : FilterSettings
    bias : ndarray, shape (6,)
        Where the biases start; with six states, what they are.
    bias_cov, bias_walk : ndarray, shape (6, 6)
        At the start; gained in one second.
    covariances : Covariances
    weight : ndarray, shape (6, 3)
        m [1; c x]: weight is ``weight @ g_sensor``.
    gravity : float
        [m/s^2]
    contact : ContactModel
    """

    settings: FilterSettings
    bias: Array
    bias_cov: Array
    bias_walk: Array
    covariances: Covariances
    weight: Array
    gravity: float
    contact: ContactModel

    @property
    def augmented(self) -> bool:
        """Whether the biases are states."""
        return self.settings.states == 12


def _covariances(calibration: Calibration, settings: FilterSettings,
                 observer: ObserverSettings) -> Covariances:
    if settings.covariances == 'paper':
        return paper_covariances()
    if settings.filter == 'static' and calibration.noise is None:
        unknown = np.full((6, 6), np.nan)
        return Covariances(unknown, unknown, unknown, PAPER_PERIOD)
    # what white noise leaves in the third state of a Butterworth filter
    density = observer.pose_rotation_std ** 2 / observer.pose_rate
    corner = design(calibration, observer).rotation_poles.real
    return measured_covariances(calibration, settings.rise_time, sqrt(density * corner ** 5 / 3))


def _pair(force: float, torque: float) -> Array:
    return np.diag([force ** 2] * 3 + [torque ** 2] * 3)


def model_from_calibration(calibration: Calibration, settings: FilterSettings = FilterSettings(),
                           observer: ObserverSettings = ObserverSettings()) -> Model:
    """
    Turn a calibration into the model of the running filter.

    Parameters
    ----------
    calibration : Calibration
    settings : FilterSettings
    observer : observe.Settings
        Of the observer that the load comes from: its pose filter adds noise.

    Returns
    -------
    Model

    Raises
    ------
    ConfigError
        The calibration does not hold what the settings need.
    """
    m, c = float(calibration.mass), calibration.com.value
    covariances = _covariances(calibration, settings, observer)
    std = np.nan_to_num(calibration.wrench_bias.std, nan=0.0)
    # a bias of which nothing is uncertain would leave a singular covariance
    bias_cov = np.diag(std ** 2) + _pair(*settings.bias_prior) + 1e-4 * covariances.R
    return Model(
        settings=settings, bias=calibration.wrench_bias.value, bias_cov=bias_cov,
        bias_walk=_pair(*settings.bias_walk), covariances=covariances,
        weight=m * np.vstack([np.eye(3), skew(c)]), gravity=calibration.gravity,
        contact=ContactModel(_pair(*settings.contact_floor),
                             float(chi2.isf(settings.false_alarm, 6)),
                             settings.contact_window, settings.release_time))


def start(model: Model) -> Gaussian:
    """
    Return the belief before the first reading: no wrench, the calibration's biases.

    Parameters
    ----------
    model : Model

    Returns
    -------
    Gaussian
        (6,) or (12,): wrench, biases.
    """
    P0 = model.covariances.P0
    if not model.augmented:
        return Gaussian(np.zeros(6), P0.copy())
    cov = np.zeros((12, 12))
    cov[:6, :6], cov[6:, 6:] = P0, model.bias_cov
    return Gaussian(np.concatenate([np.zeros(6), model.bias]), cov)


def relaxation(model: Model, contact: bool) -> float:
    """
    Time in which the wrench is expected to return to nil [s].

    Parameters
    ----------
    model : Model
    contact : bool
        In contact it wanders freely; its biases are frozen then. Without biases it always does.
    """
    return inf if contact or not model.augmented else model.settings.relaxation


def transition(model: Model, dt: float, contact: bool) -> tuple[Function, Array]:
    """
    Return how wrench and biases move in a period.

    The wrench follows F' = exp(-dt/relaxation) F + w, the biases b' = b + w.

    Parameters
    ----------
    model : Model
    dt : float
        [s]
    contact : bool

    Returns
    -------
    Function
    Q : ndarray, shape (6, 6) or (12, 12)
    """
    n = model.settings.states
    A, Q = np.eye(n), np.zeros((n, n))
    A[:6, :6] *= exp(-dt / relaxation(model, contact))
    Q[:6, :6] = model.covariances.Q * (dt / model.covariances.period)
    if model.augmented:
        Q[6:, 6:] = model.bias_walk * dt
    return linear(A), Q


_SUM = np.hstack([np.eye(6), np.eye(6)])


def measurement(model: Model, load: Array) -> Function:
    """
    Return what a reading is made of: y = F + b + load.

    [Ukf2025] measures the wrench; the load, [m g; c x m g] and inertia, is known here.

    Parameters
    ----------
    model : Model
    load : ndarray, shape (6,)
        Weight and inertia, wire sign [N, N m].

    Returns
    -------
    Function
    """
    if model.augmented:
        return linear(_SUM, load)
    return linear(_SUM[:, :6], load + model.bias)


def observability_rank(model: Model, dt: float, contact: bool) -> int:
    """
    Count the states that readings determine: 12 of 12 where F relaxes, 6 where both wander.

    Parameters
    ----------
    model : Model
    dt : float
        Period [s].
    contact : bool

    Returns
    -------
    int
    """
    n = model.settings.states
    A = transition(model, dt, contact)[0].jacobian(np.zeros(n))
    H = measurement(model, np.zeros(6)).jacobian(np.zeros(n))
    rows = [H]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(rows)))
