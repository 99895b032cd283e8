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
from functools import cached_property
from typing import Any, NamedTuple

from forcecal_ros.core.estimation import robust_fit
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

MAX_STEPS, MAX_ROWS = 20_000, 400
"""Steps of a long recording, and rows of one fit: 400 rows of three channels determine ten
unknowns to a thirtieth of the noise."""

TRUE_TO = 0.01
"""Share of the changes of its readings to which a sensor is true, by its data sheet: what leaves
less needs no other hypothesis."""

FREEDOM = 2.0
"""Degrees of freedom of Student's t: contact may be half of a recording."""


class Columns(NamedTuple):
    """
    What multiplies the unknowns in each row of a path, low-passed.

    Attributes
    ----------
    gravity : ndarray, shape (n, 3, 3)
        From gravity in base to ft_sensor.
    late : ndarray, shape (n, 3, 3)
        Minus its derivative; this and all below are 0 for static samples.
    accel : ndarray, shape (n, 3)
        Of ft_sensor in itself [m/s^2].
    lever : ndarray, shape (n, 3, 3)
        Acceleration of a place by the place [1/s^2].
    inertia : ndarray, shape (n, 3, 6)
        Torque by inertia.
    displaced : ndarray, shape (n, 3, 3)
        From gravity to torque by mass of a displaced tool [m].
    displaced_accel : ndarray, shape (n, 3)
        The same of accelerations [m^2/s^2].
    """

    gravity: Array
    late: Array
    accel: Array
    lever: Array
    inertia: Array
    displaced: Array
    displaced_accel: Array


@dataclass(frozen=True)
class Path:
    """
    How ft_sensor moves on a grid, one row a step or a static sample.

    Attributes
    ----------
    R : ndarray, shape (n, 3, 3)
        R_base_sensor.
    position : ndarray, shape (n, 3), or None
        Of ft_sensor in base [m].
    step : float
        [s]; 0: static samples.
    displacement : ndarray, shape (n,), or None
        Of the tool along x of ft_sensor [m].
    zeroed : ndarray of int, shape (n,), or None
        Row at which the wrench was last zeroed.
    smoothing : float
        Time constant of a low-pass that the wrench has passed, or minus the length of a mean
        about each reading [s].
    """

    R: Array
    position: Array | None
    step: float
    displacement: Array | None = None
    zeroed: NDArray[np.intp] | None = None
    smoothing: float = 0.0

    @property
    def from_base(self) -> Array:
        """Matrices from gravity in base to what it does to a wrench in ft_sensor, (n, 3, 3)."""
        Rt = np.swapaxes(self.R, 1, 2)
        return Rt if self.zeroed is None else Rt - Rt[self.zeroed]

    @cached_property
    def columns(self) -> Columns:
        """Of all rows."""
        R, step, n, W = self.R, self.step, len(self.R), self.from_base
        if not step:
            flat = np.zeros((n, 3, 6))
            return Columns(W, flat[..., :3], flat[..., 0], flat[..., :3], flat, flat[..., :3],
                           flat[..., 0])
        omega_x = np.swapaxes(R, 1, 2) @ np.gradient(R, step, axis=0)
        omega = np.stack([omega_x[:, 2, 1] - omega_x[:, 1, 2],
                          omega_x[:, 0, 2] - omega_x[:, 2, 0],
                          omega_x[:, 1, 0] - omega_x[:, 0, 1]], axis=1) / 2.0
        alpha = np.gradient(omega, step, axis=0)
        accel, slide = np.zeros((n, 3)), np.zeros((n, 3, 3))
        if self.position is not None:
            base = np.gradient(np.gradient(self.position, step, axis=0), step, axis=0)
            accel = np.einsum('nij,ni->nj', R, base)
        if self.displacement is not None:
            accel = accel + acceleration_of_slide(self.displacement, omega, alpha, step)
            slide = skew(self.displacement[:, None] * [1.0, 0.0, 0.0])
        about = skew(omega)
        parts = (W, -np.gradient(W, step, axis=0), accel[:, :, None],
                 skew(alpha) + about @ about,
                 -(inertia_columns(alpha) + about @ inertia_columns(omega)),
                 slide @ W, slide @ accel[:, :, None])
        low = _smoothed(np.concatenate(parts, axis=2), self.smoothing / step)
        gravity, late, a, lever, inertia, displaced, by_accel = np.split(
            low, np.cumsum([part.shape[2] for part in parts])[:-1], axis=2)
        return Columns(gravity, late, a[..., 0], lever, inertia, displaced, by_accel[..., 0])


