"""How well a rigid tool explains a recording: one robust fit, at rest and in motion alike.

With u = R^T g the gravity and a the acceleration of ft_sensor's origin, both in ft_sensor, the
wire reads

    F = m u - q (R^T a) - L q c_F + b_F                 L = [alpha]x + [omega]x^2
    T = q c_T x (u m / q - R^T a) - I alpha - omega x I omega + b_T

linear in weight m, inertial mass q, both first moments, inertia and biases. That weight and
inertia, and the two centres of mass, are free of each other is what tells units, time scales and
other points. Wrench and regressor pass the same low-pass. Forces and torques are two fits with
Student's t of two degrees of freedom (contacts are its tails), isotropic, so that the likelihood
does not depend on the axes.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.rigid_body import acceleration_of_slide, inertia_columns
from forcecal_ros.core.streams import PoseStream, Recording, Stream
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

STEP_S = 0.02
"""Means over so long are compared [s]; over longer in slow or long recordings."""

SMOOTHING_STEPS = 3.0
"""Standard deviation of the low-pass [steps]: 60 ms keep the motion of arms, and leave a
thousandth of a pose's noise in its second derivative."""

MAX_STEPS, MAX_ROWS = 20_000, 800
"""Steps of a long recording, and rows of one fit: 800 rows of three channels determine ten
unknowns to a fiftieth of the noise."""

TRUE_TO = 0.01
"""Share of the changes of its readings to which a sensor is true, by its data sheet: what leaves
less needs no other hypothesis."""

FREEDOM = 2.0
"""Degrees of freedom of Student's t: contact may be half of a recording."""


@dataclass(frozen=True)
class Motion:
    """
    Pose and wrench on one grid, one row a step or a static sample.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    R : ndarray, shape (n, 3, 3)
        R_base_sensor.
    position : ndarray, shape (n, 3), or None
        Of ft_sensor in base [m].
    wrench : ndarray, shape (n, 6)
        [N, N m]
    usable : ndarray of bool, shape (n,)
        Steps in which everything was sampled.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    step : float
        [s]; 0: static samples.
    part : ndarray of int, shape (n,), or None
        Parts of the recording that have a bias each.
    zeroed : ndarray of int, shape (n,), or None
        Row at which the wrench was last zeroed.
    free_gravity : bool
        Gravity may point anywhere in base.
    smoothing : float
        Time constant of a low-pass that the wrench has passed, or minus the length of a mean
        about each reading [s].
    extra : ndarray, shape (n, 3, k), or None
        Further columns of the forces.
    axes : ndarray, shape (3, 3), or None
        From true axes to those that were recorded.
    axes_std : float
        Standard error of their rotation [rad].
    displacement : ndarray, shape (n,), or None
        Of the tool along x of ft_sensor [m].
    """

    t: Array
    R: Array
    position: Array | None
    wrench: Array
    usable: NDArray[np.bool_]
    gravity: Array
    step: float
    part: NDArray[np.intp] | None = None
    zeroed: NDArray[np.intp] | None = None
    free_gravity: bool = False
    smoothing: float = 0.0
    extra: Array | None = None
    axes: Array | None = None
    axes_std: float = 0.0
    displacement: Array | None = None

    @property
    def in_sensor(self) -> Array:
        """Gravity in ft_sensor, shape (n, 3) [m/s^2]."""
        u = self.gravity @ self.R
        return np.asarray(u if self.zeroed is None else u - u[self.zeroed])


