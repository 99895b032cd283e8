"""
The tool from static poses: its mass alone, and jointly with centre of mass and six biases.

At rest and unloaded the wire reads, gravity g_S in ft_sensor and the tool slid by s along x,

    F = m g_S + b_F
    n = (c + s x_hat) x m g_S + b_n = m s (x_hat x g_S) - [g_S]x (m c) + b_n

which is linear in m, b_F, m c and b_n once s is known. Without an Optidrive s = m g_x / k, and
m^2 / k is one more unknown.
"""

from typing import NamedTuple

from forcecal_ros.calibrate.static_readings import (
    check_poses,
    check_weight,
    gravity_spread,
    refuse_negative,
    Statics,
)
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array, skew
import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc

X_HAT = np.array([1.0, 0.0, 0.0])

WIDENED = 1e-3
"""Residuals less probable than this widen the errors, before they are improbable enough for a
warning: it costs one sound recording in a thousand errors that are 1.6 times too large."""

_NAMES = ('mass', 'force bias x', 'force bias y', 'force bias z', 'com x', 'com y', 'com z',
          'torque bias x', 'torque bias y', 'torque bias z', 'sag')


class ToolFit(NamedTuple):
    """
    Result of the static poses.

    Attributes
    ----------
    mass : float
        [kg]
    force_bias, com, torque_bias : ndarray, shape (3,)
        [N], [m], [N m]
    covariance : ndarray, shape (10, 10)
        Of mass, force bias, com, torque bias in this order; widened by what forces and torques
        leave over, each by its own, where that much is not chance.
    residuals : ndarray, shape (n, 6)
        Read minus fitted [N, N m].
    chi_square, probability : float
        Of the residuals by the noise, and how probable as much is; NaN where the noise was
        taken from the residuals themselves.
    degrees : int
        Readings minus unknowns.
    spread : ndarray, shape (3,)
        Singular values of the gravity directions about their mean, per root of poses.
    condition : float
        First over second of them; inf where gravity lies on one line.
    """

    mass: float
    force_bias: Array
    com: Array
    torque_bias: Array
    covariance: Array
    residuals: Array
    chi_square: float
    probability: float
    degrees: int
    spread: Array
    condition: float


def identify_tool(statics: Statics, condition: float = 100.0) -> ToolFit:
    """
    Fit mass, centre of mass and biases to all static poses at once.

    Parameters
    ----------
    condition : float
        See :func:`check_poses`.

    Raises
    ------
    UnobservableError
        The poses do not determine them.
    DataError
        The mass comes out negative.
    """
    check_poses(statics.gravity, condition)
    design, reading = design_of(statics)
    n = len(statics.wrench)
    degrees = 6 * n + (statics.sag is not None) - design.shape[1]
    if statics.covariance is None:
        theta, covariance = _fit_scatter(design, reading)
        chi_square = chance = np.nan
    else:
        theta, covariance, chi_square, chance = _fit_weighted(statics, design, reading)
    refuse_negative(theta[0])
    residuals = (reading - design @ theta)[:6 * n].reshape(n, 6)
    spread, _ = gravity_spread(statics.gravity)
    mass, com = float(theta[0]), theta[4:7] / theta[0]
    to_com = np.eye(10)
    to_com[4:7, 4:7] /= mass
    to_com[4:7, 0] = -com / mass
    return ToolFit(
        mass, theta[1:4], com, theta[7:10], to_com @ covariance[:10, :10] @ to_com.T, residuals,
        chi_square, chance, degrees, spread, float(spread[0] / spread[1]))