@dataclass(frozen=True)
class Motion:
    """
    Path and wrench on one grid.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    path : Path
    wrench : ndarray, shape (n, 6)
        [N, N m]
    usable : ndarray of bool, shape (n,)
        Steps in which everything was sampled.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    part : ndarray of int, shape (n,), or None
        Parts of the recording that have a bias each.
    free_gravity : bool
        Gravity may point anywhere in base.
    extra, extra_torque : ndarray, shape (n, 3, k), or None
        Further columns of the forces, and of the torques.
    axes : ndarray, shape (3, 3), or None
        From true axes to those that were recorded.
    levers : ndarray, shape (3, 3), or None
        By which torques show forces beside those of the centre of mass [m].
    arm : float
        At which the weight acts [m].
    axes_std : float
        Standard error of their rotation [rad].
    """

    t: Array
    path: Path
    wrench: Array
    usable: NDArray[np.bool_]
    gravity: Array
    part: NDArray[np.intp] | None = None
    free_gravity: bool = False
    extra: Array | None = None
    extra_torque: Array | None = None
    axes: Array | None = None
    levers: Array | None = None
    arm: float = 1.0
    axes_std: float = 0.0

    @property
    def R(self) -> Array:
        """R_base_sensor, shape (n, 3, 3)."""
        return self.path.R

    @property
    def step(self) -> float:
        """Of the grid [s]; 0: static samples."""
        return self.path.step

    @property
    def in_sensor(self) -> Array:
        """Gravity in ft_sensor, shape (n, 3) [m/s^2]."""
        return np.asarray(self.path.from_base @ self.gravity)

    def smoothed(self, values: Array, like_wrench: bool = False) -> Array:
        """Low-pass rows on a grid; columns ``like_wrench`` first as the wrench was."""
        if not self.step:
            return values
        return _smoothed(values, like_wrench * self.path.smoothing / self.step)

    def along(self, **changes: Any) -> 'Motion':
        """Return the same along another path."""
        return replace(self, path=replace(self.path, **changes))


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
    mean_log, room : float
        Log likelihood a row, and by how much it could be more at best.
    effective : float
        Rows that are independent of each other.
    """

    theta: Array
    covariance: Array
    residual: Array
    scale: float
    floor: float
    mean_log: float
    room: float
    effective: float

    def evidence(self, effective: float) -> float:
        """Log evidence (Schwarz) of so many independent rows."""
        return effective * self.mean_log - 0.5 * len(self.theta) * float(np.log(effective))

    @property
    def std(self) -> Array:
        """Standard errors, shape (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class Explained(NamedTuple):
    """
    Force and torque of a recording as a rigid tool's, with the gravity in ft_sensor.

    The torque is that of a tool whose inertia is ``times`` that of its weight: the ratio that the
    force shows, or 1 if that fits the torque better, where a cable or contact spoils the force.
    """

    force: Fit
    torque: Fit
    mass: float
    mass_std: float
    moving: bool
    gravity: Array
    times: float

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
    return Motion((edges[1:] + edges[:-1]) / 2.0, Path(
        R.reshape(-1, 3, 3), position, step, displacement), force, usable, gravity)


def _static(wrench: Stream, pose: PoseStream, gravity: Array) -> Motion:
    i = np.searchsorted(pose.t, wrench.t).clip(max=len(pose) - 1)
    i = np.where(np.abs(pose.t[i] - wrench.t) > np.abs(pose.t[i - 1] - wrench.t), i - 1, i)
    return Motion(wrench.t, Path(pose.R_base_sensor[i], None, 0.0), wrench.values,
                  np.isfinite(wrench.values).all(axis=1), gravity)


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


class Pull(NamedTuple):
    """
    Forces of a recording as a rigid tool's.

    Attributes
    ----------
    force : Fit
    mass, mass_std : float
        By weight [kg].
    inertial : float
        Inertial mass over weight; 1 where the motion does not show it.
    moving : bool
        Whether it does.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    """

    force: Fit
    mass: float
    mass_std: float
    inertial: float
    moving: bool
    gravity: Array


def explain_forces(motion: Motion) -> Pull:
    """Fit the forces of a rigid tool."""
    rows, g, of_path = usable_rows(motion), motion.gravity, motion.path.columns
    force, down = motion.smoothed(motion.wrench[:, :3])[rows], of_path.gravity[rows]
    weight = down if motion.free_gravity else (down @ g)[:, :, None]
    columns = [biases(motion)[rows]]
    if motion.extra is not None:
        columns.insert(0, motion.smoothed(motion.extra, True)[rows])
    if motion.step:
        columns = [-of_path.accel[rows, :, None], -of_path.lever[rows],
                   (of_path.late[rows] @ g)[:, :, None], *columns]
    fit = fit_part(np.concatenate([weight, *columns], axis=2), force)
    mass, mass_std = float(fit.theta[0]), float(fit.std[0])
    if motion.free_gravity:
        size = float(np.linalg.norm(g))
        mass = float(np.linalg.norm(fit.theta[:3])) / size
        mass_std = float(np.linalg.norm(fit.std[:3])) / size
        g = fit.theta[:3] / mass if mass else g
    elif mass < 0.0:  # no tool falls up: the boundary of what is possible
        fit = fit._replace(mean_log=fit_part(np.concatenate(columns, axis=2), force).mean_log)
    k = weight.shape[2]
    moving = bool(motion.step) and motion.path.position is not None and bool(
        abs(fit.theta[k]) > 5.0 * fit.std[k] > 0.0)
    times = float(np.clip(fit.theta[k] / mass, 0.0, 1e4)) if moving and mass else 1.0
    return Pull(fit, mass, mass_std, times, moving, g)


def explain(motion: Motion) -> Explained | None:
    """Fit a rigid tool; None where fewer than three rows are usable."""
    if motion.usable.sum() < 3:
        return None
    rows, pull = usable_rows(motion), explain_forces(motion)
    at, g = Columns(*(part[rows] for part in motion.path.columns)), pull.gravity
    torque = motion.smoothed(motion.wrench[:, 3:])[rows]
    columns = [biases(motion)[rows]]
    if motion.step:
        columns.insert(0, at.inertia)
    if motion.extra_torque is not None:
        columns.insert(0, motion.smoothed(motion.extra_torque, True)[rows])

    def by(times: float) -> Fit:
        pulls = pull.mass * (at.displaced @ g - times * at.displaced_accel)
        return fit_part(np.concatenate(
            [-skew(at.gravity @ g - times * at.accel), *columns], axis=2), torque - pulls)
    fits = {times: by(times) for times in (pull.inertial, 1.0)}
    times = max(fits, key=lambda one: fits[one].mean_log)
    return Explained(pull.force, fits[times], pull.mass, pull.mass_std, pull.moving,
                     replace(motion, gravity=g).in_sensor[rows], times)


def by_any_matrix(motion: Motion) -> Fit:
    """Fit forces by gravity times any matrix: its axes and gains do not matter."""
    rows = usable_rows(motion)
    u = motion.path.columns.gravity[rows] @ motion.gravity
    columns = np.concatenate([np.kron(np.eye(3), u[:, None, :]), biases(motion)[rows]], axis=2)
    return fit_part(columns, motion.smoothed(motion.wrench[:, :3])[rows])


def usable_rows(motion: Motion, most: int = MAX_ROWS) -> NDArray[np.intp]:
    """Return so many of the usable rows at most, evenly spread."""
    rows = np.flatnonzero(motion.usable)
    return np.asarray(rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)])


