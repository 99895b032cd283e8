"""Tool, biases, accelerometer and delays from any motion, by one robust fit each."""

from collections.abc import Callable
from typing import NamedTuple

from forcecal_ros.core.errors import below, DataError, UnobservableError
from forcecal_ros.core.estimation import robust_fit, RobustFit
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.rigid_body import block_means, body_motion, INERTIAL, regressor, sliding
from forcecal_ros.core.streams import PoseStream, Stream
import numpy as np
from scipy.ndimage import gaussian_filter1d

STEP_S, LOWPASS_S = 0.01, 0.03
"""Grid, and standard deviation of the low-pass that wrench and regressor pass [s]."""

ROWS = slice(16, -16, 3)
"""Rows that are fitted: without the low-pass's ends, one a `LOWPASS_S`, as 0.7 % of what it leaves
is above half their rate."""

MAX_COARSE_ROWS = 1000
"""Rows at most by which the nearest of the delays that are tried first is found."""

MIN_OVERLAP_S = 5.0
"""Least time in which wrench and pose overlap [s]: blocks for standard errors are then 0.1 s."""

MIN_GRAVITY_SPREAD = 0.02
"""Least RMS variation of g - a in a second direction of ft_sensor, of gravity: 1.1
deg of rotation about a second axis, of which errors of the pose by 1 mrad are 5 %."""

MAX_UNEXPLAINED = 0.25
"""Largest share of the variation of a weight in the residual: a wrench with one mirrored axis has
0.3, a free tool 0.01. Where positions are missing, accelerations count as residual: 1."""

MIN_MASS_SIGMA = 5.0
"""Standard errors by which a mass must differ from zero."""


ACCELEROMETER_ITERATIONS = 6
"""Steps of the fit of map, place and delay, each linear in the others: the second is exact to
1e-3 of a standard error."""


class JointFit(NamedTuple):
    """
    Tool, biases and delay of one recording.

    Attributes
    ----------
    theta, std : ndarray, shape (16,)
        Mass [kg], first moments [kg m], inertia about the sensor (xx, yy, zz, xy, xz, yz)
        [kg m^2], biases [N, N m]. Without positions the inertia is 0 and its error infinite.
    com, com_std : ndarray, shape (3,)
        [m]
    delay, delay_std : float
        By which the wrench is late [s].
    spread : ndarray, shape (3,)
        RMS variation of g - a along its principal directions, of gravity.
    unexplained : float
        Residual force over the variation of the explained force.
    """

    theta: Array
    std: Array
    com: Array
    com_std: Array
    delay: float
    delay_std: float
    spread: Array
    unexplained: float
    fit: RobustFit


