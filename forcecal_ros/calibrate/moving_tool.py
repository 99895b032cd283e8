"""
The tool from motion: its inertia, and what static poses alone do not tell of its mass.

In free motion the wire's torque less that of the wire's force at the centre of mass is what
turns the tool:

    n - b_n - (c + s x_hat) x (F - b_F) = -(J alpha + omega x J omega)

Two directions of gravity are enough to weigh the tool, not to find its centre of mass. Any free
motion that turns it further is: the wire's own force is the load whose lever arm is sought,

    n = b_n + (c + s x_hat) x (F - b_F) - (J alpha + omega x J omega)

linear in b_n, c and the six elements of J.
"""

from typing import NamedTuple

from forcecal_ros.calibrate.estimating import jacobian
from forcecal_ros.calibrate.static_readings import gravity_spread, Statics
from forcecal_ros.calibrate.tool import ToolFit, Weight, X_HAT
from forcecal_ros.core.errors import UnobservableError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.kinematics import AngularMotion, smoothed
from forcecal_ros.core.noise.autocovariance import (
    Autocovariance,
    MOST_LAGS,
    noise_of_residuals,
    noise_of_windows,
)
import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

ELEMENTS = ('xx', 'yy', 'zz', 'xy', 'xz', 'yz')


class InertiaFit(NamedTuple):
    """
    Result.

    Attributes
    ----------
    elements : ndarray, shape (6,)
        J_xx, J_yy, J_zz, J_xy, J_xz, J_yz about the centre of mass [kg m^2].
    covariance : ndarray, shape (6, 6)
    weakest : ndarray, shape (6,)
        Combination of elements that the motion determines worst, of unit norm.
    """

    elements: Array
    covariance: Array
    weakest: Array

    @property
    def matrix(self) -> Array:
        """Shape (3, 3)."""
        return symmetric(self.elements)

    @property
    def std(self) -> Array:
        """Standard errors, shape (3, 3)."""
        return symmetric(np.sqrt(np.diag(self.covariance)))


def symmetric(e: Array) -> Array:
    """Return the matrix of elements xx, yy, zz, xy, xz, yz, shape (3, 3)."""
    return np.array([[e[0], e[3], e[4]], [e[3], e[1], e[5]], [e[4], e[5], e[2]]])


def inertia_regressor(omega: Array, alpha: Array) -> Array:
    """
    Matrix that turns the six elements of J into J alpha + omega x J omega.

    Parameters
    ----------
    omega, alpha : ndarray, shape (n, 3)
        In ft_sensor [rad/s], [rad/s^2].

    Returns
    -------
    ndarray, shape (n, 3, 6)
    """
    return _times(alpha) + skew(omega) @ _times(omega)


def _times(v: Array) -> Array:
    """Return (n, 3, 6) so that it times the elements of J is J v."""
    x, y, z = v.T
    o = np.zeros_like(x)
    return np.stack([np.stack([x, o, o, y, z, o], axis=1), np.stack([o, y, o, x, o, z], axis=1),
                     np.stack([o, o, z, o, x, y], axis=1)], axis=1)


def unexplained_torque(wrench: Array, slide: Array, tool: Array) -> Array:
    """
    Wire's torque less bias and less that of the wire's force at the centre of mass.

    Parameters
    ----------
    wrench : ndarray, shape (n, 6)
    slide : ndarray, shape (n,)
        Of the tool along x [m].
    tool : ndarray, shape (10,)
        Mass, force bias, com, torque bias.

    Returns
    -------
    ndarray, shape (n, 3)
        [N m]
    """
    lever = tool[4:7] + slide[:, None] * np.array([1.0, 0.0, 0.0])
    return np.asarray(wrench[:, 3:] - tool[7:10] - np.cross(lever, wrench[:, :3] - tool[1:4]))


