"""
Offset, sensitivity, delay and place of the accelerometer.

V(t + delay) = V0 + M f(t),     f = f_c + (alpha x + omega x omega x) (q - c)

While the robot stands, f = -g_S by the pose. While it moves freely, the force sensor says what
the tool feels, f_c = (b_F - F) / m whatever the tool's slide does: the regressor Y = u / m of
[Gamez2005] Eq. 17 on three axes, with u taken from the unloaded reading so that neither bias
nor taring enters. Moving through gravity spans what three poses cannot.

The regressor is noisy. Its noise is known from standstill, so what it adds to the normal
equations is taken off again (errors in variables). An AC-coupled sensor shows f less its own
low-passed past.
"""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.calibrate.accelerometer_model import (
    AccelerometerModel,
    DEFAULT_CUTOFF,
    fading,
    MotionBlocks,
    ToolPart,
)
from forcecal_ros.calibrate.estimating import jacobian, solve_score
from forcecal_ros.calibrate.residuals import Residuals
from forcecal_ros.calibrate.static_readings import gravity_spread
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import Autocovariance, noise_of_windows
import numpy as np
from scipy.optimize import minimize_scalar

_DELAY_STEP = 0.001
"""Step of the coarse search for the delay [s]."""


class AccelerometerFit(NamedTuple):
    """
    Result.

    Attributes
    ----------
    offset : ndarray, shape (3,)
        [V]
    matrix : ndarray, shape (3, 3)
        V = offset + matrix f [V/(m/s^2)].
    delay, cutoff : float
        [s], [Hz]; NaN where not estimated.
    position : ndarray, shape (3,)
        In ft_sensor [m]; NaN where not estimated.
    covariance : ndarray, shape (17, 17)
        Of offset, matrix (row by row), delay, cutoff, position; NaN where not estimated.
    noise : Autocovariance or None
        Of blocks of the volts; None where the poses were single samples.
    chi_square, degrees : float
        Of the residuals of the static poses' means by that noise.
    misfit : float
        The largest of these residuals [V].
    residuals : Residuals or None
        Of all blocks, moving and still [V]; times in blocks' lengths since the first.
    """

    offset: Array
    matrix: Array
    delay: float
    cutoff: float
    position: Array
    covariance: Array
    noise: Autocovariance | None
    chi_square: float
    degrees: int
    misfit: float
    residuals: Residuals | None = None


def identify_accelerometer(
        motion: MotionBlocks, volts: Callable[[float], Array], tool: ToolPart,
        coupling: str = 'dc', cutoff: float | None = None, place: Array | None = None,
        largest_delay: float = 0.02) -> AccelerometerFit:
    """
    Fit offset, sensitivity, delay and place to everything that moved freely or stood.

    Parameters
    ----------
    volts : callable
        Block means of the readings, shape (n, 3), the blocks shifted by a delay [s].
    coupling : str
        ``dc`` or ``ac``.
    cutoff : float, optional
        Corner of the high-pass where known [Hz].
    place : ndarray, shape (3,), optional
        Of the accelerometer where known [m].
    largest_delay : float
        [s]

    Raises
    ------
    UnobservableError
        The specific force did not span three directions.
    """
    model = AccelerometerModel(motion, volts, tool, coupling, cutoff, place)
    theta = _start(model, largest_delay)
    noise = _noise_at_standstill(model, model.residuals(theta, tool.vector))
    for _ in range(2):
        matrix = theta[3:12].reshape(3, 3)
        weight = model.weights(matrix, noise.covariance)
        theta, derivative = solve_score(
            # called before weight changes
            lambda p: model.score(p, tool.vector, weight),  # noqa: B023
            lambda p: model.slope(p, tool.vector, weight), theta)  # noqa: B023
        noise = _noise_at_standstill(model, model.residuals(theta, tool.vector))
    return _result(model, theta, derivative, weight, noise)