def joint_fit(wrench: Stream, pose: PoseStream, gravity: Array, largest_delay: float = 0.05,
              optidrive: Stream | None = None) -> JointFit:
    """
    Fit a rigid tool to wrench and pose, moving or at rest.

    Parameters
    ----------
    pose : PoseStream
        Without positions, accelerations of the sensor are taken as 0 and inertia is not fitted.
    gravity : ndarray, shape (3,)
        In base [m/s^2].
    largest_delay : float
        Delays up to this are looked for [s].
    optidrive : Stream or None
        Displacement of the tool along x [m].

    Raises
    ------
    UnobservableError
        The recording is too short, or its motion does not determine the tool.
    DataError
        Pose and wrench are too far apart in time, or a rigid tool does not explain the wrench.
    """
    starts, step = _grid('wrench', wrench, pose, largest_delay)
    motion, slide = body_motion(pose, starts, step, gravity), None
    if optidrive is not None and len(optidrive) > 1:
        slide = block_means(optidrive.t, optidrive.values, starts, step)[:, 0]
        motion = sliding(motion, slide, step)
    spread = _require_rotation(_smooth(motion.apparent_gravity)[ROWS] / np.linalg.norm(gravity))
    X = _smooth(regressor(motion, slide))
    if not pose.has_position:
        X[:, :, 4:] = 0.0
    rates = -np.gradient(X, step, axis=0)[ROWS]
    X = X[ROWS]
    bias = np.broadcast_to(np.eye(6), (len(X), 6, 6))

    def fitted(delay: float, theta: Array | None, every: int = 1) -> RobustFit:
        y = _smooth(block_means(wrench.t, wrench.values, starts + delay, step))[ROWS]
        columns = [X, bias]
        if theta is not None:
            columns.append((rates @ theta[:INERTIAL])[:, :, None])
        return robust_fit(np.concatenate(columns, axis=2)[::every], y[::every],
                          tolerance=1e-5 if every == 1 else 1e-2)

    delay, fit = _nearest_delay(largest_delay, len(X), fitted)
    for _ in range(4):
        fit = fitted(delay, fit.theta)
        change = float(fit.theta[16])
        delay = float(np.clip(delay + change, -largest_delay, largest_delay))
        if abs(change) < 1e-6:
            break
    theta, std, C = fit.theta[:16], fit.std[:16], fit.covariance
    if not pose.has_position:
        std[4:INERTIAL] = np.inf
    most = MAX_UNEXPLAINED if pose.has_position else 1.0
    unexplained = _require_tool(theta, std, fit, X @ theta[:INERTIAL], most)
    if abs(delay) >= 0.95 * largest_delay:
        raise DataError(
            f'pose and wrench fit best {1e3 * abs(delay):.3g} ms apart, the limit of what is '
            f'looked for ({1e3 * largest_delay:.3g} ms), so that their stamps are of different '
            'clocks; stamp both by one clock')
    com = theta[1:4] / theta[0]
    J = np.column_stack([-com, np.eye(3)]) / theta[0]
    com_std = np.sqrt(np.diag(J @ C[:4, :4] @ J.T))
    return JointFit(theta, std, com, com_std, delay, float(fit.std[16]), spread, unexplained,
                    fit)


class AccelerometerFit(NamedTuple):
    """
    Accelerometer of one recording, reading = offset + matrix (a - g) at its place.

    Attributes
    ----------
    theta, covariance : ndarray, shape (16,), (16, 16)
        Matrix (9, row by row) [unit/(m/s^2)], offset (3) [unit], place in ft_sensor (3) [m], and
        by how much it is late after the pose [s].
    """

    theta: Array
    covariance: Array


def accelerometer_fit(stream: Stream, pose: PoseStream, gravity: Array,
                      largest_delay: float = 0.05, optidrive: Stream | None = None
                      ) -> AccelerometerFit:
    """
    Fit an accelerometer to the motion of the pose.

    Parameters
    ----------
    stream : Stream
        Readings, shape (n, 3).
    pose, gravity, largest_delay, optidrive
        As for :func:`joint_fit`; the pose has positions.

    Raises
    ------
    UnobservableError
        The recording is too short.
    """
    starts, step = _grid('accelerometer', stream, pose, largest_delay)
    motion = body_motion(pose, starts, step, gravity)
    if optidrive is not None and len(optidrive) > 1:
        motion = sliding(
            motion, block_means(optidrive.t, optidrive.values, starts, step)[:, 0], step)
    W = skew(motion.omega)
    lever = _smooth(skew(motion.alpha) + W @ W)
    force = -_smooth(motion.apparent_gravity)
    n, eye = len(force[ROWS]), np.eye(3)

    def fitted(delay: float, theta: Array | None, every: int = 1) -> RobustFit:
        y = _smooth(block_means(stream.t, stream.values, starts + delay, step))[ROWS]
        place = np.zeros(3) if theta is None else theta[12:15]
        at_place = force + lever @ place
        columns = [np.einsum('ij,nk->nijk', eye, at_place[ROWS]).reshape(n, 3, 9),
                   np.broadcast_to(eye, (n, 3, 3))]
        if theta is not None:
            matrix = theta[:9].reshape(3, 3)
            columns += [matrix @ lever[ROWS],
                        -(np.gradient(at_place, step, axis=0)[ROWS] @ matrix.T)[:, :, None]]
            y = y + lever[ROWS] @ place @ matrix.T
        return robust_fit(np.concatenate(columns, axis=2)[::every], y[::every],
                          tolerance=1e-5 if every == 1 else 1e-2)

    delay, fit = _nearest_delay(largest_delay, n, fitted)
    theta = np.concatenate([fit.theta, np.zeros(3)])
    for _ in range(ACCELEROMETER_ITERATIONS):
        fit = fitted(delay, theta)
        delay = float(np.clip(delay + fit.theta[15], -largest_delay, largest_delay))
        theta = fit.theta[:15]
    return AccelerometerFit(np.append(theta, delay), fit.covariance)