def design_of(statics: Statics) -> tuple[Array, Array]:
    """Rows of the linear system in [m, b_F, m c, b_n] (and m^2 / k), six a pose; readings."""
    n = len(statics.wrench)
    unobserved = statics.slide is None
    design = np.zeros((n, 6, 11 if unobserved else 10))
    g = statics.carried
    lever = np.cross(X_HAT, g)
    design[:, :3, 0] = g
    design[:, :3, 1:4] = design[:, 3:, 7:10] = np.eye(3)
    design[:, 3:, 4:7] = -skew(g)
    if statics.slide is None:
        design[:, 3:, 10] = g[:, :1] * lever
    else:
        design[:, 3:, 0] = statics.slide[:, None] * lever
    rows, reading = design.reshape(6 * n, -1), statics.wrench.reshape(-1)
    if statics.sag is not None:
        rows = np.vstack([rows, np.eye(rows.shape[1])[-1:]])
        reading = np.append(reading, statics.sag[0])
    return rows, reading


def slide_noise(statics: Statics) -> Array:
    """Return what noise of the slide adds to the covariance of each pose, by kg^2, (n, 6, 6)."""
    lever = np.cross(X_HAT, statics.gravity)
    noise = np.zeros((len(lever), 6, 6))
    noise[:, 3:, 3:] = (statics.slide_variance[:, None, None]
                        * lever[:, :, None] * lever[:, None, :])
    return noise


def _require_rank(design: Array) -> None:
    scaled = design / np.maximum(np.linalg.norm(design, axis=0), 1e-12)
    _, sigma, vh = np.linalg.svd(scaled, full_matrices=False)
    if len(design) < design.shape[1] or sigma[-1] < 1e-6 * sigma[0]:
        worst = _NAMES[int(np.argmax(np.abs(vh[-1])))]
        raise UnobservableError(
            f'{worst} is not observable from the static poses (condition '
            f'{sigma[0] / max(sigma[-1], 1e-16):.2g}); add poses that turn gravity to other '
            'directions of ft_sensor')


def _fit_weighted(statics: Statics, design: Array, reading: Array
                  ) -> tuple[Array, Array, float, float]:
    """
    Least squares, each channel weighted by its own noise; the slide's comes in by the mass.

    Returns the unknowns, their covariance, chi-square and how probable as much is.

    The covariance takes the noise as it is, correlated between channels. Weighing by measured
    correlations would make the fit follow the error of their measurement.
    """
    assert statics.covariance is not None
    mass = 0.0
    for _ in range(2):
        blocks = statics.covariance + mass**2 * slide_noise(statics)
        noise = block_diag(*blocks, *([[statics.sag[1]]] if statics.sag else []))
        weight = 1 / np.sqrt(np.diag(noise))
        rows, right = design * weight[:, None], reading * weight
        _require_rank(rows)
        theta = np.linalg.lstsq(rows, right, rcond=None)[0]
        mass = float(theta[0])
    bread = np.linalg.inv(rows.T @ rows) @ (rows * weight[:, None]).T
    residuals = reading - design @ theta
    chi_square = float(residuals @ np.linalg.solve(noise, residuals))
    degrees = len(reading) - design.shape[1]
    chance = float(chdtrc(degrees, chi_square)) if degrees > 0 else np.nan
    if chance < WIDENED:
        times = _left_over(residuals, noise, design, chi_square / degrees)
        noise = noise * np.outer(times, times)
    return theta, bread @ noise @ bread.T, chi_square, chance


