"""
Offset, sensitivity, delay and place of the accelerometer.

V(t + delay) = V0 + M f(t),     f = a - g + (alpha x + omega x omega x) q

The motion of the pose, and of a tool that is displaced, gives the specific force f at the place q:
the regressor of [Gamez2005] Eq. 17 on three axes. Moving through gravity spans what three poses
cannot. An AC-coupled sensor shows f less its own low-passed past.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.calibrate.joint import (
    Blocks,
    ITERATIONS,
    lever,
    nearest_delay,
    noise_at_rest,
    smooth,
)
from forcecal_ros.calibrate.poses import StaticPose
from forcecal_ros.calibrate.tool import gravity_spread
from forcecal_ros.core.errors import above, UnobservableError
from forcecal_ros.core.estimation import jacobian, robust_fit, RobustFit
from forcecal_ros.core.geometry import Array
from forcecal_ros.core.noise.autocovariance import Autocovariance
from forcecal_ros.core.rigid_body import BodyMotion
from forcecal_ros.core.streams import Stream
from forcecal_ros.core.time_grid import Averager
import numpy as np


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
    residual : ndarray, shape (m, 3), or None
        Of the rows of `blocks` [V]; None where the poses were single samples.
    noise : Autocovariance or None
        Of blocks at rest.
    """

    offset: Array
    matrix: Array
    delay: float
    cutoff: float
    position: Array
    covariance: Array
    residual: Array | None = None
    blocks: Blocks | None = None
    noise: Autocovariance | None = None

    @property
    def std(self) -> Array:
        """Standard errors, shape (17,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def accelerometer_fit(stream: Stream, blocks: Blocks, coupling: str = 'dc',
                      cutoff: float | None = None, place: Array | None = None,
                      largest_delay: float = 0.05) -> AccelerometerFit:
    """
    Fit an accelerometer to the motion of the pose.

    Parameters
    ----------
    stream : Stream
        Readings, shape (n, 3).
    blocks : Blocks
        Of accelerometer and pose.
    coupling : str
        ``dc`` or ``ac``.
    cutoff : float or None
        Corner of the high-pass where known [Hz].
    place : ndarray, shape (3,), or None
        Of the accelerometer where known [m].
    largest_delay : float
        Delays after the pose up to this are looked for [s].
    """
    rows, step, n = blocks.rows, blocks.length, len(blocks.rows)
    eye, readings = np.eye(3), Averager(stream.t, stream.values)
    known = np.zeros(3) if place is None else place

    def derived(motion: BodyMotion) -> Array:
        """Acceleration by the place, and specific force at the known one, (n, 3, 4)."""
        by_place = lever(motion)
        force = by_place @ known - motion.apparent_gravity
        return np.concatenate([by_place * (place is None), force[:, :, None]], axis=2)

    whole, noise = smooth(derived(blocks.motion)), blocks.noise_of(derived)
    prior = np.zeros(20)
    # prior of the accelerometer's place, 1 sigma [m]: on a wrist
    place_m = 1.0
    prior[12:15], prior[15], prior[16:] = place_m**-2, largest_delay**-2, 0.0

    def fitted(delay: float, theta: Array | None, every: int = 1, corner: float | None = cutoff
               ) -> RobustFit:
        """Fit map, offset, place, delay, initial state and corner, linear about theta."""
        y = smooth(readings.interpolated(blocks.starts + delay, step))[rows]
        q = np.zeros(3) if theta is None else theta[12:15]
        X, off = np.zeros((2, n, 3, 20))
        for columns, Z in ((X, whole), (off, noise)):
            shown = _highpassed(Z[:, :, 3] + Z[:, :, :3] @ q, step, corner)
            columns[:, :, :9] = np.einsum('ij,nk->nijk', eye, shown[rows]).reshape(n, 3, 9)
            if theta is not None:
                M = theta[:9].reshape(3, 3)
                columns[:, :, 12:15] = M @ _highpassed(Z[:, :, :3], step, corner)[rows]
                columns[:, :, 15] = -np.gradient(shown, step, axis=0)[rows] @ M.T
        X[:, :, 9:12] = eye
        if corner is not None:
            X[:, :, 16:19] = fading(len(whole), step, corner)[rows, None, None] * eye
            if theta is not None and cutoff is None:
                X[:, :, 19] = _by_corner(whole[:, :, 3] + whole[:, :, :3] @ q, step, corner,
                                         theta[:9].reshape(3, 3), theta[16:19])[rows]
        about = np.zeros(20)
        about[12:15] = q
        y = y + X @ about
        return robust_fit(X[::every], y[::every], prior, groups=blocks.groups[::every],
                          tolerance=1e-5 if every == 1 else 1e-2,
                          noise=off if every == 1 else None, about=about)

    corner = cutoff
    if coupling == 'ac' and cutoff is None:
        # corners of a high-pass that are tried before the best is refined [Hz]
        corners_hz = 0.01 * np.exp(np.linspace(-2.3, 2.3, 13))
        corner = float(min(corners_hz, key=lambda f: np.log(
            fitted(0.0, None, blocks.every, f).scale).sum()))
    delay, fit = nearest_delay(largest_delay, blocks, lambda d, theta, every: fitted(
        d, theta, every, corner))
    theta = fit.theta
    for _ in range(ITERATIONS):
        fit = fitted(delay, theta, 1, corner)
        delay = float(np.clip(delay + fit.theta[15], -largest_delay, largest_delay))
        if coupling == 'ac' and cutoff is None and corner is not None:
            corner *= float(np.exp(np.clip(fit.theta[19], -1.0, 1.0)))
        theta = fit.theta
    pick = [9, 10, 11, *range(9), 15, 19, 12, 13, 14]
    unit = np.ones(len(pick))
    unit[pick.index(19)] = 1.0 if corner is None else corner  # of its logarithm
    C = fit.covariance[np.ix_(pick, pick)] * np.outer(unit, unit)
    shown = _highpassed(whole[:, :, 3] + whole[:, :, :3] @ theta[12:15], step, corner)
    explained = shown @ theta[:9].reshape(3, 3).T
    if corner is not None:
        explained = explained + np.outer(fading(len(shown), step, corner), theta[16:19])
    resting = noise_at_rest(
        readings.interpolated(blocks.starts + delay, step) - explained, blocks)
    return AccelerometerFit(
        theta[9:12], theta[:9].reshape(3, 3), delay, np.nan if corner is None else corner,
        theta[12:15] + known, C, fit.residual.reshape(-1, 3), blocks, resting)


def _highpassed(force: Array, step: float, corner: float | None) -> Array:
    """Output of the high-pass, starting from state 0; the input for a sensor that shows DC."""
    return force if corner is None else np.asarray(force - lowpassed(force, step, corner))


def _by_corner(force: Array, step: float, corner: float, M: Array, state: Array) -> Array:
    """Differentiate what is shown by the logarithm of the corner, (n, 3)."""
    more, less = (_highpassed(force, step, f) @ M.T + np.outer(fading(len(force), step, f), state)
                  for f in (1.001 * corner, corner / 1.001))
    return np.asarray((more - less) / (2 * np.log(1.001)))


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
        found = above(spread[0] / max(spread[2], 1e-12), condition)
        raise UnobservableError(
            f'the axes of the accelerometer are not observable from {n} static poses without '
            f'motion between them (condition {found}, expected at most {condition:g}, from 5 '
            f'poses or more); add poses with gravity along {"xyz"[axis]} of ft_sensor')
    rows = np.column_stack([np.ones(n), -gravity])
    bread = np.linalg.inv(rows.T @ rows)
    solution = bread @ rows.T @ volts
    residuals = volts - rows @ solution
    noise = np.diag((residuals**2).sum(axis=0) / (n - 4))
    pick = [0, 4, 8, 1, 2, 3, 5, 6, 7, 9, 10, 11]  # each channel has its offset and its gains
    full = np.full((17, 17), np.nan)
    full[:12, :12] = np.kron(noise, bread)[np.ix_(pick, pick)]
    return AccelerometerFit(solution[0], solution[1:].T, np.nan, np.nan, np.full(3, np.nan), full)


def lowpassed(f: Array, length: float, cutoff: float) -> Array:
    """
    Block means of what a first-order high-pass takes off, starting from state 0.

    The output of the high-pass is f minus this, but for its unknown initial state w0, which adds
    ``w0 * fading(...)``; within a block f is taken as constant.

    Parameters
    ----------
    f : ndarray, shape (n, ...)
        Block means of consecutive blocks.
    length : float
        Of the blocks [s].
    cutoff : float
        Corner [Hz].

    Returns
    -------
    ndarray, shape (n, ...)
    """
    from scipy.signal import lfilter  # takes a second, which a node does not start with

    x = 2 * np.pi * cutoff * length
    keep = np.exp(-x)
    at_start = lfilter([0.0, 1 - keep], [1.0, -keep], f, axis=0)
    return np.asarray(f + (at_start - f) * (1 - keep) / x)


def fading(n: int, length: float, cutoff: float) -> Array:
    """
    Block means of exp(-2 pi cutoff t), t from the start of the first block.

    Parameters
    ----------
    length, cutoff : float
        [s], [Hz]

    Returns
    -------
    ndarray, shape (n,)
    """
    x = 2 * np.pi * cutoff * length
    return np.asarray(np.exp(-x * np.arange(n)) * (1 - np.exp(-x)) / x)


def without_fading(stream: Stream, poses: list[StaticPose], cutoff: float) -> Stream:
    """
    Take off what fades in each static pose, once it is fitted as a * exp(-2 pi cutoff t).

    Parameters
    ----------
    stream : Stream
        Behind the high-pass.
    cutoff : float
        Corner [Hz].

    Returns
    -------
    Stream
        The same outside the poses.
    """
    values = stream.values.copy()
    for pose in poses:
        i, j = np.searchsorted(stream.t, [pose.start, pose.end])
        shape = np.exp(-2 * np.pi * cutoff * (stream.t[i:j] - pose.start))
        x = np.column_stack([shape, np.ones_like(shape)])
        good = np.isfinite(values[i:j]).all(axis=1)
        size = np.linalg.lstsq(x[good], values[i:j][good], rcond=None)[0][0]
        values[i:j] -= np.outer(shape, size)
    return replace(stream, values=values)


class Axes(NamedTuple):
    """Gain (3,) and map (3, 3) of an accelerometer with their standard errors."""

    gain: Array
    map: Array
    gain_std: Array
    map_std: Array


def split_matrix(matrix: Array, covariance: Array, scaled: bool) -> Axes:
    """
    Split a sensitivity into gains and directions.

    Parameters
    ----------
    matrix : ndarray, shape (3, 3)
        V = offset + matrix f.
    covariance : ndarray, shape (9, 9)
        Of its elements, row by row.
    scaled : bool
        Whether the readings are specific force already: gains are positive then, and a
        left-handed map is left-handed. The three gains of volts share the sign that makes the
        map right-handed, as the paper's do.
    """
    sign = 1.0 if scaled or np.linalg.det(matrix) > 0 else -1.0

    def split(m: Array) -> Array:
        rows = m.reshape(3, 3)
        norms = np.linalg.norm(rows, axis=1)
        return np.concatenate([sign * norms, (sign * rows / norms[:, None]).ravel()])

    flat = np.asarray(matrix, dtype=float).ravel()
    J = jacobian(split, flat, np.full(9, 1e-5 * np.abs(flat).max()))
    variance = np.einsum('ij,jk,ik->i', J, covariance, J)
    found = split(flat)
    directions = found[3:].reshape(3, 3)
    return Axes(found[:3], directions, np.sqrt(variance[:3]),
                np.sqrt(np.maximum(variance[3:].reshape(3, 3),
                                   _curvature(directions, J[3:], covariance))))


def _curvature(directions: Array, J: Array, covariance: Array) -> Array:
    """
    Mean square of what each element moves by in second order, shape (3, 3).

    Along itself a unit vector moves in second order only, by -e^2 / 2 for a turn by e. Away from
    there the first order is the larger one.
    """
    turns = (J @ covariance @ J.T).reshape(3, 3, 3, 3)
    out = np.zeros((3, 3))
    for i, row in enumerate(directions):
        C = turns[i, :, i, :]
        out[i] = row**2 * (np.trace(C)**2 + 2 * np.trace(C @ C)) / 4
    return out


def in_words(gain: Array, directions: Array) -> Iterator[str]:
    """Say where each axis points by gains (3,) and map (3, 3), and what hand the three make."""
    for name, row in zip('xyz', directions):
        j = int(np.argmax(np.abs(row)))
        off = np.degrees(np.arccos(min(1.0, abs(row[j]))))
        yield (f'{name} of the accelerometer points along '
               f'{"-" if row[j] < 0 else "+"}{"xyz"[j]} of ft_sensor, {off:.2f} deg off')
    hand = 'right' if np.linalg.det(directions) > 0 else 'left'
    yield f'its axes are {hand}-handed with {"positive" if gain[0] > 0 else "negative"} gains'