def _grid(role: str, stream: Stream, pose: PoseStream, largest_delay: float
          ) -> tuple[Array, float]:
    """Return starts and length of blocks [s] in which a stream overlaps the pose."""
    step = max(STEP_S, float(np.median(np.diff(pose.t))), float(np.median(np.diff(stream.t))))
    first, last = max(stream.t[0], pose.t[0]), min(stream.t[-1], pose.t[-1])
    if last - first < MIN_OVERLAP_S:
        raise UnobservableError(
            f'{role} and pose overlap for {below(max(last - first, 0.0), MIN_OVERLAP_S)} s, and '
            f'motion shows a tool in {MIN_OVERLAP_S:g} s at least; record longer')
    return np.arange(first + largest_delay, last - largest_delay - step, step), step


def _smooth(values: Array) -> Array:
    return np.asarray(gaussian_filter1d(values, LOWPASS_S / STEP_S, axis=0))


def _nearest_delay(largest: float, n: int, fitted: Callable[..., RobustFit]
                   ) -> tuple[float, RobustFit]:
    """Try eleven delays on every few of n rows; return the best with its fit."""
    coarse = np.linspace(-largest, largest, 11)
    tried = [fitted(delay, None, 2 + n // MAX_COARSE_ROWS) for delay in coarse]
    best = int(np.argmin([np.log(one.scale).sum() for one in tried]))
    return float(coarse[best]), tried[best]


def _require_rotation(force: Array) -> Array:
    """Return the spread of specific forces (n, 3), of gravity; refuse that about one axis only."""
    _, spread, directions = np.linalg.svd(force - force.mean(axis=0), full_matrices=False)
    spread = spread / np.sqrt(len(force))
    if spread[1] >= MIN_GRAVITY_SPREAD:
        return np.asarray(spread)
    degrees = np.degrees(spread)
    if spread[0] < MIN_GRAVITY_SPREAD:
        raise UnobservableError(
            f'gravity turns by {degrees[0]:.2g} deg RMS in ft_sensor, so that mass, centre of '
            'mass and biases are not observable; rotate the sensor by 20 deg or more about two '
            'horizontal axes')
    along = np.cross(force.mean(axis=0), directions[0])
    axis = 'xyz'[int(np.argmax(np.abs(along)))]
    other = 'xyz'[int(np.argmax(np.abs(directions[0])))]
    raise UnobservableError(
        f'the sensor turns about one axis only, near its {axis}: gravity moves by '
        f'{degrees[0]:.2g} deg RMS one way and {degrees[1]:.2g} deg across, and '
        f'{np.degrees(MIN_GRAVITY_SPREAD):.2g} deg are needed for centre of mass and torque bias; '
        f'rotate about {other} as well, by 10 deg or more')


def _require_tool(theta: Array, std: Array, fit: RobustFit, explained: Array, most: float
                  ) -> float:
    """Refuse a mass that is chance, and forces that are not a rigid tool's; return the share."""
    mass = float(theta[0])
    if not abs(mass) > MIN_MASS_SIGMA * std[0]:
        raise UnobservableError(
            f'the mass is {mass:.3g} kg with a standard error of {std[0]:.2g} kg, and '
            f'{MIN_MASS_SIGMA:g} standard errors are needed; rotate further, or attach the tool')
    varies = float(np.sqrt(explained[:, :3].var(axis=0).mean()))
    share = float(fit.scale[0]) / varies
    if share > most:
        raise DataError(
            f'forces differ from those of a rigid tool by {fit.scale[0]:.3g} N RMS, {share:.0%} '
            f'of the variation of its weight ({varies:.3g} N; at most {most:.0%} can be '
            'accepted); compare the axes of the wrench with those of the pose, and record free of '
            'contact')
    return share