def _start(model: AccelerometerModel, largest_delay: float) -> Array:
    """Least squares for the linear unknowns, over a search of delay and cutoff."""
    layout = model.layout
    delay, cutoff = 0.0, model.known_cutoff or DEFAULT_CUTOFF
    _require_span(model, cutoff)
    search = layout.cutoff.stop > layout.cutoff.start
    if search:
        cutoff = _nearest_cutoff(model, delay)
    if model.tells_delay:
        delays = np.arange(-largest_delay, largest_delay + 1e-9, _DELAY_STEP)
        delay = min(delays, key=lambda d: _linear(model, d, cutoff)[1])
        if search:
            cutoff = _nearest_cutoff(model, delay)
    solution, _ = _linear(model, delay, cutoff)
    theta = np.zeros(layout.size)
    theta[:3], theta[3:12], theta[12] = solution[0], solution[1:4].T.ravel(), delay
    if model.ac:
        theta[layout.decay] = solution[4]
    theta[layout.cutoff] = cutoff
    return theta


def _columns(model: AccelerometerModel, cutoff: float) -> Array:
    specific_force = model.specific_force(model.tool.vector, np.zeros(3))
    columns = [np.ones(len(specific_force)), *model.high_passed(specific_force, cutoff).T]
    if model.ac:
        columns.append(fading(len(specific_force), model.motion.length, cutoff))
    return np.stack(columns, axis=1)


def _linear(model: AccelerometerModel, delay: float, cutoff: float) -> tuple[Array, float]:
    """Solve for offset, map and decay; return them and the mean square residual."""
    volts = model.volts(delay)
    whole = model.use & np.isfinite(volts).all(1)
    rows = _columns(model, cutoff)[whole]
    solution = np.linalg.lstsq(rows, volts[whole], rcond=None)[0]
    return solution, float(((volts[whole] - rows @ solution)**2).mean())


def _nearest_cutoff(model: AccelerometerModel, delay: float) -> float:
    """Search the corner over two decades, then closely."""
    def misfit(logarithm: float) -> float:
        return _linear(model, delay, float(np.exp(logarithm)))[1]

    grid = np.log(DEFAULT_CUTOFF) + np.linspace(-2.3, 2.3, 13)
    best = min(grid, key=misfit)
    step = grid[1] - grid[0]
    fit = minimize_scalar(misfit, bounds=(best - step, best + step), method='bounded',
                          options={'xatol': 1e-4})
    return float(np.exp(fit.x))


def _require_span(model: AccelerometerModel, cutoff: float) -> None:
    rows = _columns(model, cutoff)[model.use]
    if len(rows) < 20 or np.linalg.svd(
            rows / np.linalg.norm(rows, axis=0), compute_uv=False)[-1] < 1e-4:
        raise UnobservableError(
            "the accelerometer's map is not observable: gravity spans fewer than three "
            'directions of ft_sensor in the poses and the motion between them; add a pose')


def _noise_at_standstill(model: AccelerometerModel, residuals: Array) -> Autocovariance:
    """Noise of the volts' blocks as the residuals at standstill show it."""
    still = model.motion.still
    return noise_of_windows([
        np.where(model.use[still == i, None], residuals[still == i], np.nan)
        for i in range(still.max() + 1)])


def _result(model: AccelerometerModel, theta: Array, derivative: Array, weight: Array,
            noise: Autocovariance) -> AccelerometerFit:
    tool = model.tool
    matrix = theta[3:12].reshape(3, 3)
    X = weight @ model.derivatives(theta, tool.vector)
    by_force = model.motion.force_noise.mapped(matrix / tool.mass)
    meat = noise.covariance_of_sum(X) + by_force.covariance_of_sum(
        X * model.moving[:, None, None])
    inverse = np.linalg.inv(derivative)
    by_tool = -inverse @ jacobian(lambda v: model.score(theta, v, weight), tool.vector,
                                  np.array([1e-3] + [1e-2] * 3 + [1e-4] * 3))
    layout = model.layout
    # estimated, then the tool's own unknowns, so that position = lever + com carries both
    n = layout.size
    joint = np.zeros((n + 7, n + 7))
    joint[:n, :n] = inverse @ meat @ inverse.T + by_tool @ tool.covariance @ by_tool.T
    joint[:n, n:] = by_tool @ tool.covariance
    joint[n:, :n] = joint[:n, n:].T
    joint[n:, n:] = tool.covariance
    pick = np.full((17, n + 7), np.nan)
    pick[:12] = np.eye(12, n + 7)
    if model.tells_delay:
        pick[12] = np.eye(n + 7)[12]
    if layout.cutoff.stop > layout.cutoff.start:
        pick[13] = np.eye(n + 7)[layout.cutoff.start]
    position = np.full(3, np.nan)
    if model.place is not None:
        position = model.place
    elif model.lever:
        position = theta[layout.lever] + tool.com
        pick[14:] = np.eye(n + 7)[layout.lever] + np.eye(n + 7)[n + 4:]
    cutoff = model.split(theta)[5] if model.ac else np.nan
    return AccelerometerFit(
        theta[:3], matrix, float(theta[12]) if model.tells_delay else np.nan, cutoff,
        position, pick @ joint @ pick.T, noise, *_static_misfit(model, theta, noise),
        _residuals(model, theta, weight, noise))


