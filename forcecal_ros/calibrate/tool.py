"""
The tool as static poses show it: how well its readings fit one tool, and single samples.

At rest and unloaded the wire reads, gravity g_S in ft_sensor and the tool slid by s along x,

    F = m g_S + b_F
    n = (c + s x_hat) x m g_S + b_n = m s (x_hat x g_S) - [g_S]x (m c) + b_n

which is linear in m, b_F, m c and b_n once s is known.
"""

from typing import NamedTuple

from forcecal_ros.calibrate.joint import AT_REST, JointFit, principal_spread
from forcecal_ros.calibrate.poses import require_wrench, StaticPose, values_in, window_mean
from forcecal_ros.calibrate.settings import IdentificationSettings
from forcecal_ros.checks.signals import resolution
from forcecal_ros.core.errors import below, DataError, UnobservableError
from forcecal_ros.core.estimation import robust_fit
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.noise.white import rounding_variance, white_covariance
from forcecal_ros.core.streams import Recording
import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc


class Statics(NamedTuple):
    """
    What was read in each static pose.

    Attributes
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    wrench : ndarray, shape (n, 6)
        Mean on the wire [N, N m].
    covariance : ndarray, shape (n, 6, 6), or None
        Of these means; None: not known, taken from the residuals.
    slide : ndarray, shape (n,)
        Mean displacement of the tool along x; zeros for a rigid one [m].
    slide_variance : ndarray, shape (n,)
        Of these means [m^2].
    """

    gravity: Array
    wrench: Array
    covariance: Array | None
    slide: Array
    slide_variance: Array


def read_statics(recording: Recording, poses: list[StaticPose], settings: IdentificationSettings
                 ) -> Statics:
    """
    Take the means of the static poses, [Gamez2005] Eq. 11 and Eq. 14 in all six axes.

    Returns
    -------
    Statics
        Without covariance.
    """
    wrench, optidrive = require_wrench(recording), settings.optidrive_of(recording)
    means = np.stack([window_mean(wrench, p.start, p.end, 'wrench') for p in poses])
    gravity, rigid = np.stack([p.gravity(settings.gravity) for p in poses]), np.zeros(len(poses))
    if optidrive is None or not len(optidrive):
        return Statics(gravity, means, None, rigid, rigid)
    slide = np.array([window_mean(optidrive, p.start, p.end, 'optidrive')[0] for p in poses])
    variance = rigid
    if parts := [part for part in values_in(optidrive, poses) if len(part) > 2]:
        density = max(float(white_covariance(part, 1)[0, 0]) for part in parts) / optidrive.rate
        variance = density / np.array([p.end - p.start for p in poses])
    return Statics(gravity, means, None, slide, variance)


def with_noise(statics: Statics, fit: JointFit, recording: Recording, poses: list[StaticPose]
               ) -> Statics:
    """Give static poses their covariance, and take off what the tool still moves in them."""
    assert fit.noise is not None
    spans = np.array([p.end - p.start for p in poses])
    covariance = fit.noise.at_least_white * (fit.blocks.length / spans)[:, None, None]
    wrench = require_wrench(recording)
    within = np.mean([part.var(axis=0) for part in values_in(wrench, poses) if len(part) > 1], 0)
    covariance = covariance + np.diag([
        rounding_variance(resolution(values), float(variance))
        for values, variance in zip(wrench.values.T, within)])
    left = np.stack([fit.residual[fit.blocks.pose == i].mean(axis=0) for i in range(len(poses))])
    return statics._replace(covariance=covariance, wrench=left + (
        design_of(statics)[0] @ fit.theta[AT_REST]).reshape(-1, 6))


def gravity_spread(gravity: Array) -> tuple[Array, Array]:
    """
    How far the poses turn gravity about in ft_sensor.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor, one row a pose [m/s^2].

    Returns
    -------
    spread : ndarray, shape (3,)
        Singular values about the mean, per root of poses, gravity taken as 1.
    directions : ndarray, shape (3, 3)
        Rows: the directions they belong to, in ft_sensor.
    """
    return principal_spread(gravity / np.linalg.norm(gravity, axis=1, keepdims=True))