def identify_inertia(
        wrench: Array, slide: Array, omega: Array, alpha: Array, free: NDArray[np.bool_],
        still: NDArray[np.intp], tool: Array, tool_covariance: Array) -> InertiaFit | None:
    """
    Fit the inertia to all blocks of free motion.

    Parameters
    ----------
    wrench : ndarray, shape (n, 6)
        Block means on the wire; NaN where missing.
    slide : ndarray, shape (n,)
        [m]
    omega, alpha : ndarray, shape (n, 3)
        In ft_sensor [rad/s], [rad/s^2].
    free, still : ndarray, shape (n,)
        Free motion; which static pose, -1 for none.
    tool, tool_covariance : ndarray, shapes (10,), (10, 10)
        Mass, force bias, com, torque bias.

    Returns
    -------
    InertiaFit or None
        None where the robot never turned the tool.
    """
    use = free & np.isfinite(wrench).all(1) & np.isfinite(slide) & np.isfinite(alpha).all(1)
    if use.sum() < 12:
        return None
    rows = -inertia_regressor(np.nan_to_num(omega), np.nan_to_num(alpha))
    smooth = smoothed(rows)
    torque = np.where(use[:, None], unexplained_torque(wrench, slide, tool), 0.0)
    still_torque = [unexplained_torque(wrench[still == i], slide[still == i], tool)
                    for i in range(still.max() + 1)]
    weight = np.linalg.inv(noise_of_windows(still_torque).covariance)
    weighted = np.where(use[:, None, None], weight @ smooth, 0.0)
    normal = np.einsum('nip,niq->pq', weighted, rows)
    # what noise of the orientation adds to the products, measured where there is nothing else
    at_rest = still >= 0
    normal -= use.sum() / at_rest.sum() * np.einsum(
        'nip,niq->pq', weight @ smooth[at_rest], rows[at_rest])
    sigma, vectors = np.linalg.eigh((normal + normal.T) / 2)
    if sigma[-1] <= 0 or sigma[0] < 1e-9 * sigma[-1]:
        return None
    inverse = np.linalg.inv(normal)
    elements = inverse @ np.einsum('nip,ni->p', weighted, torque)
    by_tool = inverse @ jacobian(
        lambda v: np.einsum('nip,ni->p', weighted, np.where(
            use[:, None], unexplained_torque(wrench, slide, v), 0.0)),
        tool, np.array([1e-3] * 4 + [1e-5] * 3 + [1e-3] * 3))
    noise = noise_of_windows([torque - smooth[still == i] @ elements
                              for i, torque in enumerate(still_torque)])
    covariance = inverse @ noise.covariance_of_sum(weighted) @ inverse.T \
        + by_tool @ tool_covariance @ by_tool.T
    return InertiaFit(elements, covariance, vectors[:, 0])


def identify_moving_tool(
        weight: Weight, statics: Statics, wrench: Array, slide: Array, turn: AngularMotion,
        free: NDArray[np.bool_], still: NDArray[np.intp], condition: float = 100.0
        ) -> tuple[ToolFit, InertiaFit]:
    """
    Fit centre of mass, torque bias and inertia to all blocks of free motion.

    The torque of the weight as the pose turns it tells the centre of mass, by instrumental
    variables: what else pulls at the tool does not turn with it. Standard errors are those of the
    noise at rest, or of what the motion leaves over where that is more.

    Parameters
    ----------
    weight : Weight
        From the static poses.
    wrench : ndarray, shape (n, 6)
        Block means on the wire; NaN where missing.
    slide : ndarray, shape (n,)
        Of the tool along x [m].
    free, still : ndarray, shape (n,)
        Free motion; which static pose, -1 for none.
    condition : float
        Largest ratio of the first to the second spread of gravity in the motion.

    Raises
    ------
    UnobservableError
        The motion does not tell them either.
    """
    use = free & np.isfinite(wrench).all(1) & np.isfinite(slide)
    _check_motion(turn, use, condition)
    turned = -inertia_regressor(turn.omega, turn.alpha)
    smooth = smoothed(turned)

    # a hand that leads the tool is a load with a lever of its own; gravity does not follow it
    hanging = -weight.mass * np.linalg.norm(statics.gravity[0]) * turn.R_base_sensor[:, 2]

    def rows_of(load: Array, inertial: Array) -> Array:
        return np.concatenate([np.broadcast_to(np.eye(3), (len(load), 3, 3)), -skew(load),
                               inertial], axis=2)

    def torque_of(bias: Array) -> Array:
        return np.asarray(wrench[:, 3:] - np.cross(slide[:, None] * X_HAT, wrench[:, :3] - bias))

    def fit(bias: Array, precision: Array) -> tuple[Array, Array, Array]:
        instruments = np.where(use[:, None, None], precision @ rows_of(hanging, smooth), 0.0)
        clean = np.nan_to_num(rows_of(wrench[:, :3] - bias, turned))
        normal = np.einsum('nip,niq->pq', instruments, clean)
        normal[6:, 6:] -= use.sum() * _standstill_product(precision @ smooth, turned, still)
        bread = np.linalg.inv(normal)
        torque = np.where(use[:, None], torque_of(bias), 0.0)
        return bread @ np.einsum('nip,ni->p', instruments, torque), bread, instruments

    def residual_of(theta: Array) -> Array:
        load = wrench[:, :3] - weight.force_bias
        return np.asarray(torque_of(weight.force_bias) - rows_of(load, smooth) @ theta)

    def still_residuals(theta: Array) -> list[Array]:
        residual = residual_of(theta)
        return [residual[still == i] for i in range(still.max() + 1)]

    theta, _, _ = fit(weight.force_bias, np.eye(3))
    precision = np.diag(1 / np.diag(noise_of_windows(still_residuals(theta)).covariance))
    theta, bread, instruments = fit(weight.force_bias, precision)
    by_bias = jacobian(lambda b: fit(b, precision)[0], weight.force_bias, np.full(3, 1e-2))
    noise = noise_of_windows(still_residuals(theta))
    covariance = bread @ noise.covariance_of_sum(instruments) @ bread.T
    misfit = noise_of_residuals(np.where(use[:, None], residual_of(theta), 0.0), MOST_LAGS,
                                int(use.sum()))
    covariance = _widened(covariance, bread @ misfit.covariance_of_sum(instruments) @ bread.T)
    shared = _shared(misfit, noise, hanging[use])
    covariance[:6, :6] += np.diag(np.repeat(shared, 3))
    covariance = covariance + by_bias @ weight.covariance[1:, 1:] @ by_bias.T
    tool = _tool_fit(weight, statics, theta, covariance, by_bias)
    _, vectors = np.linalg.eigh(np.linalg.inv(covariance[6:, 6:]))
    return tool, InertiaFit(theta[6:], covariance[6:, 6:], vectors[:, 0])