def _left_over(residuals: Array, noise: Array, design: Array, whole: float) -> Array:
    """
    Say how many times as much as their noise readings leave over, by forces and by torques.

    A cable that turns the sensor says nothing of the mass. ``whole`` is chi-square of all by its
    degrees of freedom, for what has none of its own.
    """
    times = np.full(len(residuals), 1.0)
    for first in (0, 3):
        rows = np.flatnonzero(np.arange(len(residuals) // 6 * 6) // 3 % 2 == first // 3)
        degrees = len(rows) - int(np.any(design[rows], axis=0).sum())
        part = residuals[rows] @ np.linalg.solve(noise[np.ix_(rows, rows)], residuals[rows])
        times[rows] = np.sqrt(max(1.0, part / degrees if degrees > 0 else whole))
    return times


def _fit_scatter(design: Array, reading: Array) -> tuple[Array, Array]:
    """
    Least squares, forces and torques each weighted by their own scatter about the fit.

    The covariance takes the scatter of each of the six channels as it is found.
    """
    n = len(reading) // 6
    weight = np.ones(len(reading))
    for _ in range(3):
        rows = design * weight[:, None]
        _require_rank(rows)
        theta = np.linalg.lstsq(rows, reading * weight, rcond=None)[0]
        square = ((reading - design @ theta).reshape(n, 6)**2)
        scatter = np.repeat([square[:, :3].mean(), square[:, 3:].mean()], 3)
        weight = np.tile(1 / np.sqrt(np.maximum(scatter, 1e-18)), n)
    shortfall = 1 - design.shape[1] / len(reading)
    if shortfall <= 0:
        raise UnobservableError(f'{n} poses of one sample each leave nothing to judge the noise '
                                'by; add poses')
    bread = np.linalg.inv(rows.T @ rows)
    channel = np.tile(square.mean(axis=0), n) / shortfall
    meat = (rows * (weight * channel * weight)[:, None]).T @ rows
    return theta, bread @ meat @ bread


def mass_from_tilt(u_h: float, u_v: float, gravity: float, theta: float = 0.0) -> float:
    """
    Tool mass from the x force with x vertical (h) and with x horizontal (v), [Gamez2005] Eq. 16.

    Turning x of the sensor by theta about its own z before it is raised leaves it off the
    vertical by theta: it then carries only cos(theta) of the weight, and Eq. 16 as printed
    (theta = 0 here) is short by that factor.

    Parameters
    ----------
    u_h, u_v : float
        Mean force along x, Eq. 11 and Eq. 14 [N].
    gravity : float
        Magnitude [m/s^2].
    theta : float
        As in Eq. 9 [rad].

    Returns
    -------
    float
        [kg]

    Raises
    ------
    UnobservableError
        With that theta x is as good as horizontal in both poses.
    """
    share = abs(np.cos(theta))
    if share < 0.1:
        raise UnobservableError(
            f'x of ft_sensor carries {share:.2g} of the weight at theta = {theta:.3g} rad, '
            'too little to weigh with; take theta nearer to 0')
    return float(abs(u_v - u_h) / (gravity * share))


class Weight(NamedTuple):
    """
    Mass [kg] and force bias (3,) [N] from the forces alone.

    Attributes
    ----------
    force_bias : ndarray, shape (3,)
    covariance : ndarray, shape (4, 4)
    chi_square, degrees : float, int
        Of the residuals.
    """

    mass: float
    force_bias: Array
    covariance: Array
    chi_square: float
    degrees: int


def weigh(statics: Statics, condition: float = 100.0) -> Weight:
    """
    Fit mass and force bias to the forces of the static poses.

    Parameters
    ----------
    statics : Statics
        With covariance.
    condition : float
        See :func:`check_weight`.

    Raises
    ------
    UnobservableError, DataError
        As :func:`identify_tool`.
    """
    assert statics.covariance is not None
    check_weight(statics.gravity, condition)
    n = len(statics.gravity)
    design = np.zeros((n, 3, 4))
    design[:, :, 0] = statics.carried
    design[:, :, 1:] = np.eye(3)
    noise = block_diag(*statics.covariance[:, :3, :3])
    weight = 1 / np.diag(noise)
    rows, reading = design.reshape(3 * n, 4), statics.wrench[:, :3].ravel()
    bread = np.linalg.solve((rows * weight[:, None]).T @ rows, (rows * weight[:, None]).T)
    theta = bread @ reading
    refuse_negative(theta[0])
    residual = reading - rows @ theta
    return Weight(float(theta[0]), theta[1:], bread @ noise @ bread.T,
                  float(residual @ np.linalg.solve(noise, residual)), 3 * n - 4)