def check_weight(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not tell the mass from the bias.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest reciprocal of the first spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    spread, _ = gravity_spread(gravity)
    n = len(gravity)
    if spread[0] < 1 / condition:
        raise UnobservableError(
            f'{n} static pose{"s" * (n > 1)} with gravity along one direction of ft_sensor '
            f'(spread {below(spread[0], 1 / condition, 2)}, required {1 / condition:g}): mass and '
            'bias cannot be separated; add a pose tilted by 90 deg about y of ft_sensor, and one '
            'about x')


def check_poses(gravity: Array, condition: float) -> None:
    """
    Refuse poses that do not determine mass, centre of mass and biases.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    condition : float
        Largest ratio of the first to the second spread.

    Raises
    ------
    UnobservableError
        Names what is short and the pose to add.
    """
    check_weight(gravity, condition)
    spread, directions = gravity_spread(gravity)
    if spread[1] * condition >= spread[0]:
        return
    mean = gravity.mean(axis=0) / np.linalg.norm(gravity, axis=1).mean()
    # across the line that gravity moves along, out of the plane it spans with the mean
    missing = np.cross(directions[0], mean)
    if np.linalg.norm(missing) < 1e-3:
        missing = directions[1]
    axis = int(np.argmax(np.round(np.abs(np.cross(mean, missing)), 3)))
    raise UnobservableError(
        f'centre of mass and torque bias are not observable from {len(gravity)} static poses: '
        'gravity varies along only one direction of ft_sensor (condition '
        f'{spread[0] / max(spread[1], 1e-12):.3g} > {condition:.3g}); add a pose tilted about '
        f'{"xyz"[axis]} of ft_sensor')


def refuse_negative(mass: float, wrench_sign: int | None = None) -> None:
    """
    Refuse a mass below zero: what is measured is the other body's wrench.

    Parameters
    ----------
    wrench_sign : int or None
        What the readings were multiplied by; None: 1.

    Raises
    ------
    DataError
    """
    other = -(wrench_sign or 1)
    if not mass > 0.0:
        raise DataError(f'the estimated mass is {mass:.4g} kg: the wrench has the opposite sign; '
                        f'set wrench.sign to {other} (--wrench-sign {other})')


X_HAT = np.array([1.0, 0.0, 0.0])


class ToolFit(NamedTuple):
    """
    Mass, biases and centre of mass, and the static poses beside them.

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


def tool_of_motion(fit: JointFit, statics: Statics) -> ToolFit:
    """
    Return the tool of a joint fit, and judge the static poses by it.

    Parameters
    ----------
    statics : Statics
        With covariance.
    """
    n, mass = len(statics.wrench), float(fit.theta[0])
    theta, C = fit.theta[AT_REST], fit.covariance[np.ix_(AT_REST, AT_REST)]
    design, reading = design_of(statics)
    assert statics.covariance is not None
    noise = block_diag(*(statics.covariance + mass**2 * slide_noise(statics)))
    residuals = reading - design @ theta
    lower = np.linalg.cholesky(noise)
    rows, right = np.linalg.solve(lower, design), np.linalg.solve(lower, reading)
    alone, _, rank, _ = np.linalg.lstsq(rows, right, rcond=1e-9)
    chi_square, degrees = float(((right - rows @ alone)**2).sum()), 6 * n - int(rank)
    chance = float(chdtrc(degrees, chi_square)) if degrees > 0 else np.nan
    # residuals less probable than this widen the errors, before they are improbable enough for a
    # warning: it costs one sound recording in a thousand errors that are 1.6 times too large
    widened = 1e-3
    if chance < widened:
        times = _left_over(residuals, noise, design, chi_square / degrees)
        # blocks of residuals show some of it already: no less than static poses alone would state
        stated = np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows, hermitian=True)))
        stated *= np.repeat([times[0], times[3]], [4, 6])
        wider = np.maximum(1.0, stated / np.sqrt(np.diag(C)))
        C = C * np.outer(wider, wider)
    return _tool(theta, C, statics, residuals, chi_square, chance, degrees)


def identify_tool(statics: Statics, condition: float = 100.0) -> ToolFit:
    """
    Fit mass, centre of mass and biases to static poses that are single samples.

    Parameters
    ----------
    condition : float
        See :func:`check_poses`.

    Raises
    ------
    UnobservableError
        The poses do not determine them.
    """
    check_poses(statics.gravity, condition)
    design, reading = design_of(statics)
    # so many degrees of freedom that every pose counts alike: least squares
    fit = robust_fit(design.reshape(-1, 6, 10), statics.wrench, freedom=1e9)
    return _tool(fit.theta, fit.covariance, statics, reading - design @ fit.theta, np.nan, np.nan,
                 len(reading) - 10)


def _tool(theta: Array, covariance: Array, statics: Statics, residuals: Array, chi_square: float,
          chance: float, degrees: int) -> ToolFit:
    """Turn mass, force bias, first moments and torque bias into a tool."""
    spread, _ = gravity_spread(statics.gravity)
    mass, com = float(theta[0]), theta[4:7] / theta[0]
    to_com = np.eye(10)
    to_com[4:7, 4:7] /= mass
    to_com[4:7, 0] = -com / mass
    return ToolFit(
        mass, theta[1:4], com, theta[7:10], to_com @ covariance @ to_com.T,
        residuals.reshape(-1, 6), chi_square, chance, degrees, spread,
        float(spread[0] / max(spread[1], 1e-12)))


def design_of(statics: Statics) -> tuple[Array, Array]:
    """Rows of the linear system in [m, b_F, m c, b_n], six a pose; readings."""
    n, g = len(statics.wrench), statics.gravity
    design = np.zeros((n, 6, 10))
    design[:, :3, 0] = g
    design[:, :3, 1:4] = design[:, 3:, 7:10] = np.eye(3)
    design[:, 3:, 4:7] = -skew(g)
    design[:, 3:, 0] = statics.slide[:, None] * np.cross(X_HAT, g)
    return design.reshape(6 * n, 10), statics.wrench.reshape(-1)


def slide_noise(statics: Statics) -> Array:
    """Return what noise of the slide adds to the covariance of each pose, by kg^2, (n, 6, 6)."""
    lever = np.cross(X_HAT, statics.gravity)
    noise = np.zeros((len(lever), 6, 6))
    noise[:, 3:, 3:] = (statics.slide_variance[:, None, None]
                        * lever[:, :, None] * lever[:, None, :])
    return noise


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
            f'the x axis of ft_sensor carries {share:.2g} of the weight at theta = {theta:.3g} '
            'rad, too little to estimate the mass; use a theta closer to 0')
    return float(abs(u_v - u_h) / (gravity * share))