class Fit(NamedTuple):
    """
    One robust regression.

    Attributes
    ----------
    theta, std : ndarray, shape (k,)
    covariance : ndarray, shape (k, k)
        For effective samples.
    residual : ndarray, shape (n, 3)
    scale : float
        Of one channel's residual.
    floor : float
        To which the sensor is true.
    mean_log : float
        Log likelihood a row.
    effective : float
        Rows that are independent of each other.
    """

    theta: Array
    covariance: Array
    residual: Array
    scale: float
    floor: float
    mean_log: float
    effective: float

    def evidence(self, effective: float) -> float:
        """Log evidence (Schwarz) of so many independent rows."""
        return effective * self.mean_log - 0.5 * len(self.theta) * float(np.log(effective))

    @property
    def std(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class Explained(NamedTuple):
    """Force and torque of a recording as a rigid tool's, with the gravity in ft_sensor."""

    force: Fit
    torque: Fit
    mass: float
    mass_std: float
    moving: bool
    gravity: Array

    @property
    def com_by_force(self) -> tuple[Array, Array] | None:
        """Centre of mass by inertia, with its covariance; None: at rest [m]."""
        if not self.moving:
            return None
        q = self.force.theta[1]
        return self.force.theta[2:5] / q, self.force.covariance[2:5, 2:5] / q**2

    @property
    def com_by_torque(self) -> tuple[Array, Array]:
        """Centre of mass by torques, with its covariance [m]."""
        return self.torque.theta[:3] / self.mass, self.torque.covariance[:3, :3] / self.mass**2

    @property
    def inertial(self) -> tuple[float, float]:
        """Inertial mass over weight, with its standard error; 1 at rest."""
        if not self.moving:
            return 1.0, np.inf
        return float(self.force.theta[1] / self.mass), float(self.force.std[1] / abs(self.mass))


def on_grid(recording: Recording, gravity: Array) -> Motion | None:
    """
    Bring pose and wrench onto one grid; None where there are too few of them.

    Parameters
    ----------
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    """
    wrench, pose = recording.wrench, recording.pose
    if wrench is None or pose is None or min(len(wrench), len(pose)) < 3:
        return None
    period = max(float(np.median(np.diff(one.t))) for one in (wrench, pose))
    start, end = max(wrench.t[0], pose.t[0]), min(wrench.t[-1], pose.t[-1])
    if period > 0.2 or end - start < 50 * period:
        return _static(wrench, pose, gravity)
    step = max(STEP_S, period, (end - start) / MAX_STEPS)
    edges = np.arange(start, end, step)
    force, sampled = _means(wrench.t, wrench.values, edges)
    R, posed = _means(pose.t, pose.R_base_sensor.reshape(-1, 9), edges)
    position = None
    if pose.has_position:
        position, _ = _means(pose.t, pose.position - pose.position[0], edges)
    displacement, optidrive = None, recording.optidrive
    if optidrive is not None and len(optidrive) > 1:
        displacement = _means(optidrive.t, optidrive.values, edges)[0][:, 0]
    reach = int(np.ceil(2.0 * SMOOTHING_STEPS))
    usable = np.convolve(~(sampled & posed), np.ones(2 * reach + 1), 'same') == 0
    usable[:reach] = usable[-reach:] = False
    return Motion((edges[1:] + edges[:-1]) / 2.0, R.reshape(-1, 3, 3), position, force, usable,
                  gravity, step, displacement=displacement)


def _static(wrench: Stream, pose: PoseStream, gravity: Array) -> Motion:
    i = np.searchsorted(pose.t, wrench.t).clip(max=len(pose) - 1)
    i = np.where(np.abs(pose.t[i] - wrench.t) > np.abs(pose.t[i - 1] - wrench.t), i - 1, i)
    return Motion(wrench.t, pose.R_base_sensor[i], None, wrench.values,
                  np.isfinite(wrench.values).all(axis=1), gravity, 0.0)


def _means(t: Array, values: Array, edges: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Means between edges, moved to the middle of each; which have a sample near."""
    both = np.column_stack([t, values])
    at = np.searchsorted(t, edges)
    sums = np.vstack([np.zeros(both.shape[1]), np.cumsum(both - both[0], axis=0)])
    count = np.diff(at)
    means = np.diff(sums[at], axis=0)[count > 0] / count[count > 0, None] + both[0]
    middle = (edges[1:] + edges[:-1]) / 2.0
    near = np.convolve(count > 0, np.ones(5), 'same') > 0
    return np.stack([np.interp(middle, means[:, 0], column) for column in means[:, 1:].T],
                    axis=1), near


def _design(motion: Motion, scale: float) -> tuple[Array, Array, Array]:
    """
    Columns of forces (n, 3, j) and torques (n, 3, k); torques of a displacement by mass (n, 3).

    Parameters
    ----------
    scale : float
        Inertial mass over weight, by which accelerations enter the torques.
    """
    R, step, n = motion.R, motion.step, len(motion.t)
    u = motion.in_sensor
    weight = np.swapaxes(R, 1, 2) if motion.free_gravity else u[:, :, None]
    extra = [] if motion.extra is None else [motion.extra]
    if not step:
        return (np.concatenate([weight, *extra, biases(motion)], axis=2),
                np.concatenate([-skew(u), biases(motion)], axis=2), np.zeros((n, 3)))
    omega_x = np.swapaxes(R, 1, 2) @ np.gradient(R, step, axis=0)
    omega = np.stack([omega_x[:, 2, 1] - omega_x[:, 1, 2], omega_x[:, 0, 2] - omega_x[:, 2, 0],
                      omega_x[:, 1, 0] - omega_x[:, 0, 1]], axis=1) / 2.0
    alpha = np.gradient(omega, step, axis=0)
    accel = np.zeros((n, 3))
    if motion.position is not None:
        base = np.gradient(np.gradient(motion.position, step, axis=0), step, axis=0)
        accel = np.einsum('nij,ni->nj', R, base)
    displaced = np.zeros((n, 3))
    if motion.displacement is not None:
        accel = accel + acceleration_of_slide(motion.displacement, omega, alpha, step)
        displaced = np.cross(motion.displacement[:, None] * [1.0, 0.0, 0.0], u - scale * accel)
    W = skew(omega)
    columns = inertia_columns(alpha) + W @ inertia_columns(omega)
    late = -np.gradient(u, step, axis=0)
    force = [weight, -accel[:, :, None], -(skew(alpha) + W @ W), late[:, :, None], *extra]
    torque = [-skew(u - scale * accel), -columns]
    parts = [np.concatenate([_smoothed(np.concatenate(one, axis=2), motion.smoothing / step),
                             biases(motion)], axis=2) for one in (force, torque)]
    return parts[0], parts[1], _smoothed(displaced, motion.smoothing / step)


def _smoothed(values: Array, constant: float = 0.0) -> Array:
    """Low-pass along time; first by a time constant, or a mean of minus so many [steps]."""
    if constant < 0.0:
        values = uniform_filter1d(values, max(1, round(-constant)), axis=0)
    elif constant:
        from scipy.signal import lfilter  # takes a second to load, which a node does not need
        keep = np.exp(-1.0 / constant)
        values = lfilter([1.0 - keep], [1.0, -keep], values - values[0], axis=0) + values[0]
    return np.asarray(gaussian_filter1d(values, SMOOTHING_STEPS, axis=0, truncate=2.0))


def biases(motion: Motion) -> Array:
    """Return columns of a bias for each part, shape (n, 3, 3 k)."""
    part = np.zeros(len(motion.t), int) if motion.part is None else motion.part
    own = (part[:, None] == np.arange(part.max() + 1)).astype(float)
    return np.asarray(np.einsum('nk,ij->nikj', own, np.eye(3)).reshape(len(part), 3, -1))


def explain(motion: Motion) -> Explained | None:
    """Fit a rigid tool; None where fewer than three rows are usable."""
    rows = np.flatnonzero(motion.usable)
    if len(rows) < 3:
        return None
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MAX_ROWS)).astype(int)]
    wrench = _smoothed(motion.wrench) if motion.step else motion.wrench
    force, torque = wrench[rows, :3], wrench[rows, 3:]
    columns, _, _ = _design(motion, 1.0)
    weights = 3 if motion.free_gravity else 1
    fit = robust(columns[rows], force)
    mass, mass_std = float(fit.theta[0]), float(fit.std[0])
    if motion.free_gravity:
        g = np.linalg.norm(motion.gravity)
        mass = float(np.linalg.norm(fit.theta[:3]) / g)
        mass_std = float(np.linalg.norm(fit.std[:3]) / g)
        if mass:
            motion = replace(motion, gravity=fit.theta[:3] / mass)  # torques are of that weight
    elif mass < 0.0:  # no tool falls up: the boundary of what is possible
        bound = robust(columns[rows][:, :, weights:], force)
        fit = fit._replace(mean_log=bound.mean_log)
    moving = bool(motion.step) and motion.position is not None and bool(
        abs(fit.theta[weights]) > 5.0 * fit.std[weights] > 0.0)
    q = float(fit.theta[weights]) if moving else mass
    _, columns, displaced = _design(motion, float(np.clip(q / mass, 0.0, 1e4)) if mass else 1.0)
    torque = torque - mass * displaced[rows]
    return Explained(fit, robust(columns[rows], torque), mass, mass_std, moving,
                     motion.in_sensor[rows])


def robust(columns: Array, values: Array) -> Fit:
    """
    Fit values (n, 3) by columns (n, 3, k) with Student's t.

    The scale is at least :data:`TRUE_TO` of the changes of the values.
    """
    size = np.sqrt(np.einsum('nij,nij->j', columns, columns))
    size[size == 0.0] = 1.0
    X = columns / size
    n, _, k = X.shape
    floor = TRUE_TO * float(np.median(np.linalg.norm(values - np.median(values, 0), axis=1)))
    flat = X.reshape(3 * n, k)
    scale = 0.0
    ridge, weight, square = 1e-12 * np.eye(k), np.ones(n), np.ones(n)
    for i in range(30):
        before = scale
        weighted = (flat * np.repeat(weight / weight.mean(), 3)[:, None]).T
        theta = np.linalg.solve(weighted @ flat + ridge, weighted @ values.ravel())
        residual = values - X @ theta
        square = np.einsum('ni,ni->n', residual, residual) + 1e-300
        if i < 8:  # least absolute deviations lead near
            weight = 1.0 / np.sqrt(np.maximum(square, 1e-2 * np.median(square)))
            scale = float(np.median(square)) / 2.366  # of three Gaussian channels
            continue
        weight = (FREEDOM + 3.0) / (FREEDOM + square / scale)
        scale = float((weight * square).mean()) / 3.0
        if abs(scale - before) < 1e-4 * scale:
            break
    used = min(0.9, k / (3.0 * n))
    scale = scale / (1.0 - used)
    true = scale + floor**2 + 1e-300
    likelihood = -1.5 * np.log(true) - 0.5 * (FREEDOM + 3.0) * np.log1p(square / FREEDOM / true)
    mean_log = float(likelihood.mean()) * (1.0 - used) if np.ptp(values, axis=0).any() else 0.0
    effective = _effective(residual / np.sqrt(FREEDOM * true + square)[:, None])
    A = (flat * np.repeat(weight, 3)[:, None]).T @ flat / (scale + 1e-300)
    covariance = np.linalg.pinv(A, rcond=1e-12, hermitian=True) * n / effective
    return Fit(theta / size, covariance / np.outer(size, size), residual, float(np.sqrt(scale)),
               floor, mean_log, effective)


def _effective(values: Array) -> float:
    """Rows that are independent of each other, by the autocorrelation of residuals (n, 3)."""
    n = len(values)
    values = values - values.mean(axis=0)
    power = float((values**2).sum())
    total = 1.0
    for lag in range(1, n // 4):
        rho = float((values[lag:] * values[:-lag]).sum()) / max(power, 1e-300)
        if rho < 0.1:
            break
        total += 2.0 * rho
    return max(2.0, n / total)