def _residuals(model: AccelerometerModel, theta: Array, weight: Array, noise: Autocovariance
               ) -> Residuals:
    values = model.residuals(theta, model.tool.vector)
    variance = np.diagonal(np.linalg.inv(weight), axis1=1, axis2=2)
    sigma = np.sqrt(variance)
    inflation = noise.inflation.clip(min=float(model.motion.force_noise.inflation.max()))
    times = np.arange(len(values), dtype=np.float64) * model.motion.length
    return Residuals(times, values, np.broadcast_to(sigma, values.shape), inflation,
                     model.use)


def _static_misfit(model: AccelerometerModel, theta: Array, noise: Autocovariance
                   ) -> tuple[float, int, float]:
    """Chi-square of the static poses' mean residuals, how many numbers it sums, the largest."""
    residuals, still = model.residuals(theta, model.tool.vector), model.motion.still
    precision = np.linalg.inv(noise.at_least_white)
    total, means = 0.0, []
    for i in range(still.max() + 1):
        rows = residuals[model.use & (still == i)]
        if len(rows):
            mean = rows.mean(axis=0)
            means.append(mean)
            total += float(mean @ precision @ mean) * len(rows)
    return total, 3 * len(means), float(np.abs(means).max())


def identify_static_accelerometer(
        gravity: Array, volts: Array, condition: float = 100.0) -> AccelerometerFit:
    """
    Fit V = V0 - M g_S to the means of the static poses, [Gamez2005] Eq. 2 on three axes.

    Parameters
    ----------
    gravity : ndarray, shape (n, 3)
        In ft_sensor [m/s^2].
    volts : ndarray, shape (n, 3)
        Means; their covariance is taken from the residuals.
    condition : float
        Largest ratio of the first to the third spread of gravity.

    Returns
    -------
    AccelerometerFit
        Delay, cutoff and position not estimated.

    Raises
    ------
    UnobservableError
        Gravity does not span three directions about its mean.
    """
    n = len(gravity)
    spread, directions = gravity_spread(gravity)
    if n < 5 or spread[2] * condition < spread[0]:
        axis = int(np.argmax(np.abs(directions[2])))
        raise UnobservableError(
            f"the accelerometer's map is not observable from {n} static poses without motion "
            f'between them (condition {spread[0] / max(spread[2], 1e-12):.3g} > {condition:.3g}, '
            f'at least 5 poses wanted); add poses with gravity along {"xyz"[axis]} of ft_sensor')
    rows = np.column_stack([np.ones(n), -gravity])
    bread = np.linalg.inv(rows.T @ rows)
    solution = bread @ rows.T @ volts
    residuals = volts - rows @ solution
    noise = np.diag((residuals**2).sum(axis=0) / (n - 4))
    covariance = np.einsum('ab,ij->iajb', bread, noise)
    order = np.array([[i, 0] for i in range(3)]
                     + [[i, 1 + j] for i in range(3) for j in range(3)]).T
    full = np.full((17, 17), np.nan)
    full[:12, :12] = covariance[order[0][:, None], order[1][:, None], order[0], order[1]]
    nan = float('nan')
    return AccelerometerFit(solution[0], solution[1:].T, nan, nan, np.full(3, nan), full, None,
                            nan, 3 * n - 12, float(np.abs(residuals).max()))