def _widened(by_noise: Array, by_misfit: Array) -> Array:
    """Widen a covariance to the errors that what a motion leaves over makes, where larger."""
    known = np.maximum(np.diag(by_noise), np.finfo(float).tiny)
    times = np.sqrt(np.maximum(1.0, np.where(
        np.diag(by_noise) > 0.0, np.diag(by_misfit) / known, 1.0)))
    return np.asarray(by_noise * np.outer(times, times))


def _shared(misfit: Autocovariance, noise: Autocovariance, load: Array) -> tuple[float, float]:
    """
    Return what a pull that lasts as long as the motion may do to torque bias and centre of mass.

    Of it there is one, as slow as the motion, and no average evens it out: what it leaves over
    beyond the noise, by the changes of a load (n, 3), is how far it may take a centre of mass.

    Returns
    -------
    float, float
        Variances [N^2 m^2], [m^2].
    """
    beyond = np.diag(misfit.covariance) - np.diag(noise.covariance)
    left = float(np.maximum(beyond, 0.0).mean())
    # two of three components of a load turn a lever
    return left, left / max(2.0 * float(load.var(axis=0).mean()), np.finfo(float).tiny)


def _standstill_product(smooth: Array, turned: Array, still: NDArray[np.intp]) -> Array:
    """Mean of what noise of the orientation alone adds to the normal equations."""
    at_rest = still >= 0
    return np.asarray(np.einsum('nip,niq->pq', smooth[at_rest], turned[at_rest]) / at_rest.sum())


def _check_motion(turn: AngularMotion, use: NDArray[np.bool_], condition: float) -> None:
    if use.sum() > 50:
        spread, _ = gravity_spread(-turn.R_base_sensor[use, 2])
        if spread[1] * condition >= spread[0]:
            return
    raise UnobservableError(
        'centre of mass and torque bias are not observable: gravity keeps to one line of '
        'ft_sensor in the static poses and in the motion between them; add a pose tilted about '
        'another axis of ft_sensor')


def _tool_fit(weight: Weight, statics: Statics, theta: Array, covariance: Array,
              by_bias: Array) -> ToolFit:
    """Put weight and lever together, with what they share through the force bias."""
    full = np.zeros((10, 10))
    full[:4, :4] = weight.covariance
    order = [7, 8, 9, 4, 5, 6]
    full[np.ix_(order, order)] = covariance[:6, :6]
    full[np.ix_(order, range(4))] = by_bias[:6] @ weight.covariance[1:]
    full[:4, 4:] = full[4:, :4].T
    load = weight.mass * statics.carried
    slide = statics.slide if statics.slide is not None else np.zeros(len(load))
    lever = theta[3:6] + slide[:, None] * X_HAT
    residuals = statics.wrench - np.concatenate(
        [load + weight.force_bias, np.cross(lever, load) + theta[:3]], axis=1)
    spread, _ = gravity_spread(statics.gravity)
    return ToolFit(
        weight.mass, weight.force_bias, theta[3:6], theta[:3], full, residuals,
        weight.chi_square, float(chdtrc(weight.degrees, weight.chi_square)), weight.degrees,
        spread, float(spread[0] / max(spread[1], 1e-12)))