def fit_part(columns: Array, values: Array) -> Fit:
    """
    Fit forces or torques (n, 3) by columns (n, 3, k) with Student's t.

    The scale is at least :data:`TRUE_TO` of the changes of the values.
    """
    n, _, k = columns.shape
    fit = robust_fit(columns, values, tolerance=1e-3, freedom=FREEDOM)
    residual = fit.residual.reshape(n, 3)
    square = np.einsum('ni,ni->n', residual, residual)
    floor = TRUE_TO * float(np.median(np.linalg.norm(values - np.median(values, 0), axis=1)))
    used = min(0.9, k / (3.0 * n))
    scale = float(fit.scale[0, 0])**2 / (1.0 - used)
    true = scale + floor**2 + 1e-300
    likelihood = -1.5 * np.log(true) - 0.5 * (FREEDOM + 3.0) * np.log1p(square / FREEDOM / true)
    mean_log, room = 0.0, 0.0
    if np.ptp(values, axis=0).any():
        mean_log = float(likelihood.mean()) * (1.0 - used)
        room = -1.5 * float(np.log(floor**2 + 1e-300)) - mean_log
    effective = _effective(residual / np.sqrt(FREEDOM * true + square)[:, None])
    size = np.sqrt(np.einsum('nij,nij->j', columns, columns))
    size[size == 0.0] = 1.0
    weight = (FREEDOM + 3.0) / (FREEDOM * scale + square + 1e-300)
    X = columns / size
    A = (X * weight[:, None, None]).reshape(-1, k).T @ X.reshape(-1, k)
    covariance = np.linalg.pinv(A, rcond=1e-12, hermitian=True) * n / effective
    return Fit(fit.theta, covariance / np.outer(size, size), residual, float(np.sqrt(scale)),
               floor, mean_log, room, effective)


def _effective(values: Array) -> float:
    """Rows that are independent of each other, by the autocorrelation of residuals (n, 3)."""
    n = len(values)
    spectrum = np.fft.rfft(values - values.mean(axis=0), 2 * n, axis=0)
    total = np.fft.irfft((np.abs(spectrum)**2).sum(axis=1))[:max(1, n // 4)]
    rho = total / max(float(total[0]), 1e-300)
    end = int(np.argmax(np.append(rho, 0.0) < 0.1))
    return max(2.0, n / (1.0 + 2.0 * float(rho[1:end].sum())))
