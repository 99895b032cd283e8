"""The model of [Ukf2025]: what a reading is made of, and how wrench and biases wander."""

from math import exp, inf
from typing import NamedTuple

from forcecal_ros.core.calibration import Calibration
from forcecal_ros.core.geometry import Array
from forcecal_ros.observe.filters.covariances import (
    Covariances,
    measured_covariances,
    paper_covariances,
)
from forcecal_ros.observe.filters.gaussian import Function, Gaussian, linear
from forcecal_ros.observe.settings import FilterSettings
import numpy as np
from scipy.special import chdtri


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


class BiasModel(NamedTuple):
    """
    All that filters ``ukf`` and ``ekf`` need besides their state, SI, ft_sensor.

    Attributes
    ----------
    unscented : bool
        ``ukf``, else ``ekf``.
    settings : FilterSettings
    bias : ndarray, shape (6,)
        Where the biases start; with six states, what they are.
    bias_cov, bias_walk : ndarray, shape (6, 6)
        At the start; gained in one second.
    covariances : Covariances
    contact : ContactModel
    """

    unscented: bool
    settings: FilterSettings
    bias: Array
    bias_cov: Array
    bias_walk: Array
    covariances: Covariances
    contact: ContactModel

    @property
    def augmented(self) -> bool:
        """Whether the biases are states."""
        return self.settings.states == 12


def bias_model(calibration: Calibration, unscented: bool, settings: FilterSettings,
               alpha_std: float) -> BiasModel:
    """
    Turn a calibration into the model of the running filter.

    Parameters
    ----------
    alpha_std : float
        Noise of the angular acceleration that the load is worked out from [rad/s^2].

    Raises
    ------
    ConfigError
        The calibration does not hold what the settings need.
    """
    covariances = (paper_covariances() if settings.covariances == 'paper' else
                   measured_covariances(calibration, settings.rise_time, alpha_std))
    std = np.nan_to_num(calibration.wrench_bias.std, nan=0.0)
    # a bias of which nothing is uncertain would leave a singular covariance
    bias_cov = np.diag(std ** 2) + _pair(*settings.bias_prior) + 1e-4 * covariances.R
    return BiasModel(
        unscented=unscented, settings=settings, bias=calibration.wrench_bias.value,
        bias_cov=bias_cov, bias_walk=_pair(*settings.bias_walk), covariances=covariances,
        contact=ContactModel(_pair(*settings.contact_floor),
                             float(chdtri(6, settings.false_alarm)),
                             settings.contact_window, settings.release_time))


def _pair(force: float, torque: float) -> Array:
    return np.diag([force ** 2] * 3 + [torque ** 2] * 3)


def start(model: BiasModel) -> Gaussian:
    """Return the belief before the first reading: no wrench, the calibration's biases."""
    P0 = model.covariances.P0
    if not model.augmented:
        return Gaussian(np.zeros(6), P0.copy())
    cov = np.zeros((12, 12))
    cov[:6, :6], cov[6:, 6:] = P0, model.bias_cov
    return Gaussian(np.concatenate([np.zeros(6), model.bias]), cov)


def relaxation(model: BiasModel, contact: bool) -> float:
    """
    Time in which the wrench is expected to return to zero [s].

    In contact it wanders freely; its biases are frozen then. Without biases it always does.
    """
    return inf if contact or not model.augmented else model.settings.relaxation


def transition(model: BiasModel, dt: float, contact: bool) -> tuple[Function, Array]:
    """
    Return how wrench and biases move in a period ``dt`` [s], and the covariance that adds.

    The wrench follows F' = exp(-dt/relaxation) F + w, the biases b' = b + w.
    """
    n = model.settings.states
    A, Q = np.eye(n), np.zeros((n, n))
    A[:6, :6] *= exp(-dt / relaxation(model, contact))
    Q[:6, :6] = model.covariances.Q * (dt / model.covariances.period)
    if model.augmented:
        Q[6:, 6:] = model.bias_walk * dt
    return linear(A), Q


_SUM = linear(np.hstack([np.eye(6), np.eye(6)]))


def measurement(model: BiasModel) -> Function:
    """
    Return what an unloaded reading is made of: y = F + b.

    [Ukf2025] measures F alone; weight and inertia, [m g; c x m g] and more, are off already.
    """
    return _SUM if model.augmented else linear(np.eye(6), model.bias)


def observability_rank(model: BiasModel, contact: bool) -> int:
    """
    Count the states that readings a millisecond apart determine.

    12 of 12 where F relaxes, 6 where both wander.
    """
    n = model.settings.states
    A = transition(model, 1e-3, contact)[0].jacobian(np.zeros(n))
    H = measurement(model).jacobian(np.zeros(n))
    rows = [H]
    for _ in range(n - 1):
        rows.append(rows[-1] @ A)
    return int(np.linalg.matrix_rank(np.vstack(rows)))
